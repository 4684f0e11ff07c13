# SPDX-License-Identifier: MIT
"""The hazards of docs/safety.md name tests that there are, and its warning stands where
people aim."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "safety.md"
NAMED = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")
WARNING = "no medical device"


def gone(page: str) -> list[str]:
    """The tests that a page names and that are not there."""
    return [
        f"{path}::{name}"
        for path, name in NAMED.findall(page)
        if not (ROOT / path).is_file() or name not in functions(ROOT / path)
    ]


def functions(path: Path) -> set[str]:
    tree = ast.parse(path.read_text("utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_each_test_of_a_hazard_is_there() -> None:
    page = PAGE.read_text("utf-8")
    assert len(NAMED.findall(page)) > 15, "its table is not read"
    assert gone(page) == []


def test_each_hazard_has_a_test() -> None:
    _, _, section = PAGE.read_text("utf-8").partition("\n## Hazards\n")
    rows = re.findall(r"^\| (.*) \|$", section.partition("\n## ")[0], re.M)[2:]
    assert [row for row in rows if not NAMED.search(row)] == []


@pytest.mark.parametrize(
    "name",
    [
        "tests/test_safety.py::test_that_is_not_there",
        "tests/test_nowhere.py::test_each_hazard_has_a_test",
    ],
)
def test_a_test_that_is_not_there_is_seen(name: str) -> None:
    assert gone(f"| `{name}` |") == [name]


@pytest.mark.parametrize(
    "name",
    [
        *("README.md", "docs/ros2.md", "docs/page.md", "docs/safety.md"),
        "host/imud/web/site/aim/reading.js",
    ],
)
def test_the_warning_stands_where_people_aim(name: str) -> None:
    assert WARNING in (ROOT / name).read_text("utf-8")
