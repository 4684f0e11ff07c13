# SPDX-License-Identifier: MIT
"""Hands that draw strokes over and over, and may hold the button meanwhile."""

from __future__ import annotations

from collections.abc import Iterator

from imud.virtual.calibrating import felt_of
from imud.virtual.motion import Motion
from imud.virtual.motions.module import Module
from imud.virtual.sensors import World, random_of_hand
from imud.virtual.stroking import A4, CIRCLE, SWAYS, Plan, StrokingHand

# The emulator takes 64 presses; one of them starts the stream.
_TO_AND_FRO = Plan(
    seconds=1.5, turn_deg=2.0, strokes=60, corners=((0.0, 0.0), (0.2, 0.0))
)
# By the names of their hands.
PLANS = {
    "stroke": _TO_AND_FRO,
    "button": _TO_AND_FRO,
    "sheet": Plan(turn_deg=2.0, strokes=60, corners=A4),
    "circle": Plan(seconds=0.75, turn_deg=2.0, strokes=56, corners=CIRCLE),
    "paper": Plan(seconds=2.0, strokes=60, support="paper"),
    "free": Plan(seconds=2.0, strokes=60, support="air"),
}
WITHOUT_BUTTON = "stroke"
BEFORE_S, AFTER_S = 0.05, 0.05  # the button is held for so much longer than a stroke


def pieces(name: str, module: Module, seed: int, rate_hz: float) -> Iterator[Motion]:
    """The endless motion of that hand as a module measures it."""
    plan = PLANS[name]
    return felt_of(
        *(module, seed, rate_hz, World()),
        lambda random, hz: StrokingHand(random, hz, plan),
        SWAYS[plan.support],
    )


def presses_us(name: str, seed: int, rate_hz: float) -> Iterator[tuple[int, int]]:
    """From when to when the button is down, device time in us, stroke by stroke."""
    plan = PLANS[name]
    begun, found = 0, 0
    for move in StrokingHand(random_of_hand(seed), rate_hz, plan).moves():
        if move.is_stroke:
            start_s, end_s = begun / rate_hz, (begun + move.records) / rate_hz
            yield round((start_s - BEFORE_S) * 1e6), round((end_s + AFTER_S) * 1e6)
            found += 1
        if found == plan.strokes:
            return
        begun += move.records
