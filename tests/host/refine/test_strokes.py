# SPDX-License-Identifier: MIT
"""A displacement between two rests: measured within what is stated, or not at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from host.refine.made import RATE_HZ, made
from imud import rotation
from imud.refine.model import CALIBRATED, Recording
from imud.refine.strokes import Moved, moved
from imud.refine.whole import parts_of
from imud.rotation import FloatArray

WAY_M = np.array([0.12, -0.05, 0.03])
BEGIN, END = 14.0, 15.5  # s
PIECE = round((BEGIN - 0.1) * RATE_HZ), round((END + 0.1) * RATE_HZ)


def still(sway_m: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Accelerations of a stroke within a rest, as in a hand that sways, and its way."""
    at_s = (np.arange(round(30.0 * RATE_HZ)) + 0.5) / RATE_HZ
    share = np.clip((at_s - BEGIN) / (END - BEGIN), 0.0, 1.0)
    curve = 60.0 * share - 180.0 * share**2 + 120.0 * share**3  # of least jerk
    found = curve[:, None] * WAY_M / (END - BEGIN) ** 2
    turn = 2.0 * np.pi * 0.6
    for axis in range(3):
        found[:, axis] -= sway_m * turn**2 * np.sin(turn * at_s + axis)
    ends = sway_m * np.sin(turn * np.array([[BEGIN], [END]]) + np.arange(3))
    return found, WAY_M + ends[1] - ends[0]


def stroked(sway_m: float = 0.0) -> tuple[Recording, FloatArray]:
    """A recording that turns before and after a stroke, and the stroke's way."""
    recording, truth = made(30.0, still_s=(8.0, 21.0))
    force, way = still(sway_m)
    at_s = np.arange(len(force)) / RATE_HZ
    force[(at_s < 8.0) | (at_s > 21.0)] = 0.0
    acc = recording.acc + rotation.rotate(rotation.inverse(truth), force)
    return replace(recording, acc=acc), way


def measured(recording: Recording, free: tuple[int, int] = (0, 10**9)) -> Moved | None:
    ((part, window),) = parts_of(recording, CALIBRATED)
    assert window is not None
    return moved(window, part.quats, PIECE, free)


@pytest.mark.parametrize("sway_m", [0.0, 0.0005])
def test_a_stroke_is_measured_within_its_stated_error(sway_m: float) -> None:
    recording, way = stroked(sway_m)
    found = measured(recording)
    assert found is not None
    off = found.way - way
    assert np.linalg.norm(off) < 0.006
    assert (np.abs(off) < 3.0 * found.sigma).all()
    assert found.sigma.max() < 0.006


def test_without_a_rest_nothing_is_measured() -> None:
    begin, end = PIECE
    for free in ((begin - 5, 10**9), (0, end + 5)):
        assert measured(stroked()[0], free) is None
