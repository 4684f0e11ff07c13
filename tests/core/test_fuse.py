# SPDX-License-Identifier: MIT
"""The filter against its twin in doubles: level, heading and field."""

from __future__ import annotations

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, ONE
from core.fuse_desk import LEVEL, UPSIDE_DOWN, centred, rms, twin
from core.scenes import Filter, Scene, at_rest, earth, scene, tumble
from imud import rotation

pytestmark = pytest.mark.sampled(2)

NOT_KNOWN = 2**16 - 1
QUARTER = np.pi / 2


# The 24 attitudes whose axes lie along the world's: six sides up, four ways each.
STARTS = [
    rotation.from_heading_pitch_roll(heading * QUARTER, pitch * QUARTER, roll * QUARTER)
    for heading in range(4)
    for pitch, roll in ((0, 0), (0, 1), (0, 2), (0, 3), (1, 0), (-1, 0))
]


@pytest.mark.parametrize(
    ("rate_hz", "start", "dip_deg"),
    [
        (100, LEVEL, 66),
        (200, LEVEL, 66),
        (200, UPSIDE_DOWN, 66),
        (200, LEVEL, 88),
        (250, LEVEL, 66),  # where a stride of one sample would be too short
        (299, UPSIDE_DOWN, 66),
        (380, UPSIDE_DOWN, 66),
        (500, LEVEL, 66),
        (760, LEVEL, 66),
        (800, UPSIDE_DOWN, 66),
    ],
)
def test_fixed_point_is_within_0_05_degrees_of_doubles_through_a_wild_minute(
    rate_hz, start, dip_deg
):
    bias = (1.0, -2.0, 0.5)
    felt = scene(
        tumble(60, rate_hz, 5, start),
        rate_hz,
        seed=3,
        field_ut=earth(dip_deg),
        gyr_bias_deg_s=bias,
        sway_m_s2=1.0,
    )
    assert 1800 < desk.norms(felt.gyr).max() / DEGREE < 2000
    calibrated_at = 3 * rate_hz
    fixed = Filter(rate_hz)
    before, _, _ = fixed.feel(felt[:calibrated_at])
    fixed.set_bias(bias)
    after, _, _ = fixed.feel(felt[calibrated_at:])
    found = np.concatenate([before, after])
    apart = desk.apart_deg(found, twin(felt, calibrated_at, bias))
    # At 88 degrees the horizontal field is 1.7 uT: heading is worth little.
    assert rms(apart) < (0.1 if dip_deg == 88 else 0.05)
    assert apart.max() < 0.2
    assert np.abs(desk.norms(found) / ONE - 1).max() < 1e-8


def test_the_comparison_with_doubles_would_see_a_missing_correction():
    felt = scene(tumble(20, 200, 5), 200, seed=3)
    found, _, _ = Filter(200, 0).feel(felt)
    assert rms(desk.apart_deg(found, twin(felt))) > 0.1


@pytest.mark.parametrize("start", STARTS, ids=lambda q: str(np.round(q, 2)))
@pytest.mark.parametrize("has_mag_first", [False, True], ids=["later", "at once"])
def test_from_any_start_at_rest_level_and_heading_are_found_in_5_s(
    start, has_mag_first
):
    felt = scene(at_rest(5, 200, start), 200, seed=1)
    if has_mag_first:
        felt.has_mag = ~felt.has_mag
    found, _, quality = centred(200).feel(felt)
    assert desk.tilt_deg(found, felt.quat)[0] < 3
    assert desk.tilt_deg(found, felt.quat)[-1] < 0.5
    assert desk.heading_deg(found, felt.quat)[-1] < 1.5
    assert quality["is_starting"][:599].all()
    assert not quality["is_starting"][600:].any()


def test_all_24_axis_aligned_starts_differ():
    assert len(STARTS) == 24
    assert min(
        desk.apart_deg(a, b) for i, a in enumerate(STARTS) for b in STARTS[:i]
    ) == pytest.approx(90)


@pytest.mark.parametrize("rate_hz", [100, 200, 380, 760])
def test_motion_is_followed_at_every_rate_of_the_house(rate_hz):
    felt = scene(tumble(30, rate_hz, 8), rate_hz, seed=2, sway_m_s2=0.5)
    found, _, quality = centred(rate_hz).feel(felt)
    begun = 5 * rate_hz
    assert rms(desk.tilt_deg(found, felt.quat)[begun:]) < 1.0
    assert not quality["is_mag_absent"][begun:].any()
    assert quality["tilt_sigma_cdeg"][begun:].min() >= 40
    # 95 of 100 within two sigmas.
    tilt = desk.tilt_deg(found, felt.quat)[begun:]
    assert np.mean(tilt < 0.02 * quality["tilt_sigma_cdeg"][begun:]) > 0.95


def test_the_tilt_sigma_grows_with_what_levelling_goes_on_to_correct():
    felt = scene(at_rest(60), 200)
    felt.gyr[2000:3000, 0] += 3 * DEGREE  # a turn that never was
    found, _, quality = centred(200).feel(felt)
    sigma = quality["tilt_sigma_cdeg"].astype(int)
    assert (sigma[:599] == NOT_KNOWN).all()
    assert 40 <= sigma[1900] < 80
    assert desk.tilt_deg(found, felt.quat)[2990] > 1.5
    assert 150 <= sigma[2990] <= 600
    assert sigma[-1] < 100


def passing_magnet(
    felt: Scene, begin_s: float, end_s: float, field_ut: float = 40
) -> Scene:
    """The same with a field, seen from the world, coming and going."""
    t = np.arange(len(felt)) / felt.rate_hz
    near = np.clip((t - begin_s) / (end_s - begin_s), 0, 1)
    extra = field_ut * np.sin(np.pi * near)[:, None] * np.array([0.8, -0.1, 0.59])
    felt.mag += rotation.rotate(rotation.inverse(felt.quat), extra)
    return felt


def test_a_passing_magnet_tilts_by_little_through_what_it_tells_of_the_gyroscope():
    quat = tumble(30, 200, 4)
    calm = centred(200).feel(scene(quat, 200, seed=6))
    disturbed = centred(200).feel(passing_magnet(scene(quat, 200, seed=6), 8, 20))
    assert not np.array_equal(calm[0], disturbed[0])
    tilts = [desk.tilt_deg(found, quat) for found, _, _ in (calm, disturbed)]
    assert np.abs(tilts[0] - tilts[1]).max() < 0.17
    assert rms(tilts[1]) < 1.5 * rms(tilts[0])
    for name in ("is_at_rest", "is_starting"):
        assert np.array_equal(calm[2][name], disturbed[2][name])


def test_a_heading_is_less_sure_while_readings_surprise_by_their_length():
    felt = passing_magnet(scene(tumble(10, 200, 4), 200, seed=6), 8, 14, 10)
    probe = centred(200)
    _, _, quality = probe.feel(felt)
    share = probe.c.state.field_astray / 2**16
    assert share > 0.2
    sigma = quality["heading_sigma_cdeg"]
    assert sigma[1600] < 300
    # What strange lengths alone add, across a horizontal field of at most 22 uT.
    alone_deg = np.sqrt(4 * share) / 22 / DEGREE
    assert 100 * alone_deg < sigma[-1] < 2500


def test_a_passing_magnet_is_told_and_turns_the_heading_by_little():
    quat = at_rest(40)
    felt = passing_magnet(scene(quat, 200, seed=6), 10, 20)
    found, _, quality = centred(200).feel(felt)
    is_disturbed = quality["is_mag_disturbed"]
    assert not is_disturbed[:2000].any()
    assert is_disturbed[2500:3800].all()
    assert not is_disturbed[4400:].any()
    heading = desk.heading_deg(found, felt.quat)
    assert heading[1000:2000].max() < 1.1
    assert heading[2000:].max() < 3
    assert heading[-1] < 1.1


def test_a_field_of_another_kind_from_the_start_is_only_another_north():
    felt = scene(at_rest(10), 200, field_ut=np.array([60.0, 0.0, 5.0]))
    found, _, quality = centred(200).feel(felt)
    east = rotation.from_heading_pitch_roll(np.pi / 2, 0, 0)
    assert desk.apart_deg(found, felt.quat)[-1] == pytest.approx(90, abs=1)
    assert desk.apart_deg(found, np.tile(east, (len(found), 1)))[-1] < 1
    assert not quality["is_mag_disturbed"].any()


def test_the_heading_follows_the_field_after_it_has_gone_and_come_back():
    felt = scene(at_rest(100), 200, seed=9)
    gone = slice(2000, 6000)
    felt.has_mag[gone] = False
    felt.gyr[gone, 2] += 3 * DEGREE  # a turn that never was
    found, _, quality = centred(200).feel(felt)
    heading = desk.heading_deg(found, felt.quat)
    assert heading[1999] < 1
    assert heading[5999] == pytest.approx(60, abs=2)
    assert heading[-1] < 4
    absent = quality["is_mag_absent"]
    assert not absent[40:2000].any()
    # A second after the last frame with a reading.
    assert not absent[2000:2180].any()
    assert absent[2240:6000].all()
    assert not absent[6040:].any()
    sigma = quality["heading_sigma_cdeg"].astype(int)
    assert sigma[5999] > sigma[1999]
    assert sigma[-1] < sigma[5999]


def test_without_a_magnetometer_the_heading_is_free_and_says_so():
    felt = scene(at_rest(10), 200)
    felt.has_mag[:] = False
    found, _, quality = centred(200).feel(felt)
    assert desk.tilt_deg(found, felt.quat)[-1] < 0.5
    assert quality["is_mag_absent"].all()
    assert quality["is_heading_free"].all()
    assert not quality["is_mag_disturbed"].any()
    assert (quality["heading_sigma_cdeg"] == NOT_KNOWN).all()


def test_a_magnetometer_that_reads_nothing_is_as_good_as_absent():
    felt = scene(at_rest(5), 200)
    felt.mag[:] = 0
    quality = centred(200).feel(felt)[2]
    assert quality["is_mag_absent"].all()
    assert quality["is_heading_free"].all()


def test_a_heading_is_free_again_50_minutes_after_the_last_reading():
    known = scene(at_rest(10), 200)
    probe = centred(200)
    quality = probe.feel(known)[2]
    assert not quality["is_heading_free"][600:].any()
    assert (quality["heading_sigma_cdeg"][600:] < 500).all()
    minutes = scene(at_rest(3200), 100)
    minutes.has_mag[:] = False
    slow = centred(100)
    slow.feel(scene(at_rest(10), 100))
    quality = slow.feel(minutes)[2]
    # 0.3 deg2 a second to 30 degrees.
    freed = int(np.argmax(quality["is_heading_free"]))
    assert 290_000 < freed < 301_000
    sigma = quality["heading_sigma_cdeg"]
    assert (sigma[freed:] == NOT_KNOWN).all()
    assert 2990 <= sigma[freed - 1] <= 3010
    # Then the next readings set it, however far it has drifted.
    turned = scene(at_rest(5), 100, field_ut=np.array([-20.0, 0.0, -45.0]))
    found, _, quality = slow.feel(turned)
    west = rotation.from_heading_pitch_roll(-np.pi / 2, 0, 0)
    assert desk.apart_deg(found, np.tile(west, (len(found), 1)))[-1] < 2
    assert not quality["is_heading_free"][50:].any()


def test_a_vertical_field_tells_no_heading_and_the_first_other_one_sets_it():
    felt = scene(at_rest(20), 200, noise=0.01)
    felt.mag -= felt.mag.mean(axis=0)  # leaves the noise
    felt.mag[:2000] += (0, 0, -50)
    felt.mag[2000:] += (30, 0, -40)
    found, _, quality = centred(200).feel(felt)
    assert quality["is_heading_free"][:2000].all()
    assert not quality["is_mag_absent"][40:].any()
    west = rotation.from_heading_pitch_roll(np.pi / 2, 0, 0)
    assert desk.apart_deg(found, np.tile(west, (len(found), 1)))[2040] < 0.01
