# SPDX-License-Identifier: MIT
"""The virtual boards that tests ask for."""

from __future__ import annotations

from pathlib import Path


def test_a_board_is_looked_for_when_it_is_asked_for(
    boards: dict[str, tuple[Path, Path]],
) -> None:
    fresh = type(boards)()
    simulator, image = fresh["nano"]
    assert (simulator.name, image.parent.name) == ("nano", "nano")
    assert list(fresh) == ["nano"]
