# SPDX-License-Identifier: MIT
"""The fixtures of several files of tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from chain import Chain
from fakes import Port
from streaming import Process


@pytest.fixture(autouse=True)
def _leave_none() -> Iterator[None]:
    """Also where a test fails: of the processes that it made."""
    yield
    for process in [*Process.made]:
        process.kill()


@pytest.fixture
def port(tmp_path: Path) -> Iterator[Port]:
    made = Port(tmp_path / "probe")
    yield made
    made.vanish()


@pytest.fixture
def chain(tmp_path: Path) -> Iterator[Chain]:
    made = Chain(tmp_path)
    yield made
    made.close()


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chain]:
    """One for all tests of a file: to start it takes longer than most of them."""
    made = Chain(tmp_path_factory.mktemp("bench"))
    yield made
    made.close()


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A daemon with keys; its module takes time to load."""
    from guarded import Guarded

    made = Guarded(tmp_path_factory.mktemp("guarded"))
    yield made
    made.close()
