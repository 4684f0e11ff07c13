# SPDX-License-Identifier: MIT
"""Chooses how much work a test does: a part in `make test`, all in `make test-long`.

A test that chooses itself has the mark `long`, by which `make test-long` selects it.
The mark `sampled(n)` has `make test` run every nth case of each parametrized test of a
file, and `make test-long` all of them. A test with the mark `nightly` is for
`make test-long` alone. plain pytest also runs all of them, and as many examples of
hypothesis as `make test-long`, of which `make test` tries a third.
"""

from __future__ import annotations

import os
import random
import zlib
from collections.abc import Sequence
from typing import TypeVar

import hypothesis
import pytest

T = TypeVar("T")

IS_LONG = os.environ.get("IMU_LONG") == "1"
IS_SAMPLE = os.environ.get("IMU_SAMPLE") == "1"
ORDER = os.environ.get("IMU_ORDER", "")  # a seed: files in a random order


def choose(*, everyday: T, long: T) -> T:
    """The number of examples, seconds or cases for this kind of run."""
    return long if IS_LONG else everyday


def examples(count: int) -> int:
    """How many examples of hypothesis this kind of run tries."""
    return count // 3 if IS_SAMPLE else count


def left_out(items: Sequence[pytest.Item]) -> set[pytest.Item]:
    """Tests that the marks `sampled` and `nightly` leave out of `make test`."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("sampled") is not None:
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    found = {item for item in items if item.get_closest_marker("nightly")}
    for name, family in cases.items():
        mark = family[0].get_closest_marker("sampled")
        (step,) = mark.args
        # Tests of the same cases begin with different ones: not all with one board.
        first = zlib.crc32(name.encode()) % min(step, len(family))
        found |= set(family) - set(family[first::step])
    return found


# The same examples on every run and every machine.
hypothesis.settings.register_profile(
    "imud",
    derandomize=True,
    database=None,
    deadline=None,
    print_blob=True,
    max_examples=examples(100),
)
hypothesis.settings.load_profile("imud")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> None:
    if IS_SAMPLE:
        found = left_out(items)
        config.hook.pytest_deselected(items=[i for i in items if i in found])
        items[:] = [item for item in items if item not in found]
    if ORDER:
        files = sorted({item.path for item in items})
        random.Random(ORDER).shuffle(files)  # noqa: S311 - no secret
        items.sort(key=lambda item: files.index(item.path))


def pytest_report_header() -> str:
    return f"order of files: IMU_ORDER={ORDER}" if ORDER else ""
