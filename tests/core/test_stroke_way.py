# SPDX-License-Identifier: MIT
"""The closed form in fixed point: as in doubles, and within its bounds whatever is
felt."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from core import stroke_twin
from core.desk import Array, G, ffi, lib
from core.stroke_desk import MICRO, SIGMA
from imud import rotation

Q15 = 2.0**15
Q30 = 2.0**30
ACC, GYR = 0.01, 0.0007  # sigmas of a calibrated module, m/s2 and a fraction
IDENTITY = ffi.new("struct quat *", (2**30, 0, 0, 0))


class Windows:
    """A `struct stroke` that strokes by its button, fed with windows."""

    def __init__(self, period_us: int = 100_000) -> None:
        self.c = ffi.new("struct stroke *")
        lib.stroke_begin(self.c, round(ACC * 1e4), round(GYR * 1e5))
        lib.stroke_by_button(self.c, True)
        self.period_us = period_us
        self.time_us = 2**32 - 700_000  # wraps halfway

    def feel(
        self, force: Array, gained: Array, body: Array | None = None, **more: Any
    ) -> bool:
        """Take a window of these forces, m/s2; `body`: inertial_from_body."""
        self.time_us = (self.time_us + self.period_us) % 2**32
        window = ffi.new("struct stroke_window *")
        for target, rows in (
            (window.force.mean_q15, force),
            (window.force.gained_q15, gained),
        ):
            target.axis = [round(each * Q15) for each in rows]
        quat = ffi.new("struct quat *", (2**30, 0, 0, 0))
        if body is not None:
            quat.w, quat.x, quat.y, quat.z = (round(each * 2**30) for each in body)
        window.time_us = self.time_us
        window.is_settled = True
        window.inertial_from_body = quat
        window.world_from_inertial = IDENTITY
        for name, value in more.items():
            setattr(window, name, value)
        tells = bool(lib.stroke_step(self.c, window))
        if tells:
            lib.stroke_state(self.c)
        return tells


def a_stroke(
    random: np.random.Generator, count: int, noise: float
) -> tuple[Array, Array]:
    """Forces of windows: 10 of rest, some of a stroke of 10 cm, 3 of rest."""
    fine = 40
    u = (np.arange(count * fine) + 0.5) / (count * fine)
    span = count * stroke_twin.WINDOW_S
    course = (60 * u - 180 * u**2 + 120 * u**3) / span**2
    way = random.standard_normal(3)
    way *= 0.1 / np.linalg.norm(way)
    force = np.tile([0.01, -0.02, G], ((count + 13) * fine, 1))
    force[10 * fine : -3 * fine] += course[:, None] * way
    parts = force.reshape(-1, fine, 3)
    mean = parts.mean(axis=1)
    gained = 2 * (np.cumsum(parts, axis=1).mean(axis=1) - mean / 2) / fine
    shift = noise * random.standard_normal((2, len(mean), 3))
    return mean + shift[0], gained + shift[0] + shift[1]


@pytest.mark.parametrize("seed", range(12))
def test_fixed_point_is_within_a_tenth_of_a_millimetre_of_doubles(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(6, 31))
    force, gained = a_stroke(random, count, 0.004)
    force, gained = (np.round(rows * Q15) / Q15 for rows in (force, gained))
    angle = random.uniform(0.0, 0.5)
    axis = random.standard_normal(3)
    turn = rotation.from_rotation_vector(axis / np.linalg.norm(axis) * angle)
    windows = Windows()
    rate = float(random.choice([0.0, math.radians(1.2)]))  # about all axes
    turn_q15 = ffi.new("struct vector *", {"axis": [int(rate * Q15 + 0.5), 0, 0]})[0]
    for index in range(len(force)):
        # The window of a press belongs to the stroke, that of a release does not. So
        # does neither the first nor the last of the others if nothing moves in it.
        if index == 10:
            lib.stroke_hold(windows.c, True)
        if index == count + 10:
            lib.stroke_hold(windows.c, False)
        body = turn if index > 14 else None
        windows.feel(force[index], gained[index], body, turn_q15=turn_q15)
    stroke = windows.c
    assert stroke.end == lib.STROKE_END_BUTTON
    before = stroke_twin.rest_of(force[:10])
    noise, quiet = stroke.noise_q30 / Q30, stroke.quiet_q30 / Q30
    sway, ends = stroke.sway_q30 / Q30, (stroke.began_q30 / Q30 + rate**2) / 2
    first = 11 if stroke_twin.is_calm(force[10], before, noise) else 10
    rest = stroke_twin.late_mean(force)
    left_out = int(stroke_twin.is_calm(force[count + 9], rest, noise))
    assert stroke.windows == count + 10 - first - left_out
    twin = stroke_twin.closed(
        stroke_twin.rest_of(force[:first]),
        *(force[first - 1 :], gained[first - 1 :], angle),
        stroke_twin.Known(ACC, GYR, noise, min(noise, quiet), sway, ends),
        left_out=left_out,
    )
    found = np.array([stroke.moved_um.x, stroke.moved_um.y, stroke.moved_um.z]) * MICRO
    assert np.abs(found - twin.moved).max() < 1e-4
    assert stroke.sigma.horizontal * SIGMA == pytest.approx(twin.horizontal, rel=0.03)
    assert stroke.sigma.vertical * SIGMA == pytest.approx(twin.vertical, rel=0.03)


def test_a_slow_clock_makes_a_stroke_longer_by_the_square_of_its_time() -> None:
    force, gained = a_stroke(np.random.default_rng(1), 10, 0.0)
    lengths = []
    for period_us in (100_000, 102_000):
        windows = Windows(period_us)
        for index in range(len(force)):
            if index in (10, 20):
                lib.stroke_hold(windows.c, index == 10)
            windows.feel(force[index], gained[index])
        moved = windows.c.moved_um
        lengths.append(np.linalg.norm([moved.x, moved.y, moved.z]))
    assert lengths[1] / lengths[0] == pytest.approx(1.02**2, rel=1e-4)


@pytest.mark.parametrize("is_by_button", [False, True])
def test_nothing_that_windows_can_be_overflows(is_by_button: bool) -> None:
    random = np.random.default_rng(5)
    windows = Windows()
    lib.stroke_by_button(windows.c, is_by_button)
    seen = set()
    for _ in range(120):
        wild = random.choice([0.0, 0.01, 0.3, 3.0, 40.0, 480.0])
        for _ in range(int(random.integers(1, 60))):
            force = np.clip(np.array([0, 0, G]) + random.normal(0, wild, 3), -480, 480)
            if random.random() < 0.05:
                lib.stroke_hold(windows.c, bool(random.random() < 0.5))
            quat = random.standard_normal(4)
            fault = random.choice([0, lib.STROKE_END_CLIPPED], p=[0.99, 0.01])
            strokes = windows.feel(
                force,
                np.clip(2 * force + random.normal(0, wild, 3), -960, 960),
                quat / np.linalg.norm(quat) if random.random() < 0.3 else None,
                fault=int(fault),
                bias_variance=int(random.integers(1, 2**23)),
            )
            if strokes:
                seen.add(int(windows.c.end))
    assert {lib.STROKE_END_RUNNING, lib.STROKE_END_TOO_FAST} <= seen
    assert lib.STROKE_END_CLIPPED in seen
