# SPDX-License-Identifier: MIT
"""Priors that a recording contradicts, and wider ones.

Where what carries the sensor moves faster than its prior allows, or the gyroscope's
bias changes faster, the estimate turns instead, which the gyroscope did not see. A
wider prior that leaves much less of such turning is believed. A gyroscope that is found
far from its calibration has a worse one than was said.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from imud.refine.model import GYR, Priors, Recording, prior_of_whole
from imud.refine.window import Before, Window

# Factors of speed and of distance: a hand, who walks and runs, a vehicle.
# Factors of speed, distance and the wander of the bias: a hand, one whose gyroscope
# warms up, who walks and runs, a vehicle.
WIDE = ((1.0, 1.0, 1.0), (1.0, 1.0, 10.0), (10.0, 30.0, 1.0), (100.0, 3000.0, 1.0))
UNSEEN = math.radians(0.008)  # rad/sqrt(s) rms: less is no more than a chip's noise
LESS = 2.0  # a wider prior has to explain so much more
CONTRADICTED, WIDER = 2.4, 3.0  # sigmas of a prior, and its factor then

Told = Callable[[float], None]


def searched(
    recording: Recording,
    priors: Priors,
    before: Before | None = None,
    tell: Told = lambda _: None,
) -> Window:
    """The estimate with the narrowest priors that explain what was felt. `tell` is told
    the share that is done.
    """
    runs = len(WIDE) + 1
    found: list[Window] = []

    def run(known: Priors) -> Window:
        window = Window(recording, known, before, found[0] if found else None)
        for _ in window.search():
            tell((len(found) + window.share_done) / runs)
        return window

    for speed, place, wander in WIDE:
        wide = replace(
            priors,
            speed=priors.speed * speed,
            place=priors.place * place,
            bias_wander=priors.bias_wander * wander,
        )
        found.append(run(wide))
        if unseen_of(found[-1]) < UNSEEN:
            break
    least = min(map(unseen_of, found))
    best = next(each for each in found if unseen_of(each) < LESS * least)
    if before is None and off_by(best, GYR) > CONTRADICTED:
        known = best.priors
        scale, cross = WIDER * known.gyr_scale, WIDER * known.gyr_cross
        best = run(replace(known, gyr_scale=scale, gyr_cross=cross))
    return best


def off_by(window: Window, of: slice) -> float:
    """The largest of these parameters, in sigmas of its prior."""
    away, sigma = prior_of_whole(window.estimate.whole, window.priors)
    return float(np.abs(away[of] / sigma[of]).max())


def unseen_of(window: Window) -> float:
    """Turning that the gyroscope did not see, rad/sqrt(s) rms of an axis."""
    square = float((window.estimate.unseen**2).mean())
    return math.sqrt(square / window.recording.node_s)
