# SPDX-License-Identifier: MIT
"""Files and functions that docs/followed.md names where it follows a command."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "followed.md"
ROW = re.compile(r"^\| `(?P<path>[^`]+)` \| (?P<functions>`[^|]+`) \|", re.M)


def steps(page: str) -> list[tuple[str, str]]:
    """Each file with each of the functions that are named beside it."""
    return [
        (row["path"], function)
        for row in ROW.finditer(page)
        for function in re.findall(r"`([^`]+)`", row["functions"])
    ]


def has(path: Path, function: str) -> bool:
    """Whether a file defines a function, or a method as Class.method."""
    text = path.read_text("utf-8")
    if path.suffix == ".py":
        return function in python_functions(ast.parse(text))
    if path.suffix == ".S":
        return f"\n{function}:" in text
    # What is defined begins in the first column, and its brace follows its arguments.
    return bool(re.search(rf"^\w[^;{{}}]*\b{function}\([^;{{}}]*\)\s*{{", text, re.M))


def python_functions(tree: ast.Module) -> set[str]:
    found = set()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.ClassDef):
            found |= {
                f"{node.name}.{each.name}"
                for each in node.body
                if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)
            }
    return found


def test_each_step_of_the_followed_command_is_there() -> None:
    found = steps(PAGE.read_text("utf-8"))
    assert len(found) > 30, "its tables are not read"
    gone = [
        f"{path}: {function}"
        for path, function in found
        if not (ROOT / path).is_file() or not has(ROOT / path, function)
    ]
    assert not gone, "docs/followed.md: " + "; ".join(gone)


@pytest.mark.parametrize(
    ("name", "text", "there", "gone"),
    [
        ("a.py", "class A:\n    async def b(self): ...\n", "A.b", "b"),
        (
            "a.c",
            "static int f(int a,\n             int b) {\n}\nint g(void);\n",
            "f",
            "g",
        ),
        ("a.S", "    .global x\nx:\n    call y\n", "x", "y"),
    ],
)
def test_a_function_that_is_only_named_is_not_there(
    tmp_path: Path, name: str, text: str, there: str, gone: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    assert has(path, there)
    assert not has(path, gone)
