# SPDX-License-Identifier: MIT
"""Common behaviour of the filters of the papers: how they start and restart, and what
they do without a force, without a field and with one that tells no north."""

from __future__ import annotations

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, lib
from core.doubles import UPSIDE_DOWN
from core.scenes import Attitude, at_rest, scene
from core.test_attitude import of_papers
from core.test_fuse import STARTS
from imud import rotation

NOT_KNOWN = 2**16 - 1

# test_complementary.py has these of the complementary filter.
all_but_complementary = pytest.mark.parametrize(
    "name", ["mahony", "madgwick", "dcm_pi"]
)


@of_papers
def test_a_papers_filter_knows_no_sigma_rest_nor_disturbance(name):
    _, quality = Attitude(name).feel(scene(at_rest(8), 200))
    assert (quality["tilt_sigma_cdeg"] == NOT_KNOWN).all()
    assert (quality["heading_sigma_cdeg"] == NOT_KNOWN).all()
    assert not quality["is_at_rest"].any()
    assert not quality["is_mag_disturbed"].any()
    assert quality["is_starting"].tolist() == [True] * 599 + [False] * 1001


@of_papers
def test_a_field_that_stays_away_for_a_second_is_absent_and_heading_free(name):
    felt = scene(at_rest(8), 200)
    felt.has_mag[600:1200] = False
    _, quality = Attitude(name).feel(felt)
    absent = np.flatnonzero(quality["is_mag_absent"]).tolist()
    # The last reading was the 600th sample's.
    assert absent == [0, *range(799, 1201)]
    if name != "dcm_pi":
        assert np.array_equal(quality["is_heading_free"], quality["is_mag_absent"])


@of_papers
def test_a_magnetometer_that_reads_nothing_is_as_good_as_absent(name):
    felt = scene(at_rest(3), 200, noise=0)
    felt.mag[:] = 0
    found, quality = Attitude(name).feel(felt)
    assert quality["is_mag_absent"].all()
    assert desk.tilt_deg(found, felt.quat).max() < 0.05


@of_papers
def test_a_restart_forgets_the_orientation_and_keeps_the_bias(name):
    bias = (3.0, -2.0, 1.0)
    felt = scene(at_rest(4), 200, seed=1, gyr_bias_deg_s=bias)
    over = rotation.from_rotation_vector(np.array([0.0, 0.5, 1.0]))
    turned = scene(at_rest(4, quat=over), 200, seed=2, gyr_bias_deg_s=bias)
    probe, fresh = Attitude(name), Attitude(name)
    for one in (probe, fresh):
        one.set_bias(bias)
    probe.feel(felt)
    lib.attitude_restart(probe.c)
    found, quality = probe.feel(turned)
    assert quality["is_starting"][0]
    # dcm_pi's controllers have learned what was left of the bias.
    wanted, _ = fresh.feel(turned)
    assert desk.apart_deg(found, wanted).max() < (0.2 if name == "dcm_pi" else 1e-9)
    assert desk.apart_deg(found, turned.quat)[200:].max() < 8


@of_papers
def test_a_late_field_turns_the_heading_at_once_and_tilts_nothing(name):
    turned = rotation.from_heading_pitch_roll(-2.0, 0.3, 0.0)
    felt = scene(at_rest(4, quat=turned), 200, noise=0)
    felt.has_mag[:401] = False
    found, _ = Attitude(name).feel(felt)
    assert desk.apart_deg(found, felt.quat)[:401].min() > 50
    assert desk.apart_deg(found, felt.quat)[401:].max() < 0.1
    assert desk.tilt_deg(found, felt.quat).max() < 0.1


@all_but_complementary
def test_a_field_along_the_vertical_tells_no_north_and_holds_nothing_up(name):
    felt = scene(at_rest(4), 200, noise=0)
    felt.mag[:400] = (0.3, 0, -50)
    felt.gyr[10:110, 2] = 90 * DEGREE
    found, _ = Attitude(name).feel(felt)
    # 45 degrees were turned by the gyroscope, all of them.
    turned = desk.apart_deg(found[9:10], found[399:400])[0]
    assert turned == pytest.approx(45, abs=1)
    assert desk.apart_deg(found, felt.quat)[-1] < 0.5


@all_but_complementary
def test_a_probe_that_starts_in_free_fall_levels_once_it_is_caught(name):
    felt = scene(at_rest(4, quat=UPSIDE_DOWN), 200, noise=0)
    felt.acc[:400] = 0
    found, _ = Attitude(name).feel(felt)
    assert np.abs(found[:400] - [2**30, 0, 0, 0]).max() < 100
    assert desk.apart_deg(found, felt.quat)[402:].max() < 0.1


@pytest.mark.parametrize(
    ("name", "after_1_s_deg"), [("mahony", 1), ("madgwick", 2), ("dcm_pi", 5)]
)
@pytest.mark.parametrize("start", STARTS, ids=lambda q: str(np.round(q, 2)))
def test_from_any_start_the_attitude_is_known_at_once(name, after_1_s_deg, start):
    felt = scene(at_rest(5, 200, start), 200, seed=1)
    found, _ = Attitude(name).feel(felt)
    assert desk.tilt_deg(found, felt.quat)[0] < 3
    assert desk.apart_deg(found, felt.quat)[1:].max() < 5
    assert desk.apart_deg(found, felt.quat)[200:].max() < after_1_s_deg


@pytest.mark.parametrize("name", ["mahony", "madgwick"])
def test_without_a_force_the_gyroscope_turns_alone(name):
    felt = scene(at_rest(4), 200, noise=0)
    felt.acc[400:] = 0
    felt.gyr[400:, 2] = 90 * DEGREE
    found, _ = Attitude(name).feel(felt)
    turned = desk.apart_deg(found[-1:], felt.quat[-1:])[0]
    assert turned == pytest.approx(180, abs=0.1)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("name", "turn", "far_deg", "after_s", "still_deg", "found_s"),
    [
        # The field is steep: of Kp a sixth turns the heading, every other sample.
        ("mahony", (1.0, -1.0, 1.0), 80, 2, 10, 8),
        # Beta of a quaternion is 4.7 deg/s along the gradient, which a steep field
        # gives little to, and every other sample nothing.
        ("madgwick", (0.4, -0.4, 0.4), 35, 5, 15, 50),
    ],
)
@pytest.mark.parametrize("start", STARTS, ids=lambda q: str(np.round(q, 2)))
def test_an_attitude_that_has_changed_unseen_is_found(
    name, turn, far_deg, after_s, still_deg, found_s, start
):
    away = rotation.from_rotation_vector(np.array(turn))
    quat = np.vstack(
        [at_rest(1, 200, start), at_rest(found_s, 200, rotation.multiply(away, start))]
    )
    felt = scene(quat, 200, seed=1)
    felt.gyr[200] = 0
    found, _ = Attitude(name).feel(felt)
    apart = desk.apart_deg(found, felt.quat)
    assert apart[200] > far_deg
    assert apart[200 + 200 * after_s] > still_deg
    assert apart[-1] < 1


@pytest.mark.parametrize(
    ("name", "least_deg", "tilt_deg", "end_deg", "turned_deg"),
    [
        # On the way the cross product of the fields is not upright.
        ("mahony", 1, 6, 0.01, 20),
        # A step of beta either way is never far.
        ("madgwick", 0, 0.05, 0.05, 5),
    ],
)
def test_a_disturbed_field_turns_the_heading_and_in_the_end_tilts_nothing(
    name, least_deg, tilt_deg, end_deg, turned_deg
):
    felt = scene(at_rest(10), 200, noise=0)
    felt.mag[1000:] += (40, 10, 30)
    found, _ = Attitude(name).feel(felt)
    tilt = desk.tilt_deg(found, felt.quat)
    assert least_deg <= tilt.max() < tilt_deg
    assert tilt[-1] < end_deg
    assert desk.apart_deg(found, felt.quat)[-1] > turned_deg
