# SPDX-License-Identifier: MIT
"""The start-up calibration of calibrate.h: what is rest to it and what it refuses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, ffi, lib
from core.test_calibrate import MPU9250, SAMPLE, lsb

WINDOW = lib.CALIBRATOR_SAMPLES
DONE, PENDING, MOVED = (
    lib.CALIBRATOR_DONE,
    lib.CALIBRATOR_PENDING,
    lib.CALIBRATOR_MOVED,
)
GYR_LSB_DEG_S = lsb(MPU9250, "gyr") / DEGREE
ACC_LSB_G = lsb(MPU9250, "acc") / desk.G
# What calibrate.h allows, in whole counts of the MPU-9250.
SPAN_MAX, BIAS_COUNTS_MAX, TURN_MAX = 49, 655, 18 * 256 - 1


class Calibrator:
    """The start-up calibration of an MPU-9250, fed with whole windows."""

    def __init__(self) -> None:
        self.c = ffi.new("struct gyro_calibrator *")
        self.mean = ffi.new("struct vector *")
        lib.gyro_calibrator_begin(self.c)

    def feed(self, samples: Iterable[Any]) -> list[int]:
        sample = ffi.new("struct sample *")
        results = []
        for one in samples:
            ffi.buffer(sample)[:] = one.tobytes()
            results.append(lib.gyro_calibrator_step(self.c, sample, MPU9250, self.mean))
        return results

    @property
    def mean_counts(self) -> desk.Array:
        return np.array([self.mean.x, self.mean.y, self.mean.z]) / 2**14


def resting(
    seed: int = 0, gyr_deg_s: Any = (0.0, 0.0, 0.0), count: int = WINDOW
) -> desk.Array:
    """Samples at rest, level, with the noise of the chip's data sheet at 92 Hz."""
    random = np.random.default_rng(seed)
    rate = np.broadcast_to(gyr_deg_s, (count, 3))
    rate = rate + 0.1 * random.standard_normal((count, 3))
    force = np.array([0.0, 0.0, 1.0]) + 8e-3 * random.standard_normal((count, 3))
    samples = np.zeros(count, SAMPLE)
    samples["gyr"] = np.round(rate / GYR_LSB_DEG_S)
    samples["acc"] = np.round(force / ACC_LSB_G)
    return samples


def still(count: int = WINDOW) -> desk.Array:
    """Samples at rest without noise."""
    samples = np.zeros(count, SAMPLE)
    samples["acc"] = (0, 0, 2048)
    return samples


ACCEPTED = [PENDING] * (WINDOW - 1) + [DONE]


@pytest.mark.parametrize("seed", range(8))
def test_the_bias_at_rest_is_found_within_a_fiftieth_of_a_degree_a_second(seed):
    bias = np.random.default_rng(1000 + seed).uniform(-5, 5, 3)
    calibrator = Calibrator()
    samples = resting(seed, bias)
    assert calibrator.feed(samples) == ACCEPTED
    assert np.abs(calibrator.mean_counts * GYR_LSB_DEG_S - bias).max() < 0.02
    assert np.array_equal(calibrator.mean_counts, samples["gyr"].mean(axis=0))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("at", [1, 300, WINDOW - 1])
def test_a_step_of_the_rate_is_refused_where_it_comes(axis, at):
    samples = still()
    samples["gyr"][at:, axis] = SPAN_MAX
    assert Calibrator().feed(samples) == ACCEPTED
    samples["gyr"][at:, axis] = -SPAN_MAX - 1
    calibrator = Calibrator()
    assert calibrator.feed(samples[: at + 1]) == [PENDING] * at + [MOVED]
    assert calibrator.c.span_counts == SPAN_MAX + 1
    assert SPAN_MAX * GYR_LSB_DEG_S <= 3 < (SPAN_MAX + 1) * GYR_LSB_DEG_S


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1, -1])
def test_a_steady_turn_of_more_than_40_degrees_a_second_is_refused(axis, sign):
    samples = still()
    samples["gyr"][:, axis] = sign * BIAS_COUNTS_MAX
    assert Calibrator().feed(samples) == ACCEPTED
    samples["gyr"][:, axis] = sign * (BIAS_COUNTS_MAX + 1)
    assert Calibrator().feed(samples) == [MOVED] * WINDOW
    assert abs(BIAS_COUNTS_MAX * GYR_LSB_DEG_S - 40) < 0.1


@pytest.mark.parametrize("axis", [0, 1])
def test_a_turn_of_one_degree_a_second_about_a_horizontal_axis_is_refused(axis):
    rate = np.zeros(3)
    rate[axis] = 1.0
    samples = resting(3, rate)
    tilt = np.arange(WINDOW) / MPU9250.rate_hz * DEGREE
    # About x the vertical moves along y, about y against x.
    along = 2048 * np.sin(tilt)
    samples["acc"][:, 1 - axis] += np.round(-along if axis else along).astype(np.int16)
    calibrator = Calibrator()
    assert calibrator.feed(samples) == [PENDING] * (WINDOW - 1) + [MOVED]


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1, -1])
def test_the_vertical_may_turn_by_half_a_degree_between_the_halves(axis, sign):
    samples = still()
    samples["acc"][WINDOW // 2 :, axis] += sign * (TURN_MAX // 256)
    samples["acc"][-1, axis] += sign * (TURN_MAX % 256)
    assert Calibrator().feed(samples) == ACCEPTED
    samples["acc"][-1, axis] += sign
    assert Calibrator().feed(samples)[-1] == MOVED
    assert abs(np.degrees(np.arcsin(TURN_MAX / 256 / 2048)) - 0.5) < 0.03


@pytest.mark.parametrize("flag", ["gyr_clipped", "has_gap"])
@pytest.mark.parametrize("at", [0, 100, WINDOW - 1])
def test_a_sample_that_clips_or_follows_a_gap_is_refused(flag, at):
    samples = still(at + 1)
    samples[flag][at] = True
    samples["gyr"][: at // 2, 1] = 5
    calibrator = Calibrator()
    assert calibrator.feed(samples) == [PENDING] * at + [MOVED]
    assert calibrator.c.span_counts == (5 if at else 0)


def test_after_a_refusal_a_whole_window_at_rest_is_needed_again():
    calibrator = Calibrator()
    samples = resting(4, (1.0, -2.0, 3.0))
    samples["gyr"][400] += 200
    assert calibrator.feed(samples[:401]) == [PENDING] * 400 + [MOVED]
    samples = resting(5, (1.0, -2.0, 3.0))
    assert calibrator.feed(samples) == ACCEPTED
    assert np.array_equal(calibrator.mean_counts, samples["gyr"].mean(axis=0))


def test_counts_at_the_ends_of_their_range_overflow_nothing():
    samples = still()
    samples["gyr"] = -(2**15)
    samples["acc"] = -(2**15)
    assert set(Calibrator().feed(samples)) == {MOVED}
    # Held within the rates' limits, the forces reach the largest difference of halves.
    samples["gyr"] = 0
    samples["acc"][WINDOW // 2 :] = 2**15 - 1
    assert Calibrator().feed(samples) == [PENDING] * (WINDOW - 1) + [MOVED]


def in_field(samples: desk.Array, field_ut: desk.Array, every: int = 2) -> desk.Array:
    """The same with a reading of the magnetometer in every second sample."""
    samples["has_mag"][1::every] = True
    samples["mag"] = np.round(field_ut / (MPU9250.mag_lsb_pt * 1e-6))
    return samples


@pytest.mark.parametrize("every", [2, 4])
@pytest.mark.parametrize("seed", range(8))
def test_the_noise_of_a_field_is_rest(seed, every):
    """0.78 uT is the most that an AK8963 was measured to have."""
    random = np.random.default_rng(seed)
    field = np.array([18.0, -5.0, -43.0]) + 0.78 * random.standard_normal((WINDOW, 3))
    assert Calibrator().feed(in_field(resting(seed), field, every)) == ACCEPTED


@pytest.mark.parametrize("rate_deg_s", [1.5, -1.5, 25.0])
def test_a_slow_turn_about_the_vertical_is_refused(rate_deg_s):
    turned = rate_deg_s * DEGREE * np.arange(WINDOW) / MPU9250.rate_hz
    field = np.stack(
        [20 * np.sin(turned), 20 * np.cos(turned), np.full(WINDOW, -43.0)], axis=1
    )
    calibrator = Calibrator()
    samples = in_field(resting(3, (0.0, 0.0, rate_deg_s)), field)
    assert calibrator.feed(samples) == [PENDING] * (WINDOW - 1) + [MOVED]
    # The same once more without the field, as from a magnetometer that is absent.
    samples["has_mag"] = False
    assert calibrator.feed(samples) == ACCEPTED


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1, -1])
def test_the_field_may_change_by_less_than_0_3_ut_between_the_halves(axis, sign):
    """By 255 256ths of a count of 0.3 uT, summed over 128 readings."""
    samples = in_field(still(), np.zeros((WINDOW, 3)))
    second = samples[WINDOW // 2 :]
    second["mag"][1::2, axis] = sign
    second["mag"][1:-2:2, axis] += sign  # 255 in all: the last one has one
    assert Calibrator().feed(samples) == ACCEPTED
    samples["mag"][-1, axis] += sign
    assert Calibrator().feed(samples)[-1] == MOVED
