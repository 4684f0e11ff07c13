# SPDX-License-Identifier: MIT
"""The filter in free fall, clipped, over any interval and at the ends of its range."""

from __future__ import annotations

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, ONE, G
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
