# SPDX-License-Identifier: MIT
"""Priors that a recording contradicts, and wider ones.

Where what carries the sensor moves faster than its prior allows, or the gyroscope's
bias changes faster, the estimate turns instead, which the gyroscope did not see. A
wider prior that leaves much less of such turning is believed. A sensor that is found
far from its calibration has a worse one than was said. A room adds to the noise of the
magnetometer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from imud import rotation
from imud.calibration.accelerometer import BAD
from imud.refine.model import (
    ACC_BIAS,
    GYR,
    MAG,
    OWN,
    SHOP,
    Priors,
    Recording,
    prior_of_whole,
)
from imud.refine.window import Before, Window

# Factors of speed, distance and the wander of the bias, from those of a hand: one whose
# gyroscope warms up, who walks and runs, a vehicle.
WIDE = ((1.0, 1.0, 10.0), (10.0, 30.0, 1.0), (100.0, 3000.0, 1.0))
UNSEEN = math.radians(0.008)  # rad/sqrt(s) rms: less is no more than a chip's noise
LESS = 2.0  # a wider prior has to explain so much more
CONTRADICTED, WIDER = 2.4, 3.0  # sigmas of a prior, and its factor then
FAR_DIE = 3.0  # sigmas of an accelerometer's bias by its data sheet
# Of an interval of the magnetometer, at least and at most, by residuals over BLOCK_S,
# and more of it, since the fit takes some of them for an error of the sensor.
NOISE_UT, BLOCK_S, LASTING = (1.5, 25.0), 8.0, 1.3

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
    runs = len(WIDE) + 2
    found: list[Window] = []

    def run(known: Priors, like: Window | None = None) -> Window:
        window = Window(recording, known, before, like)
        for _ in window.search():
            tell((len(found) + window.share_done) / runs)
        return window

    first = run(priors)
    is_unknown = before is None and priors.acc_bias >= SHOP.acc_bias
    if is_unknown and off_by(first, ACC_BIAS) > FAR_DIE:
        bias, scale, cross = BAD[::3].tolist()
        priors = replace(priors, acc_bias=bias, acc_scale=scale, acc_cross=cross)
        first = run(priors)
    found.append(first)
    for speed, place, wander in WIDE:
        if unseen_of(found[-1]) < UNSEEN:
            break
        wide = replace(
            priors,
            speed=priors.speed * speed,
            place=priors.place * place,
            bias_wander=priors.bias_wander * wander,
        )
        found.append(run(wide, first))
    least = min(map(unseen_of, found))
    best = next(each for each in found if unseen_of(each) < LESS * least)
    if before is None and off_by(best, GYR) > CONTRADICTED:
        known = best.priors
        scale, cross = WIDER * known.gyr_scale, WIDER * known.gyr_cross
        best = run(replace(known, gyr_scale=scale, gyr_cross=cross), first)
    return best


def settled(window: Window) -> Window:
    """The same with the magnetometer's noise that it shows."""
    noise = float(np.clip(lasting_ut(window), *NOISE_UT))
    found = Window(
        window.recording,
        replace(window.priors, mag_noise=noise),
        window.before,
        like=window,
    )
    for _ in found.search():
        pass
    return found


def lasting_ut(window: Window) -> float:
    """The white noise of an interval that would leave means over BLOCK_S as those of
    the residuals in one field: a room's last, in the world or in the body.
    """
    recording, estimate = window.recording, window.estimate
    intervals = window.intervals(slice(0, recording.count))
    turns = rotation.to_matrix(intervals.late)
    field = turns.transpose(0, 2, 1) @ estimate.mean_field
    own = np.repeat(intervals.now[:, OWN], recording.each, axis=0)
    left = np.nan_to_num(recording.mag) - field @ estimate.matrix(MAG).T - own
    most = 0.0
    for rows in (left, (turns @ left[..., None])[..., 0]):
        means = intervals.mean_read(rows)[intervals.read > 0]
        for size in (1, round(BLOCK_S / recording.node_s)):
            blocks = means[: len(means) // size * size].reshape(-1, size, 3)
            if len(blocks):
                square = (blocks.mean(axis=1) ** 2).mean()
                most = max(most, math.sqrt(size * float(square)))
    return LASTING * most


def off_by(window: Window, of: slice) -> float:
    """The largest of these parameters, in sigmas of its prior."""
    away, sigma = prior_of_whole(window.estimate.whole, window.priors)
    return float(np.abs(away[of] / sigma[of]).max())


def unseen_of(window: Window) -> float:
    """Turning that the gyroscope did not see, rad/sqrt(s) rms of an axis."""
    square = float((window.estimate.unseen**2).mean())
    return math.sqrt(square / window.recording.node_s)
