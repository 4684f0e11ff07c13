# SPDX-License-Identifier: MIT
"""Which process runs which tests, when xdist runs several; a plugin of pytest.

IMU_TESTS in the environment of a process says which files it runs: `native` those that
load the firmware's C, under the address sanitizer; `others` all the rest. Without it a
process runs everything. What is handed out is a unit: neighbours in a file that take a
second or so together and share what the file has set up. Files with long tests go
first, so that no process is left with one at the end.
"""

from __future__ import annotations

import ast
import functools
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from xdist.scheduler import LoadScopeScheduling

from pace import UNKNOWN_S, file_of, seconds_of_files

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent
UNIT_S = 1.0


@functools.cache
def loads_c(path: Path) -> bool:
    """Whether a file of tests, or one that it imports, loads a library of native.py."""
    text = path.read_text()
    if "native.load(" in text:
        return True
    modules = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            modules |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            modules |= {node.module, *(f"{node.module}.{n.name}" for n in node.names)}
    files = (TESTS / f"{name.replace('.', '/')}.py" for name in modules)
    return any(loads_c(file) for file in files if file.is_file())


@functools.cache
def builds_on_itself(path: Path) -> bool:
    """Whether a file's tests have to follow each other, by its mark."""
    return path.is_file() and "pytest.mark.together" in path.read_text()


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    wanted = os.environ.get("IMU_TESTS")
    if wanted is None or collection_path.suffix != ".py":
        return None
    return True if loads_c(collection_path) != (wanted == "native") else None


def pytest_itemcollected(item: pytest.Item) -> None:
    if loads_c(item.path):
        item.add_marker("native")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> None:
    if hasattr(config, "workerinput"):
        means = seconds_of_files()
        items.sort(key=lambda item: -means.get(file_of(item.nodeid), UNKNOWN_S))


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Units:
    return Units(config, log)


class Units(LoadScopeScheduling):
    """Hands out units in the order of collection, each to a process that collected it,
    as soon as a process has collected: others may still be compiling.
    """

    def __init__(self, config: pytest.Config, log: Any) -> None:
        super().__init__(config, log)
        self._begun = 0  # processes that have collected
        self._unit: dict[str, str] = {}  # of each test
        self._asked: dict[
            str, str
        ] = {}  # of each unit, what its processes are asked for

    @property
    def collection_is_completed(self) -> bool:
        return self._begun > 0

    @property
    def tests_finished(self) -> bool:
        return self._begun >= self.numnodes and super().tests_finished

    def add_node_collection(self, node: Any, collection: Sequence[str]) -> None:
        self._begun += 1
        self.registered_collections[node] = list(collection)
        asked = asked_of(node)
        if asked in self._asked.values():
            return  # another one that is asked for the same has brought them
        means = seconds_of_files()
        seconds: dict[str, float] = {}
        for test in collection:
            file = file_of(test)
            before_s = seconds.get(file, 0.0)
            seconds[file] = before_s + means.get(file, UNKNOWN_S)
            part = "" if builds_on_itself(ROOT / file) else int(before_s / UNIT_S)
            unit = f"{asked} {file} {part}"
            self._unit[test] = unit
            self._asked[unit] = asked
            self.workqueue.setdefault(unit, {})[test] = False

    def schedule(self) -> None:
        for node in self.registered_collections:
            self._reschedule(node)

    def _split_scope(self, nodeid: str) -> str:
        return self._unit[nodeid]

    def _reschedule(self, node: Any) -> None:
        # xdist starts a test when it knows the next one: two have to wait.
        while (
            not node.shutting_down and self._pending_of(self.assigned_work[node]) <= 2
        ):
            unit = next(
                (u for u in self.workqueue if self._asked[u] == asked_of(node)), ""
            )
            if not unit:
                node.shutdown()
                return
            self.workqueue.move_to_end(unit, last=False)
            self._assign_work_unit(node)

    def remove_node(self, node: Any) -> str | None:
        units = self.assigned_work[node].values()
        left = (test for unit in units for test, is_done in unit.items() if not is_done)
        crashed = next(left, None)
        if crashed is not None:  # what ended the process is not run a second time
            self.assigned_work[node][self._unit[crashed]][crashed] = True
        super().remove_node(node)
        self.registered_collections.pop(node, None)  # it may have ended before
        return crashed


def asked_of(node: Any) -> str:
    """IMU_TESTS, as its `--tx` sets it."""
    found = re.search(r"IMU_TESTS=(\w+)", str(node.gateway.spec.python))
    return found[1] if found else "all"
