# SPDX-License-Identifier: MIT
"""A hand that does what `imud check` asks for: it leaves the probe base down, then lays
it on its left side and on its back, and presses its button, over and over.
"""

from __future__ import annotations

from collections.abc import Iterator

from imud.check.axes import ASKED
from imud.rotation import FloatArray
from imud.virtual.calibrating import PROBE, CalibratingHand, Manners, felt_of
from imud.virtual.motion import Motion
from imud.virtual.motions.module import Module

NAME = "check"

# How long it lies in the first pose: time to start imud and to measure. And in
# each of the others.
FIRST_S, EACH_S = 50.0, 12.0

PRESS_S = 0.3
PRESSES = 30  # after that it does not press any more


def pieces(module: Module, seed: int, rate_hz: float) -> Iterator[Motion]:
    """The endless motion as a module measures it."""
    manners = Manners(stop_s=FIRST_S)

    def ups() -> Iterator[FloatArray | None]:
        while True:
            for pose in ASKED:
                manners.stop_s = FIRST_S if pose is ASKED[0] else EACH_S
                yield pose.up

    return felt_of(
        *(module, seed, rate_hz, PROBE),
        lambda random, hz: CalibratingHand(random, hz, ups(), manners),
    )


def presses_us() -> Iterator[tuple[int, int]]:
    """When the button is down: in the middle of each last pose."""
    poses = len(ASKED)
    round_s = FIRST_S + (poses - 1) * EACH_S + poses * Manners().move_s
    last_s = round_s - Manners().move_s - EACH_S / 2.0
    for number in range(PRESSES):
        at_s = number * round_s + last_s
        yield round(at_s * 1e6), round((at_s + PRESS_S) * 1e6)
