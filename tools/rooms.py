# SPDX-License-Identifier: MIT
"""Counts the lines of the rooms that docs/architecture.md lists, and says which of its
numbers are out of date; with --write, brings them up to date.

A number has two digits, and is left alone until it is off by more than TOLERANCE: no
commit has to touch the page for a few lines.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "architecture.md"
HEADING, END = "## Rooms", "\n### "
SOURCES = ("*.c", "*.h", "*.ld", "*.py", "*.pyi", "*.S", "*.sh")
TOLERANCE = 0.15
COMMAND = ".venv/bin/python tools/rooms.py --write"

# The first cell of a head names the folder that a table is about, or none.
HEAD = re.compile(r"^\| (?:`(?P<base>[^`]+)/`|other folders) \| purpose \| lines \|$")
ROW = re.compile(
    r"^\| (?P<name>`[^`]+`|\(the folder itself\)) \|.*\| (?P<lines>\d+) \|$"
)


@dataclass(frozen=True, slots=True)
class Room:
    """A row of the page."""

    number: int  # of its line, from 0
    base: str  # the folder of its table; empty: the project's
    folder: Path
    is_flat: bool  # without the folders inside
    stated: int


def main() -> None:
    parser = argparse.ArgumentParser(prog="tools/rooms.py", description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the page")
    is_to_write = parser.parse_args().write
    page = PAGE.read_text("utf-8")
    wrong = differences(page)
    if is_to_write:
        PAGE.write_text(written(page), "utf-8")
        wrong = differences(PAGE.read_text("utf-8"))
    sys.exit("\n".join(wrong) or None)


def differences(page: str) -> list[str]:
    """Rows and numbers that are out of date, one line each: rows by hand, numbers by
    COMMAND."""
    found = list(rooms(page))
    wrong = [
        f"{name(room.folder)} is not a folder; correct its row in docs/architecture.md"
        for room in found
        if not room.folder.is_dir()
    ]
    wrong += [
        f"{name(folder)} has no row in docs/architecture.md"
        for folder in without_row(found)
    ]
    wrong += [
        f"{name(room.folder)} has {lines} lines, not {room.stated}; run {COMMAND}"
        for room, lines in counted(found)
        if abs(room.stated - lines) > TOLERANCE * lines
    ]
    return wrong


def written(page: str) -> str:
    """The page with numbers of today."""
    text = page.splitlines()
    for room, lines in counted(list(rooms(page))):
        text[room.number] = re.sub(r"\d+ \|$", f"{rounded(lines)} |", text[room.number])
    return "\n".join(text) + "\n"


def rooms(page: str) -> Iterator[Room]:
    """The rows of the tables below HEADING."""
    before, _, section = page.partition(HEADING)
    first, base = before.count("\n"), ""
    for number, line in enumerate(section.partition(END)[0].splitlines(), first):
        if head := HEAD.match(line):
            base = head["base"] or ""
        elif row := ROW.match(line):
            is_flat = not row["name"].startswith("`")
            folder = ROOT / base / ("" if is_flat else row["name"].strip("`"))
            yield Room(number, base, folder, is_flat, int(row["lines"]))


def counted(found: list[Room]) -> Iterator[tuple[Room, int]]:
    """Lines of each room that is there, without those of rooms inside it."""
    folders = [room.folder for room in found if not room.is_flat]
    for room in found:
        if room.folder.is_dir():
            paths = sources(room.folder, is_flat=room.is_flat)
            inner = [each for each in folders if room.folder in each.parents]
            own = [path for path in paths if not set(inner) & set(path.parents)]
            yield room, sum(len(path.read_bytes().splitlines()) for path in own)


def without_row(found: list[Room]) -> list[Path]:
    """Folders with sources, of the tables that are about a folder, in no room."""
    folders = {room.folder for room in found if not room.is_flat}
    left = {
        path.parent
        for base in {room.base for room in found if room.base}
        for path in sources(ROOT / base)
        if path.parent != ROOT / base and not folders & set(path.parents)
    }
    return sorted(folder for folder in left if not left & set(folder.parents))


def sources(folder: Path, *, is_flat: bool = False) -> list[Path]:
    found = [
        path
        for kind in SOURCES
        for path in (folder.glob(kind) if is_flat else folder.rglob(kind))
    ]
    return [path for path in found if "__pycache__" not in path.parts]


def rounded(lines: int) -> int:
    """To two digits."""
    step = int("1".ljust(len(str(lines)) - 1, "0"))
    return (lines + step // 2) // step * step


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


if __name__ == "__main__":
    main()
