# SPDX-License-Identifier: MIT
"""The filter learns bias, scales, lag and the probe's own field."""

from __future__ import annotations

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, FIELD, ONE
from core.fuse_desk import LEVEL, centred, rms
from core.scenes import Filter, at_rest, scene, tumble
from imud import rotation


def test_at_rest_a_bias_is_learned():
    bias = (1.0, -1.5, 0.8)
    felt = scene(at_rest(10), 200, gyr_bias_deg_s=bias)
    probe = centred(200)
    found, _, quality = probe.feel(felt)
    assert np.abs(probe.bias_deg_s - bias).max() < 0.02
    rest = quality["is_at_rest"]
    assert not rest[:298].any()
    assert rest[400:].all()
    assert desk.tilt_deg(found, felt.quat)[-1] < 0.5


def test_a_turn_of_2_degrees_a_second_that_the_field_denies_is_a_bias():
    felt = scene(at_rest(60), 200, gyr_bias_deg_s=(0, 0, 2.2))
    probe = centred(200)
    assert not probe.feel(felt[:2000])[2]["is_at_rest"].any()
    assert probe.bias_deg_s[:2] == pytest.approx([0, 0], abs=0.05)
    assert 0.1 < probe.bias_deg_s[2] < 1
    probe.feel(felt[2000:])
    assert probe.bias_deg_s == pytest.approx([0, 0, 2.2], abs=0.25)


def test_a_calibrated_bias_is_followed_at_rest_by_2_degrees_a_second():
    for bias, is_rest in ((6.5, True), (7.5, False)):
        probe = centred(200)
        probe.set_bias((0, 5.0, 0))
        quality = probe.feel(scene(at_rest(60), 200, gyr_bias_deg_s=(0, bias, 0)))[2]
        assert quality["is_at_rest"][1000:].all() == is_rest
        if is_rest:
            assert probe.bias_deg_s[1] == pytest.approx(bias, abs=0.02)
        else:  # levelling tells of it, slowly
            assert 5.02 < probe.bias_deg_s[1] < 6


def turning(seconds: float, rate_hz: int, seed: int) -> desk.Array:
    """Moderate turns about changing axes from the first sample on, without a rest."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    quat = np.tile(LEVEL, (len(t), 1))
    for _ in range(4):
        axis = random.standard_normal(3)
        angle = random.uniform(0.4, 1.2) * np.sin(
            2 * np.pi * random.uniform(0.1, 0.6) * t + random.uniform(0, 6)
        )
        part = rotation.from_rotation_vector(
            angle[:, None] * axis / np.linalg.norm(axis)
        )
        quat = rotation.multiply(quat, part)
    return quat


def test_a_bias_is_learned_from_motion_where_no_rest_has_told_it():
    bias = (0.6, -0.5, 0.4)
    felt = scene(turning(120, 200, 2), 200, seed=4, gyr_bias_deg_s=bias)
    probe = centred(200)
    found, _, quality = probe.feel(felt)
    assert not quality["is_at_rest"].any()
    # About the vertical it shows only where the probe is tilted.
    assert np.abs(probe.bias_deg_s - bias).max() < 0.3
    assert np.abs(probe.bias_deg_s - bias)[:2].max() < 0.1
    assert rms(desk.tilt_deg(found, felt.quat)[4000:]) < 0.5


@pytest.mark.sampled(2)
@pytest.mark.parametrize("scales", [(1.004, 1.004, 1.004), (1.03, 0.98, 1.01)])
def test_the_scales_of_the_gyroscope_are_learned_from_motion(scales):
    felt = scene(tumble(180, 200, 6), 200, seed=4)
    felt.gyr *= scales
    probe = centred(200)
    probe.set_bias((0, 0, 0))
    probe.feel(felt)
    found = np.array(list(probe.c.state.scale)) / ONE
    assert found == pytest.approx(1 / np.array(scales) - 1, abs=0.0025)


def test_the_scale_about_the_vertical_is_learned_from_the_field():
    t = np.arange(60 * 200) / 200
    angle = np.maximum(t - 5, 0) * 90 * DEGREE
    about_z = rotation.from_rotation_vector(angle[:, None] * np.array([0.0, 0.0, 1.0]))
    felt = scene(rotation.multiply(about_z, np.tile(LEVEL, (len(t), 1))), 200, seed=3)
    felt.gyr *= 1.02
    probe = centred(200)
    probe.set_bias((0, 0, 0))
    found, _, _ = probe.feel(felt)
    assert probe.c.state.scale[2] / ONE == pytest.approx(1 / 1.02 - 1, abs=0.002)
    assert rms(desk.heading_deg(found, felt.quat)[-4000:]) < 2.5


def test_without_readings_what_the_gyroscope_tells_of_the_heading_stays_possible():
    t = np.arange(90 * 200) / 200
    angle = np.maximum(t - 5, 0) * 90 * DEGREE
    about_z = rotation.from_rotation_vector(angle[:, None] * np.array([0.0, 0.0, 1.0]))
    felt = scene(rotation.multiply(about_z, np.tile(LEVEL, (len(t), 1))), 200, seed=3)
    felt.has_mag[2000:] = False
    probe = centred(200)
    probe.set_bias((0, 0, 0))
    probe.feel(felt)
    pairs = list(probe.c.state.motion_covariance)
    variances = [pairs[desk.lib.kalman_variance(state)] for state in range(7)]
    assert variances[6] == 25 * 2**21  # (20 deg)^2: no more is said of it
    for shared, variance in zip(pairs[21:27], variances[:6], strict=True):
        assert abs(shared) <= np.sqrt(float(variance) * variances[6])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("behind", [0, 1, 2, 4])
def test_the_lag_of_the_field_is_learned_from_motion(behind):
    felt = scene(tumble(120, 200, 9), 200, seed=8)
    felt.mag = np.roll(felt.mag, behind, axis=0)
    probe = centred(200)
    probe.set_bias((0, 0, 0))
    assert probe.c.state.lag_s_q35 / 2**35 == pytest.approx(0.005, abs=1e-6)
    probe.feel(felt)
    assert probe.c.state.lag_s_q35 / 2**35 == pytest.approx(0.005 * behind, abs=0.0015)


def test_a_lag_is_not_learned_at_rest():
    probe = centred(200)
    probe.feel(scene(at_rest(60), 200, seed=8))
    assert probe.c.state.lag_s_q35 / 2**35 == pytest.approx(0.005, abs=0.0005)


def own_field_ut(probe: Filter) -> desk.Array:
    return np.array(list(probe.c.state.field_ut)[3:]) / FIELD


@pytest.mark.parametrize("own_ut", [(2.0, -1.5, 1.0), (0.0, 0.0, 25.0)])
def test_the_probes_own_field_is_learned_once_it_turns(own_ut):
    felt = scene(turning(180, 200, 3), 200, seed=5)
    felt.gyr[:1000] = 0  # 5 s of rest
    still = scene(at_rest(5, 200, felt.quat[0]), 200, seed=6)
    for part in (still, felt):
        part.mag = part.mag + np.array(own_ut)
    probe = centred(200)
    probe.set_bias((0, 0, 0))
    probe.feel(still)
    assert np.abs(own_field_ut(probe)).max() < 0.2  # at rest nothing tells it
    found, _, quality = probe.feel(felt[1000:])
    # That there is none is a reading, too, as long as it seems small.
    assert np.abs(own_field_ut(probe) - own_ut).max() < 0.8
    assert rms(desk.heading_deg(found, felt.quat[1000:])[-8000:]) < 3
    assert not quality["is_mag_disturbed"][-2000:].any()


def test_an_absurd_bias_is_held_within_3_4_rad_a_second():
    probe = centred(200)
    probe.set_bias((-1700, 1700, 100))
    limit = 3.4 / DEGREE
    assert probe.bias_deg_s == pytest.approx([-limit, limit, 100])


def test_a_drift_of_the_level_tells_of_no_bias_about_the_vertical():
    probe = centred(200)
    probe.feel(scene(at_rest(1), 200))  # level, and not yet known to rest
    before, sure = probe.bias_deg_s, list(probe.c.state.motion_covariance)
    drift = desk.ffi.new("struct vector *", {"x": 2000, "y": 1000, "z": 0})
    for axis in range(2):
        desk.lib.fuse_learn_drift(probe.c, axis, drift, 1000, 40)
    changed = np.abs(probe.bias_deg_s - before)
    assert changed[:2].max() > 0.05
    assert changed[2] < 0.001
    vertical = desk.lib.kalman_variance(2)
    after = probe.c.state.motion_covariance[vertical]
    assert after == pytest.approx(sure[vertical], rel=1e-3)
