# SPDX-License-Identifier: MIT
"""The hands of `imud sim --hand`, by name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from imud.virtual import (
    calibrating,
    checking,
    dimpling,
    following,
    measuring,
    turning,
)
from imud.virtual.motion import Motion
from imud.virtual.motions.module import Module


def pieces_of(
    name: str,
    module: Module,
    seed: int,
    rate_hz: float,
    page: str = "",
    port: Path | None = None,
) -> Iterator[Motion]:
    """The endless motion of a hand as a module measures it. `page`: the address of the
    one that asks a hand which follows; `port`: that of its probe.
    """
    if name in following.NAMES:
        return following.pieces(name, module, seed, rate_hz, page, port)
    if name in measuring.PLANS:
        return measuring.pieces(name, module, seed, rate_hz)
    if name in dimpling.WOBBLES:
        return dimpling.pieces(name, module, seed, rate_hz)
    if name == checking.NAME:
        return checking.pieces(module, seed, rate_hz)
    if name in turning.AXES:
        return turning.pieces(name, module, seed, rate_hz)
    return calibrating.pieces(name, module, seed, rate_hz)
