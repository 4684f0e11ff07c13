# SPDX-License-Identifier: MIT
"""Files and functions stay short enough to be read at one go, but for those that
docs/architecture.md names with their reasons."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from test_house import FOLDERS, ROOT, files, identified

FILE_LINES = 600
FUNCTION_LINES = 60

# A table with the columns: file or function, lines, reason.
PAGE = ROOT / "docs" / "architecture.md"
HEADING = "### Longer than the limit"


def c_functions(text: str) -> Iterator[tuple[str, int]]:
    """Name and lines of each function, from its declaration to its closing brace.

    The text is laid out by clang-format: only what is at the top level begins in the
    first column, and a function's body ends with a brace alone.
    """
    start, head = 0, ""
    for number, line in enumerate(re.sub(r" *//.*", "", text).splitlines()):
        if line == "}":
            named = re.match(r"[\w\s*]*?(?:ISR\()?(\w+)[(),]", head)
            if named and head.endswith(") {"):
                yield named[1], number - start + 1
        elif re.match(r"\w", line):
            start, head = number, line
        elif not head.endswith(("{", ";")):  # a declaration of several lines
            head += line


def python_functions(text: str) -> Iterator[tuple[str, int]]:
    """Name and lines of each function and method, decorators left out."""
    statements: list[ast.AST] = [ast.parse(text)]
    while statements:
        node = statements.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name, (node.end_lineno or 0) - node.lineno + 1
        for part in ("body", "orelse", "handlers", "finalbody", "cases"):
            statements += getattr(node, part, ())


def too_long(path: Path) -> dict[str, int]:
    """Lines of the file and of those of its functions that are over the limit."""
    text = path.read_text("utf-8")
    lines = len(text.splitlines())
    found = (python_functions if path.suffix == ".py" else c_functions)(text)
    over = {
        f"{identified(path)}: {name}": count
        for name, count in found
        if count > FUNCTION_LINES
    }
    if lines > FILE_LINES:
        over[identified(path)] = lines
    return over


def exceptions() -> dict[str, int]:
    """The exceptions to the limits, from the page's table."""
    _, _, section = PAGE.read_text("utf-8").partition(HEADING)
    rows = re.findall(
        r"^\| *`?([^|`]+?)`? *\| *([\d,]+) *\| *(.*?) *\|$",
        section.partition("\n#")[0],
        re.MULTILINE,
    )
    assert all(reason for _, _, reason in rows), "an exception has no reason"
    return {name: int(lines.replace(",", "")) for name, lines, _ in rows}


SOURCES = files(*(ROOT / name for name in FOLDERS), kinds=("*.c", "*.h", "*.py"))


def test_only_what_is_excepted_is_longer_than_the_limit() -> None:
    found = {name: lines for path in SOURCES for name, lines in too_long(path).items()}
    allowed = exceptions()
    over = [f"{name}: {n}" for name, n in found.items() if n > allowed.get(name, 0)]
    assert not over, "\n".join(over)
    unused = [name for name in allowed if name not in found]
    assert not unused, f"excepted without need: {unused}"


@pytest.mark.parametrize("lines", [FUNCTION_LINES, FUNCTION_LINES + 1])
def test_a_function_that_is_a_line_too_long_is_seen(lines: int) -> None:
    body = "    x();\n" * (lines - 3)
    planted = (
        "struct a {\n    int b;\n};\n\nint c(void);\n\n"
        f"static struct a *f(int one,\n            int two) {{  // both\n{body}}}\n\n"
        "ISR(TIMER_vect) {\n}\n"
    )
    assert list(c_functions(planted)) == [("f", lines), ("TIMER_vect", 2)]
    body = "    x()\n" * (lines - 1)
    assert list(python_functions(f"def f():\n{body}")) == [("f", lines)]
