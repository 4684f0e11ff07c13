# SPDX-License-Identifier: MIT
"""A plugin of pytest that marks the tests that load the firmware's C: `native`.

`make test` runs them by `-m native` under the address sanitizer, then the others by
`-m "not native"`. A file that such an option leaves out is not imported: its C would be
compiled once more, with other flags.
"""

from __future__ import annotations

import functools
import re
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent

# Parsing all of the tests would take a second of each process.
IMPORTS = re.compile(
    r"^ *(?:from ([\w.]+) import (\([^)]*\)|.*)|import (.*))$", re.MULTILINE
)
WORD = re.compile(r"[\w.]+")
CHOICE = re.compile(r"(not )?native(?: and \([^()]*\))?")


@functools.cache
def loads_c(path: Path) -> bool:
    """Whether a test file, or a module that it imports, has native build its C."""
    text = path.read_text()
    if "native.load(" in text or "native.program(" in text:
        return True
    modules = set()
    for module, names, plain in IMPORTS.findall(text):
        modules |= {module, *(f"{module}.{name}" for name in WORD.findall(names))}
        modules |= set(WORD.findall(plain))
    files = (TESTS / f"{name.replace('.', '/')}.py" for name in modules)
    return any(loads_c(file) for file in files if file.is_file())


def is_left_out(path: Path, expression: str) -> bool:
    """Whether the expression of `-m` deselects every test of a file."""
    choice = CHOICE.fullmatch(expression)
    return choice is not None and loads_c(path) == bool(choice[1])


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    if collection_path.suffix != ".py":
        return None
    return is_left_out(collection_path, config.getoption("markexpr")) or None


def pytest_itemcollected(item: pytest.Item) -> None:
    if loads_c(item.path):
        item.add_marker("native")
