# SPDX-License-Identifier: MIT
"""The filter against its twin in doubles, against known attitudes and a recording, and
under all that a sensor can throw at it."""

from __future__ import annotations

import numpy as np
import pytest
import scoring
from hypothesis import given, settings
from hypothesis import strategies as st

from core import desk
from core.desk import DEGREE, FIELD, FORCE, ONE, RATE, G, lib
from core.scenes import Filter, Scene, at_rest, earth, scene, tumble
from imud import rotation
from imud.virtual import motion, sensors

LEVEL = rotation.IDENTITY
UPSIDE_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
NOT_KNOWN = 2**16 - 1


QUARTER = np.pi / 2
# The 24 attitudes whose axes lie along the world's: six sides up, four ways each.
STARTS = [
    rotation.from_heading_pitch_roll(heading * QUARTER, pitch * QUARTER, roll * QUARTER)
    for heading in range(4)
    for pitch, roll in ((0, 0), (0, 1), (0, 2), (0, 3), (1, 0), (-1, 0))
]


def centred(rate_hz: int) -> Filter:
    """A filter for rates that are means over the sample period, as of a scene."""
    return Filter(rate_hz, 500_000 // rate_hz)


def twin(
    felt: Scene, calibrated_at: int = -1, bias_deg_s: object = (0, 0, 0)
) -> desk.Array:
    """The double-precision filter over the very numbers that the fixed one gets."""
    rows = felt.measurements()
    out = np.zeros((len(felt), 4))
    params = desk.ffi.new("struct fuse_twin_params *")
    lib.fuse_twin_defaults(params)
    desk.call(
        lib.fuse_twin_run,
        params,
        len(felt),
        felt.rate_hz,
        0.0039,
        rows["gyr_rad_s_q25"] / RATE,
        rows["acc_m_s2_q21"] / FORCE,
        rows["mag_ut_q18"] / FIELD,
        felt.has_mag,
        felt.interval_us / 1e6,
        calibrated_at,
        np.array(bias_deg_s) * DEGREE,
        out,
        desk.ffi.NULL,
    )
    return out


def rms(values: desk.Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


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
    assert rms(apart) < 0.05
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
    assert quality["tilt_sigma_cdeg"][begun:].min() >= 28
    # 95 of 100 within two sigmas.
    tilt = desk.tilt_deg(found, felt.quat)[begun:]
    assert np.mean(tilt < 0.02 * quality["tilt_sigma_cdeg"][begun:]) > 0.95


def test_the_tilt_sigma_grows_with_the_motion():
    felt = scene(at_rest(20), 200)
    felt.gyr[2000:3000, 2] = 500 * DEGREE
    quality = centred(200).feel(felt)[2]
    sigma = quality["tilt_sigma_cdeg"].astype(int)
    assert (sigma[:599] == NOT_KNOWN).all()
    assert 28 <= sigma[1900] <= 30
    assert 80 <= sigma[2990] <= 120
    assert sigma[-1] < sigma[2990]


def passing_magnet(felt: Scene, begin_s: float, end_s: float) -> Scene:
    """The same with a field of 40 uT, seen from the world, coming and going."""
    t = np.arange(len(felt)) / felt.rate_hz
    near = np.clip((t - begin_s) / (end_s - begin_s), 0, 1)
    extra = 40 * np.sin(np.pi * near)[:, None] * np.array([0.8, -0.1, 0.59])
    felt.mag += rotation.rotate(rotation.inverse(felt.quat), extra)
    return felt


def test_a_passing_magnet_tilts_nothing_not_even_by_a_bit():
    quat = tumble(30, 200, 4)
    calm = centred(200).feel(scene(quat, 200, seed=6))
    disturbed = centred(200).feel(passing_magnet(scene(quat, 200, seed=6), 8, 20))
    assert np.array_equal(calm[1], disturbed[1])
    assert not np.array_equal(calm[0], disturbed[0])
    for name in ("tilt_sigma_cdeg", "is_at_rest", "is_starting"):
        assert np.array_equal(calm[2][name], disturbed[2][name])


def test_a_passing_magnet_is_told_and_turns_the_heading_by_little():
    quat = at_rest(40)
    felt = passing_magnet(scene(quat, 200, seed=6), 10, 20)
    found, _, quality = centred(200).feel(felt)
    told = quality["is_mag_disturbed"]
    assert not told[:2000].any()
    assert told[2500:3800].all()
    assert not told[4400:].any()
    heading = desk.heading_deg(found, felt.quat)
    assert heading[1000:2000].max() < 1
    assert heading[2000:].max() < 3
    assert heading[-1] < 1


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
    felt = scene(at_rest(20), 200, noise=0)
    felt.mag[:2000] = (0, 0, -50)
    felt.mag[2000:] = (30, 0, -40)
    found, _, quality = centred(200).feel(felt)
    assert quality["is_heading_free"][:2000].all()
    assert not quality["is_mag_absent"][40:].any()
    west = rotation.from_heading_pitch_roll(np.pi / 2, 0, 0)
    assert desk.apart_deg(found, np.tile(west, (len(found), 1)))[2040] < 0.01


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


def test_a_steady_turn_above_2_degrees_a_second_is_no_rest():
    felt = scene(at_rest(10), 200, gyr_bias_deg_s=(0, 0, 2.2))
    probe = centred(200)
    assert not probe.feel(felt)[2]["is_at_rest"].any()
    assert probe.bias_deg_s == pytest.approx([0, 0, 0], abs=0.05)


def test_a_calibrated_bias_is_followed_at_rest_by_2_degrees_a_second():
    for bias, is_rest in ((6.5, True), (7.5, False)):
        probe = centred(200)
        probe.set_bias((0, 5.0, 0))
        quality = probe.feel(scene(at_rest(30), 200, gyr_bias_deg_s=(0, bias, 0)))[2]
        assert quality["is_at_rest"][1000:].all() == is_rest
        if is_rest:
            assert probe.bias_deg_s[1] == pytest.approx(bias, abs=0.02)
        else:  # levelling tells of it, slowly
            assert 5.2 < probe.bias_deg_s[1] < 6


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
    assert rms(desk.tilt_deg(found, felt.quat)[4000:]) < 0.3


def test_the_scale_of_the_gyroscope_is_learned_from_motion():
    felt = scene(tumble(180, 200, 6), 200, seed=4)
    felt.gyr *= 1.004
    probe = centred(200)
    probe.set_bias((0, 0, 0))
    probe.feel(felt)
    assert probe.c.scale / ONE == pytest.approx(-0.004, abs=0.0006)


@pytest.mark.parametrize("behind", [0, 2, 4])
def test_the_lag_of_the_field_is_learned_from_motion(behind):
    felt = scene(tumble(120, 200, 9), 200, seed=8)
    felt.mag = np.roll(felt.mag, behind, axis=0)
    probe = centred(200)
    probe.set_bias((0, 0, 0))
    assert probe.c.lag_s_q35 / 2**35 == pytest.approx(0.0125, abs=1e-6)
    probe.feel(felt)
    assert probe.c.lag_s_q35 / 2**35 == pytest.approx(0.005 * behind, abs=0.0015)


def test_a_lag_is_not_learned_at_rest():
    probe = centred(200)
    probe.feel(scene(at_rest(60), 200, seed=8))
    assert probe.c.lag_s_q35 / 2**35 == pytest.approx(0.0125, abs=0.0005)


def own_field_ut(probe: Filter) -> desk.Array:
    return np.array(list(probe.c.field_ut)[3:]) / FIELD


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
    assert np.abs(own_field_ut(probe) - own_ut).max() < 0.7
    assert rms(desk.heading_deg(found, felt.quat[1000:])[-8000:]) < 3
    assert not quality["is_mag_disturbed"][-2000:].any()


def test_an_absurd_bias_is_held_within_3_4_rad_a_second():
    probe = centred(200)
    probe.set_bias((-1700, 1700, 100))
    limit = 3.4 / DEGREE
    assert probe.bias_deg_s == pytest.approx([-limit, limit, 100])


def test_shaking_at_a_steady_attitude_is_no_rest():
    felt = scene(at_rest(10), 200, sway_m_s2=2.0)
    assert not centred(200).feel(felt)[2]["is_at_rest"].any()


def test_in_free_fall_the_gyroscope_alone_keeps_the_level():
    quat = tumble(20, 200, 11)
    felt = scene(quat, 200, noise=0)
    falls = slice(1000, 4000)
    felt.acc[falls] = 0
    found, _, _ = centred(200).feel(felt)
    assert desk.tilt_deg(found, felt.quat)[falls].max() < 0.5
    assert np.abs(desk.norms(found) / ONE - 1).max() < 1e-8


def test_a_probe_that_starts_in_free_fall_levels_once_it_is_caught():
    felt = scene(at_rest(20, 200, UPSIDE_DOWN), 200)
    felt.acc[:400] = 0
    found, _, _ = centred(200).feel(felt)
    assert desk.tilt_deg(found, felt.quat)[-1] < 0.5


def test_clipped_sensors_leave_a_sound_quaternion_and_the_level_comes_back():
    felt = scene(tumble(40, 200, 12), 200)
    felt.gyr[1000:1400] = 2000 * DEGREE
    felt.acc[1000:1400] = -16 * G
    felt.gyr[1400:] = 0
    felt.acc[1400:] = (0, 0, G)
    found, _, quality = centred(200).feel(felt)
    # 0.20 deg a 100 deg/s, of the 3464 deg/s of a corner, half forgotten by the mean.
    assert 450 < quality["tilt_sigma_cdeg"][1399] < 650
    assert np.abs(desk.norms(found) / ONE - 1).max() < 1e-6
    assert desk.tilt_deg(found[-1:], LEVEL[None])[0] < 0.5


# Intervals.


def turned_by(interval_us: int, rate_deg_s: float) -> float:
    """Degrees that one sample with a rate turns the filter by."""
    probe = Filter(200, 2500)
    felt = scene(at_rest(0.01), 200, noise=0)
    felt.has_mag[:] = False
    felt.acc[1] = 0  # it keeps the level of the first sample
    felt.gyr[1, 2] = rate_deg_s * DEGREE
    found, _, _ = probe.run(
        felt.measurements(), np.array([5000, interval_us], np.uint32)
    )
    return float(desk.apart_deg(found[:1], found[1:])[0])


@pytest.mark.parametrize(
    ("interval_us", "integrated_us"),
    [
        (0, 0),
        (1, 1),
        (4999, 4999),
        (7500, 7500),
        (7501, 7501),
        (22_500, 22_500),
        (60_000, 60_000),
        (60_001, 60_000),
        (1_000_000, 60_000),
        (2**31, 60_000),
        (2**32 - 1, 60_000),
    ],
)
@pytest.mark.parametrize("rate_deg_s", [30, -500, 2000])
def test_a_rate_is_integrated_over_its_interval_up_to_60_ms(
    interval_us, integrated_us, rate_deg_s
):
    wanted = abs(rate_deg_s) * integrated_us / 1e6
    # Fourth order costs a^5/1920 of each part's angle a: 8 times 4e-5 deg at most.
    assert turned_by(interval_us, rate_deg_s) == pytest.approx(wanted, abs=0.0005)


def test_the_clock_may_wrap_between_two_samples():
    felt = scene(tumble(12, 200, 3), 200)
    plain, _, _ = centred(200).feel(felt)
    probe = centred(200)
    times = np.arange(len(felt), dtype=np.uint32) * np.uint32(5000) - np.uint32(10**6)
    steps = np.diff(times, prepend=times[0] - np.uint32(5000)).astype(np.uint32)
    wrapped, _, _ = probe.run(felt.measurements(), steps)
    assert np.array_equal(plain, wrapped)


# All that counts can be.

EXTREMES = np.array([-(2**15), -(2**15) + 1, -1, 0, 1, 2**15 - 1])


def worst_calibrations() -> list[object]:
    """None, and those whose matrices and biases are as large as is valid."""
    third = 27852 // 3
    made = [desk.UNCALIBRATED[0]]
    for sign in (1, -1):
        part = {
            "bias": [sign * 2**28, -sign * 2**28, sign * 2**28],
            "matrix": [[27852, 0, 0], [-third, third, -third], [0, -13926, 13926]],
        }
        made.append(
            desk.ffi.new(
                "struct calibration *", {name: part for name in ("acc", "gyr", "mag")}
            )[0]
        )
    return made


CALIBRATIONS = worst_calibrations()


def wild_samples(random: np.random.Generator, count: int) -> desk.Array:
    """Counts from everywhere, edges among them, single and in stretches."""
    samples = np.zeros(count, desk.dtype_of("struct sample"))
    # Values that stand for up to 200 samples drive the low-passes to their ends.
    hold = int(random.choice([1, 1, 5, 50, 200]))
    for name in ("gyr", "acc", "mag"):
        shape = (count // hold + 1, 3)
        anything = random.integers(-(2**15), 2**15, shape)
        edge = random.choice(EXTREMES, shape)
        rows = np.where(random.random(shape) < 0.5, anything, edge)
        samples[name] = np.repeat(rows, hold, axis=0)[:count]
    samples["has_mag"] = random.random(count) < 0.5
    samples["gyr_clipped"] = random.random(count) < 0.1
    samples["has_gap"] = random.random(count) < 0.1
    return samples


@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    rate_hz=st.sampled_from([100, 200, 250, 380, 499, 760, 800]),
    gyr_delay_us=st.sampled_from([0, 3900, 7500]),
    calibration=st.sampled_from(range(len(CALIBRATIONS))),
    gyr_lsb=st.sampled_from([1065264, 1221730]),
    intervals=st.sampled_from(["usual", "any"]),
)
def test_whatever_the_counts_a_unit_quaternion_comes_out(
    seed, rate_hz, gyr_delay_us, calibration, gyr_lsb, intervals
):
    random = np.random.default_rng(seed)
    samples = wild_samples(random, 2000)
    identity = desk.identity_of(
        rate_hz=rate_hz,
        gyr_delay_us=gyr_delay_us,
        gyr_lsb_nrad_s=gyr_lsb,
        acc_lsb_nm_s2=7178466,
    )
    steps = np.full(len(samples), 1_000_000 // rate_hz)
    if intervals == "any":
        edges = [0, 1, 2500, 7500, 60_000, 10**6, 2**31, 2**32 - 1]
        steps = random.choice(edges, len(samples))
    samples["time_us"] = np.cumsum(steps, dtype=np.uint64) % 2**32
    constant = desk.ffi.new("struct calibration *", CALIBRATIONS[calibration])
    assert lib.calibration_is_valid(constant)
    tracker = desk.ffi.new("struct pose_tracker *")
    assert lib.pose_begin(tracker, constant, identity, lib.FILTER_FUSE)
    poses = np.zeros(len(samples), desk.dtype_of("struct message_pose"))
    results = np.zeros(len(samples), np.int32)
    half = len(samples) // 2
    for rows in (slice(0, half), slice(half, None)):
        desk.call(
            lib.loop_pose, tracker, half, samples[rows], poses[rows], results[rows]
        )
        assert np.abs(desk.norms(poses["q"][rows]) / ONE - 1).max() < 1e-6
        # A bias as large as a valid calibration makes of counts at rest.
        mean = random.choice([-327 * 2**16, 0, 327 * 2**16], 3).tolist()
        bias = desk.ffi.new("struct vector *")
        scale = desk.ffi.addressof(tracker.scale)
        lib.calibrate_rate(constant, scale, mean, bias)
        lib.fuse_set_bias(desk.ffi.addressof(tracker.attitude.fuse), bias)


def test_the_longest_forces_and_fields_fit_when_they_swing_at_the_low_passs_pace():
    # The worst a low-pass can meet: its input changes sign where its response to a
    # stroke does.
    corner = np.full(3, 270.0) * (1 - 1e-9)
    for rate_hz, period_s in ((200, 2 * np.pi * 3 / np.sqrt(2)), (100, 0.3), (100, 2)):
        quat = at_rest(80, rate_hz)
        felt = scene(quat, rate_hz, noise=0)
        t = np.arange(len(felt)) / rate_hz
        swing = np.where(np.sin(2 * np.pi * t / period_s) >= 0, 1.0, -1.0)[:, None]
        felt.acc = swing * corner
        felt.mag = swing * np.full(3, 2048.0) * (1 - 1e-9)
        felt.gyr = swing * np.array([0.0, 0.0, 38.0]) * (1 - 1e-9)
        found, _, _ = Filter(rate_hz).feel(felt)
        assert np.abs(desk.norms(found) / ONE - 1).max() < 1e-6


# Recordings with optical truth.


def read_by_the_chip(recording: motion.Motion, rate_hz: int = 200) -> Scene:
    """What an MPU-9250 would give: means over its low-pass's window, at its rate."""
    records = len(recording)
    known = np.arange(records) / recording.rate_hz
    t = np.arange(int(records / recording.rate_hz * rate_hz)) / rate_hz
    half = sensors.NOISE_WINDOW_S / 2
    edges = np.clip([t - half, t + half], 0, known[-1])

    def mean(rows: desk.Array) -> desk.Array:
        area = np.concatenate([np.zeros((1, 3)), (rows[1:] + rows[:-1]) / 2])
        area = np.cumsum(area, axis=0) / recording.rate_hz
        low, high = (
            np.stack([np.interp(edge, known, column) for column in area.T], axis=1)
            for edge in edges
        )
        return (high - low) / (edges[1] - edges[0])[:, None]

    # A reading of the magnetometer is 3 ms old on the average.
    nearest = np.rint((t - 0.0031).clip(0) * recording.rate_hz).astype(int)
    return Scene(
        rate_hz,
        mean(recording.gyr),
        mean(recording.acc),
        recording.mag[nearest.clip(0, records - 1)],
        has_mag=np.arange(len(t)) % (rate_hz // 100) == 1,
        quat=np.zeros((len(t), 4)),
    )


@pytest.mark.parametrize(
    "name", ["07_undisturbed_fast_rotation_B", "28_disturbed_stationary_magnet_A"]
)
def test_fixed_point_is_within_0_01_degrees_of_doubles_on_a_recording(
    shared_data, name
):
    felt = read_by_the_chip(motion.load(shared_data / "broad" / f"{name}.npz"))
    found, _, _ = Filter(200).feel(felt)
    assert rms(desk.apart_deg(found, twin(felt))) < 0.01


@pytest.mark.parametrize(
    ("name", "total_deg", "inclination_deg"),
    [
        ("07_undisturbed_fast_rotation_B", 1.5, 0.7),
        ("28_disturbed_stationary_magnet_A", 2.5, 1.2),
    ],
)
def test_a_recording_is_followed_within_degrees(
    shared_data, name, total_deg, inclination_deg
):
    recording = motion.load(shared_data / "broad" / f"{name}.npz")
    felt = read_by_the_chip(recording)
    identity = desk.identity_of()
    samples = felt.samples(identity)
    tracker = desk.ffi.new("struct pose_tracker *")
    assert lib.pose_begin(tracker, desk.UNCALIBRATED, identity, lib.FILTER_FUSE)
    poses = np.zeros(len(samples), desk.dtype_of("struct message_pose"))
    results = np.zeros(len(samples), np.int32)
    desk.call(lib.loop_pose, tracker, len(samples), samples, poses, results)
    assert lib.POSE_CALIBRATED in results
    times_s = np.arange(len(samples)) / felt.rate_hz
    score = scoring.score_at(times_s, poses["q"] / ONE, recording)
    assert score.total < total_deg
    assert score.inclination < inclination_deg
