# SPDX-License-Identifier: MIT
"""Models of chips. The test file imports Chip or Card from the desk of its model."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def chip(request: pytest.FixtureRequest) -> Iterator[Any]:
    """A sensor. Fails a test that used it against the documents."""
    chip = request.module.Chip()
    yield chip
    assert chip.complaint() is None


@pytest.fixture
def fresh(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Any]:
    """A card after power-on. Fails a test that used it against the document."""
    card = request.module.Card(tmp_path)
    yield card
    assert card.complaint() is None


@pytest.fixture(params=["SDSC", "SDHC"])
def card(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Any]:
    """An identified card of each kind. Fails a test that broke the document's rules."""
    make = request.module.Card
    card = make(tmp_path, blocks=2048, kind=make.KINDS[request.param]).identify()
    yield card
    assert card.complaint() is None


@pytest.fixture
def rude(request: pytest.FixtureRequest, tmp_path: Path) -> Any:
    """An identified card, for tests that break the document's rules."""
    return request.module.Card(tmp_path, blocks=2048).identify()
