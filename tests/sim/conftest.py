# SPDX-License-Identifier: MIT
"""Models of chips, for tests of which the file imports the model's desk."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def chip(request: pytest.FixtureRequest) -> Iterator[Any]:
    """A sensor, of the file's Chip; a host that keeps to the documents."""
    chip = request.module.Chip()
    yield chip
    assert chip.complaint() is None


@pytest.fixture
def fresh(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Any]:
    """A card that has just got power; a host that keeps to the document."""
    card = request.module.Card(tmp_path)
    yield card
    assert card.complaint() is None


@pytest.fixture(params=["SDSC", "SDHC"])
def card(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Any]:
    """An identified card of either kind; a host that keeps to the document."""
    make = request.module.Card
    card = make(tmp_path, blocks=2048, kind=make.KINDS[request.param]).identify()
    yield card
    assert card.complaint() is None


@pytest.fixture
def rude(request: pytest.FixtureRequest, tmp_path: Path) -> Any:
    """An identified card; the host does something against the document."""
    return request.module.Card(tmp_path, blocks=2048).identify()
