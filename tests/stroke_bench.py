# SPDX-License-Identifier: MIT
"""A probe made of the firmware's C that feels strokes."""

from __future__ import annotations

import struct

from core.desk import Array, lib
from core.stroke_desk import Measured, measured
from fakes.records import record
from imud.virtual.stroking import Plan
from twin_bench import PERIOD_US, Life, followed

TIP = record(4, struct.pack("<3i3h", 120_000, -5_000, 0, -(2**14), 0, 0))
BY_BUTTON = record(5, bytes((lib.BUTTON_DOES_STROKE, lib.REFERENCE_NONE)))


def feel(life: Life, samples: Array, held: Array) -> Life:
    for row, is_held in zip(samples, held, strict=True):
        life.now_us += PERIOD_US
        life.sample(row)
        lib.probe_step(life.c, bool(is_held), life.time_us)
    return life


def stroking() -> tuple[Life, Measured]:
    """A probe that has a tip and strokes by its button, and what it will feel."""
    scene = measured(Plan(strokes=2), 7)
    life = followed().load(TIP + BY_BUTTON)
    return life, scene
