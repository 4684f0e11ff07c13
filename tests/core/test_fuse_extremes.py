# SPDX-License-Identifier: MIT
"""The filter in free fall, clipped, over any interval and with any counts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core import desk
from core.desk import DEGREE, ONE, G, lib
from core.fuse_desk import LEVEL, UPSIDE_DOWN, centred
from core.scenes import Filter, at_rest, scene, tumble


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
    felt.acc[1400:, 0] += 0.01 * np.arange(len(felt) - 1400) % 0.1  # it is alive
    found, _, quality = centred(200).feel(felt)
    assert (quality["tilt_sigma_cdeg"][1100:1400] == 2**16 - 1).all()
    assert quality["is_force_impossible"][1100:1400].all()
    assert not quality["is_force_impossible"][-1000:].any()
    assert np.abs(desk.norms(found) / ONE - 1).max() < 1e-6
    assert desk.tilt_deg(found[-1:], LEVEL[None])[0] < 0.5


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


EXTREMES = np.array([-(2**15), -(2**15) + 1, -1, 0, 1, 2**15 - 1])


def worst_calibrations() -> list[object]:
    """None, and those whose matrices and biases are as large as is valid."""
    third = 27852 // 3
    made = [desk.EXACT[0]]
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
        mean = random.choice([-327 * 2**14, 0, 327 * 2**14], 3).tolist()
        bias = desk.ffi.new("struct vector *", mean)
        scale = desk.ffi.addressof(tracker.scale)
        lib.calibrate_rate(constant, scale, bias)
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
