# SPDX-License-Identifier: MIT
"""The hands of `imud sim --hand`, by name."""

from __future__ import annotations

from collections.abc import Iterator

from imud.virtual import calibrating, checking, dimpling, measuring
from imud.virtual.motion import Motion
from imud.virtual.motions.module import Module


def pieces_of(name: str, module: Module, seed: int, rate_hz: float) -> Iterator[Motion]:
    """The endless motion of a hand as a module measures it."""
    if name in measuring.PLANS:
        return measuring.pieces(name, module, seed, rate_hz)
    if name in dimpling.WOBBLES:
        return dimpling.pieces(name, module, seed, rate_hz)
    if name == checking.NAME:
        return checking.pieces(module, seed, rate_hz)
    return calibrating.pieces(name, module, seed, rate_hz)
