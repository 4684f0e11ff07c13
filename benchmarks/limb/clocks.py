# SPDX-License-Identifier: MIT
"""The clocks of several probes: each drifts, and the daemon dates its messages."""

from __future__ import annotations

import numpy as np

from imud.probes.clock import ProbeClock
from imud.rotation import FloatArray

RATE_PPM = 3000.0  # of a Nano's ceramic resonator, at most
DRIFT_PPM_S = 0.5  # as it warms up
START_S = 20.0  # for which the probes were connected before
LATE_S = (0.5e-3, 2e-3)  # a message: at least, and the mean of what adds to it
STALL_S, STALLS = 16e-3, 0.02  # a USB adapter or a busy host; share of messages
ANSWER_S = 1.0  # between requests for the probe's time


def dated(times_s: FloatArray, random: np.random.Generator) -> FloatArray:
    """The times that the daemon gives to samples of these true times, at once."""
    step = float(np.median(np.diff(times_s)))
    before = times_s[0] - step * np.arange(round(START_S / step), 0, -1)
    true = np.concatenate([before, times_s])
    since = true - true[0] + 1.0
    rate = random.uniform(-RATE_PPM, RATE_PPM) * 1e-6
    drift = random.uniform(-DRIFT_PPM_S, DRIFT_PPM_S) * 1e-6
    device_us = np.floor(1e6 * (since * (1.0 + rate) + 0.5 * drift * since**2))
    late = LATE_S[0] + random.exponential(LATE_S[1], len(true))
    late += (random.random(len(true)) < STALLS) * random.uniform(0, STALL_S, len(true))
    came = np.maximum.accumulate(since + late)
    clock = ProbeClock()
    found = np.empty(len(true))
    asked = 0.0
    for index, (at_us, came_s) in enumerate(
        zip(device_us.astype(int).tolist(), came.tolist(), strict=True)
    ):
        clock.arrived(at_us, round(came_s * 1e9))
        if since[index] - asked > ANSWER_S:
            asked = float(since[index])
            sent = asked - LATE_S[0] - random.exponential(LATE_S[1])
            clock.heard(at_us, round(sent * 1e9))
        found[index] = clock.moment(at_us).host_ns * 1e-9
    return np.asarray((found - 1.0 + true[0])[len(before) :])


def apart(true_s: list[FloatArray], given_s: list[FloatArray]) -> float:
    """The 99th percentile of the time between probes after joining, s."""
    times = np.linspace(max(t[0] for t in true_s), min(t[-1] for t in true_s), 5000)
    off = [
        np.interp(times, true, given - true)
        for true, given in zip(true_s, given_s, strict=True)
    ]
    between = np.ptp(np.stack(off), axis=0)
    return float(np.percentile(between, 99))
