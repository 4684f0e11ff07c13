# SPDX-License-Identifier: MIT
"""The fixtures of several files of tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from chain import Chain


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
