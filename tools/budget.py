# SPDX-License-Identifier: MIT
"""Holds each room of the project to its budget of lines and bytes: tools/budget.toml.

Counts every text file that git tracks and that people write. Prints a line a room, and
fails if one is above its budget. --lower takes over what is less; only a hand that
edits the file raises a number. It also fails if a command took more of a processor
than its budget when tools/fresh.py ran it here last.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
BUDGET = ROOT / "tools" / "budget.toml"
SPENT = ROOT / "build" / "spent.json"


class Size(NamedTuple):
    """Of a file, a room, or all."""

    lines: int
    bytes: int

    def plus(self, other: Size) -> Size:
        return Size(self.lines + other.lines, self.bytes + other.bytes)


def sizes(root: Path, not_written: list[str]) -> dict[str, Size]:
    """Each tracked text file by its path, but for those that a pattern leaves out."""
    listed = subprocess.check_output(["git", "ls-files", "-z"], cwd=root, text=True)
    found = {}
    for name in filter(None, listed.split("\0")):
        path, file = PurePosixPath(name), root / name
        is_left_out = any(path.match(pattern) for pattern in not_written)
        if is_left_out or file.is_symlink() or not file.is_file():
            continue
        content = file.read_bytes()
        if b"\0" not in content:
            found[name] = Size(content.count(b"\n"), len(content))
    return found


def by_room(files: Mapping[str, Size], rooms: Mapping[str, Size]) -> dict[str, Size]:
    """Each file counts in the innermost room that it is in; "." has the others."""
    found = dict.fromkeys(rooms, Size(0, 0))
    for name, size in files.items():
        above = (str(folder) for folder in PurePosixPath(name).parents)
        room = next(folder for folder in above if folder in rooms)
        found[room] = found[room].plus(size)
    return found


def lowered(text: str, found: Mapping[str, Size]) -> str:
    """The budget's text with what is less than it allows."""
    for room, size in found.items():
        row = re.compile(rf'^"{re.escape(room)}" = \[(\d+), (\d+)\]$', re.MULTILINE)
        for match in row.finditer(text):
            least = [*map(min, size, map(int, match.groups()))]
            text = text.replace(match[0], f'"{room}" = {least}')
    return text


def main() -> int:
    """Print the rooms; 1 if one is above its budget."""
    parser = argparse.ArgumentParser(prog="tools/budget.py", description=__doc__)
    parser.add_argument("--lower", action="store_true", help="lower the budget")
    budget = tomllib.loads(BUDGET.read_text("utf-8"))
    rooms = {name: Size(*size) for name, size in budget["rooms"].items()}
    found = by_room(sizes(ROOT, budget["not_written_by_hand"]), rooms)
    if parser.parse_args().lower:
        BUDGET.write_text(lowered(BUDGET.read_text("utf-8"), found), "utf-8")
    status = 0
    for name, size in found.items():
        print(f"{size.lines:8,} lines {size.bytes:12,} bytes  {name}")
        for kind, count, most in zip(Size._fields, size, rooms[name], strict=True):
            if count > most:
                print(f"{name}: {count - most:,} {kind} above its budget", flush=True)
                status = 1
    total = Size(*map(sum, zip(*found.values(), strict=True)))
    print(f"{total.lines:8,} lines {total.bytes:12,} bytes  in all")
    spent = json.loads(SPENT.read_text()) if SPENT.exists() else {}
    for command, most in budget["units"].items():
        if command in spent:
            print(f"{spent[command]:8,} of {most} units of processor time  {command}")
            status |= spent[command] > most
    return status


if __name__ == "__main__":
    sys.exit(main())
