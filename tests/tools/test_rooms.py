# SPDX-License-Identifier: MIT
"""The numbers of lines in docs/architecture.md, which tools/rooms.py writes."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
import rooms


def test_the_rooms_of_the_page_are_those_of_the_tree() -> None:
    wrong = rooms.differences(rooms.PAGE.read_text("utf-8"))
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("lines", "shown"), [(7, 7), (99, 99), (176, 180), (1049, 1000), (75387, 75000)]
)
def test_a_number_has_two_digits(lines: int, shown: int) -> None:
    assert rooms.rounded(lines) == shown


def changed(pattern: str, with_what: str) -> str:
    page, count = re.subn(pattern, with_what, rooms.PAGE.read_text("utf-8"), flags=re.M)
    assert count == 1
    return page


def test_a_number_that_is_far_off_is_told_with_the_command_and_mended() -> None:
    page = changed(r"^(\| `core/math` .*) \d+ \|$", r"\1 2000 |")
    (told,) = rooms.differences(page)
    assert told.startswith("firmware/core/math has ")
    assert told.endswith(f"not 2000; run {rooms.COMMAND}")
    assert rooms.differences(rooms.written(page)) == []


def test_a_folder_without_a_row_and_a_row_without_a_folder_are_told() -> None:
    page = changed(r"^\| `core/math` ", "| `core/maths` ")
    assert rooms.differences(page) == [
        "firmware/core/maths is not a folder; correct its row in docs/architecture.md",
        "firmware/core/math has no row in docs/architecture.md",
    ]


def test_a_room_has_the_lines_of_rooms_inside_it_once() -> None:
    found = list(rooms.rooms(rooms.PAGE.read_text("utf-8")))
    lines = {rooms.name(room.folder): n for room, n in rooms.counted(found)}
    inside = rooms.sources(rooms.ROOT / "sim" / "chips")
    assert lines["sim/chips"] == sum(
        len(path.read_bytes().splitlines()) for path in inside
    )
    every = rooms.sources(rooms.ROOT / "sim")
    whole = sum(len(path.read_bytes().splitlines()) for path in every)
    assert sum(n for name, n in lines.items() if name.split("/")[0] == "sim") == whole
