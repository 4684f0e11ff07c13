# SPDX-License-Identifier: MIT
"""Baranek's filter against his equations in doubles."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, ONE, Array, G
from core.doubles import (
    UPSIDE_DOWN,
    WILD_S,
    apart_from,
    matrix_of,
    quat_of,
    rms,
    run,
    skew,
    unit,
    wild,
)
from core.scenes import Attitude, at_rest, scene
from imud import rotation

pytestmark = pytest.mark.sampled(4)

# Counts of 8.75 mdps, and 100 of Ki's a second.
COUNT = 8.75e-3 * DEGREE
KP, KI = 500 * COUNT, 0.1 * 100 * COUNT


class Step:
    """A step that remembers its matrix and its controllers' sums."""

    def __init__(self, kp: float = KP, ki: float = KI) -> None:
        self.gains = kp, ki
        self.given: Any = None  # the quaternion that the matrix belongs to
        self.matrix = np.eye(3)
        self.sums = np.zeros(2)

    def __call__(
        self, quat: Array, rate: Array, force: Array, _: object, seconds: float
    ) -> Array:
        if quat is not self.given:
            self.matrix = matrix_of(quat)
        parts = math.ceil(round(seconds * 1e6) / 7500)
        offset = self.offset(force, seconds) if force.any() else np.zeros(3)
        for _part in range(parts):
            self.turn((rate - offset) * (int(seconds * 1e6) // parts) / 1e6)
        self.given = quat_of(self.matrix)
        return np.asarray(self.given)

    def forget(self) -> None:
        """What the controllers have learned is in the bias that becomes known."""
        self.sums = np.zeros(2)

    def offset(self, force: Array, seconds: float) -> Array:
        """Equations 12 to 16; the sum is one of Ki's products."""
        kp, ki = self.gains
        error = np.cross(self.matrix[2], unit(force))[:2]
        self.sums += ki * error * seconds
        scale = math.exp(-abs(G - float(np.linalg.norm(force))))
        return np.append(scale * (kp * error + self.sums), 0.0)

    def turn(self, angle: Array) -> None:
        """Equations 6 to 11."""
        matrix = self.matrix @ (np.eye(3) + skew(angle))
        x, y = matrix[:2]
        e = x @ y
        x, y = x - e / 2 * y, y - e / 2 * x
        rows = (x, y, np.cross(x, y))
        self.matrix = np.array([0.5 * (3 - row @ row) * row for row in rows])


@pytest.mark.long
@pytest.mark.parametrize(
    ("rate_hz", "start"),
    [
        (200, rotation.IDENTITY),
        (200, UPSIDE_DOWN),
        (100, UPSIDE_DOWN),
        (380, rotation.IDENTITY),
    ],
)
def test_fixed_point_is_within_0_002_degrees_of_doubles(rate_hz, start):
    felt = wild(rate_hz, WILD_S, 5, start=start)
    step = Step()
    apart, found = apart_from(felt, "dcm_pi", step, step.forget)
    # Most of it is how a matrix that is not quite orthonormal becomes a quaternion.
    assert rms(apart) < 0.002
    assert np.abs(desk.norms(found) / ONE - 1).max() < 1e-6


@pytest.mark.nightly
@pytest.mark.parametrize("gains", [{"kp": 0.9 * KP}, {"ki": 0}], ids=["Kp", "Ki"])
def test_the_comparison_would_see_another_gain(gains):
    felt = scene(at_rest(30), 200, seed=2, gyr_bias_deg_s=(0.5, -0.5, 0))
    fixed, _ = Attitude("dcm_pi").feel(felt)
    for step, is_near in ((Step(), True), (Step(**gains), False)):
        apart = desk.apart_deg(fixed, run(felt, step, {}))
        assert (rms(apart) < 0.01) == is_near


@pytest.mark.parametrize("roll", [0, 2], ids=["upright", "upside down"])
@pytest.mark.parametrize("heading", range(4))
def test_a_tilt_that_has_changed_unseen_is_levelled_in_100_seconds(roll, heading):
    start = rotation.from_heading_pitch_roll(heading * np.pi / 2, 0, roll * np.pi / 2)
    away = rotation.from_rotation_vector(np.array([0.3, -0.3, 0]))
    quat = np.vstack(
        [at_rest(1, 200, start), at_rest(99, 200, rotation.multiply(away, start))]
    )
    felt = scene(quat, 200, seed=1)
    felt.gyr[200] = 0
    found, _ = Attitude("dcm_pi").feel(felt)
    tilt = desk.tilt_deg(found, felt.quat)
    assert tilt[200] > 20
    # A loop of 13 s, critically damped: it goes too far by a seventh, once.
    assert 7 < tilt[200 + 13 * 200] < 9
    assert 3 < tilt[50 * 200 :].max() < 4
    assert tilt[-1] < 2


def test_an_offset_of_x_and_y_is_found_and_one_of_z_is_not():
    felt = scene(at_rest(120), 200, seed=3, gyr_bias_deg_s=(0.4, -0.3, 0.2))
    probe = Attitude("dcm_pi")
    found, _ = probe.feel(felt)
    sums = np.array([probe.c.dcm_pi.sum_x_rad_s, probe.c.dcm_pi.sum_y_rad_s])
    assert sums / ONE / DEGREE == pytest.approx([0.4, -0.3], abs=0.02)
    assert desk.tilt_deg(found, felt.quat)[-1] < 1
    assert desk.apart_deg(found, felt.quat)[-1] == pytest.approx(24, abs=1)


def test_an_accelerated_probe_is_not_levelled_by_it():
    felt = scene(at_rest(20), 200, noise=0)
    felt.acc[200:] += (5, 0, 5)
    found, _ = Attitude("dcm_pi").feel(felt)
    # exp(-|9.8 - 15.6|) of Kp.
    assert desk.tilt_deg(found, felt.quat).max() < 0.2


def test_without_a_force_the_gyroscope_turns_alone_and_without_time_nothing():
    felt = scene(at_rest(4), 200, noise=0)
    felt.acc[400:] = 0
    felt.gyr[400:, 2] = 90 * DEGREE
    intervals = felt.interval_us
    intervals[500:600] = 0
    found, _ = Attitude("dcm_pi").run(felt.measurements(), intervals)
    # 0.45 degrees a sample; a step to first order turns a little less.
    turned = desk.apart_deg(found[-1:], felt.quat[-1:])[0]
    assert turned == pytest.approx(300 * 0.45, abs=0.05)
    assert (found[500:600] == found[499]).all()


def test_heading_is_free_whatever_the_field_says():
    felt = scene(at_rest(10), 200, noise=0)
    felt.mag[1000:] = (30, 0, -40)
    found, quality = Attitude("dcm_pi").feel(felt)
    assert desk.apart_deg(found, felt.quat)[2:].max() < 0.01
    assert quality["is_heading_free"].all()
    assert not quality["is_mag_absent"][1:].any()


def test_the_rows_stay_orthonormal_under_the_fastest_turn_about_any_axis():
    random = np.random.default_rng(4)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    for axis in [*corners, *random.uniform(-1, 1, (30, 3))]:
        felt = scene(at_rest(3), 200, noise=0)
        felt.gyr[10:] = axis * 38 * (1 - 1e-9)
        felt.acc[10:] = np.cross(axis, (1, 2, 3)) * 50
        probe = Attitude("dcm_pi")
        # The bias as far as it goes the other way: 42 rad/s an axis.
        probe.set_bias(tuple(-np.sign(axis) * 4 / DEGREE))
        for interval_us in (7500, 50_000, 2**32 - 1):
            intervals = np.full(len(felt), interval_us, np.uint32)
            probe.run(felt.measurements(), intervals)
            rows = probe.c.dcm_pi.rows
            matrix = np.array([[row.x, row.y, row.z] for row in rows]) / ONE
            assert np.abs(matrix @ matrix.T - np.eye(3)).max() < 0.2
            assert np.abs(desk.norms(matrix)).max() < 1 + 1e-8
