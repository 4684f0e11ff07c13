# SPDX-License-Identifier: MIT
"""A plugin of pytest that assigns tests to the processes of xdist.

IMU_TESTS in a process's environment says which files it runs: `native` those that load
the firmware's C, under the address sanitizer; `others` the rest. Without it a process
runs everything. Processes get units: neighbouring tests of a file that take about a
second together and share the file's fixtures. Files with long tests go first, so that
none is left over at the end.
"""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

import pytest
from xdist.scheduler import LoadScopeScheduling

from native import CACHE, locked
from pace import UNKNOWN_S, file_of, seconds_of_files

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent
UNIT_S = 1.0

# Parsing all of the tests would take a second of each process.
IMPORTS = re.compile(
    r"^ *(?:from ([\w.]+) import (\([^)]*\)|.*)|import (.*))$", re.MULTILINE
)
WORD = re.compile(r"[\w.]+")


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


@functools.cache
def builds_on_itself(path: Path) -> bool:
    """Whether a file's tests must run in order in one process: the mark `together`."""
    return path.is_file() and "pytest.mark.together" in path.read_text()


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    wanted = os.environ.get("IMU_TESTS")
    if wanted is None or collection_path.suffix != ".py":
        return None
    return True if loads_c(collection_path) != (wanted == "native") else None


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Of processes that run the same files one collects at a time: the first compiles
    modules and C, which the others then find.
    """
    if not hasattr(session.config, "workerinput"):
        return (yield)
    CACHE.mkdir(parents=True, exist_ok=True)
    with locked(CACHE / f".collect-{os.environ.get('IMU_TESTS', 'all')}"):
        return (yield)


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
    """Hands out units in the order of collection, each to a process that collected it.

    It begins when the first process has collected; others may still be compiling.
    """

    def __init__(self, config: pytest.Config, log: Any) -> None:
        super().__init__(config, log)
        self._begun = 0  # processes that have collected
        self._unit: dict[str, str] = {}  # the unit of each test
        self._asked: dict[str, str] = {}  # IMU_TESTS of each unit's processes

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
            return  # a process with the same IMU_TESTS has collected these
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
        # xdist starts a test once it knows the next one, so two must be pending.
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
        if crashed is not None:  # the test that crashed is not run again
            self.assigned_work[node][self._unit[crashed]][crashed] = True
        super().remove_node(node)
        self.registered_collections.pop(
            node, None
        )  # absent if the process ended before it collected
        return crashed


def asked_of(node: Any) -> str:
    """A process's IMU_TESTS, from its `--tx` option; "all" without it."""
    found = re.search(r"IMU_TESTS=(\w+)", str(node.gateway.spec.python))
    return found[1] if found else "all"
