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
