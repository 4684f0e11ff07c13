# SPDX-License-Identifier: MIT
"""Orientation filters to compare: functions from a probe's samples to poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.common import wire
from benchmarks.common.core import Replay
from benchmarks.common.feed import Feed, with_filter
from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.wire import schema


@dataclass(frozen=True, slots=True)
class Estimate:
    """Poses over time, with the filter's own sigmas if it states any."""

    times_s: FloatArray
    quats: FloatArray  # world_from_body, world east-north-up
    tilt_sigma_deg: FloatArray | None = None  # NaN: not known
    heading_sigma_deg: FloatArray | None = None

    @property
    def sigmas_deg(self) -> tuple[FloatArray, FloatArray]:
        """Of tilt and of heading, of a filter that states them."""
        assert self.tilt_sigma_deg is not None
        assert self.heading_sigma_deg is not None
        return self.tilt_sigma_deg, self.heading_sigma_deg


Engine = Callable[[Feed], Estimate]

# The main filter's C on this machine, beside the images (boards.IMAGES), whose messages
# the engines are fed with. Others' names stand where they compare.
HOST = "host"
VQF, OFFLINE = "vqf", "vqf-offline"

# The filters of the firmware: the main one, and the papers'.
OURS = tuple(
    each.name.lower() for each in schema.Filter if each is not schema.Filter.NONE
)
MAIN, *PAPERS = OURS


def poses(times_s: FloatArray, contents: Sequence[bytes]) -> Estimate:
    """The estimate in pose messages."""
    rows = wire.to_rows("pose", contents)
    tilt, heading = (
        np.where(rows[name][:, 0] == 2**16 - 1, np.nan, rows[name][:, 0] * 0.01)
        for name in ("tilt_sigma", "heading_sigma")
    )
    return Estimate(times_s, rows["q"] * 2.0**-30, tilt, heading)


def replayed(feed: Feed, name: str) -> list[bytes]:
    """Poses of the firmware's C on this machine, at the times of the probe's poses."""
    replay = Replay(with_filter(feed.hello, name), feed.params)
    times_us = feed.rows["time_us"].tolist()
    due = dict(zip(feed.pose_after, feed.pose_sequence, strict=True))
    contents = []
    for index, raw in enumerate(feed.raws):
        replay.step(raw)
        sequence = due.get(index)
        if sequence is not None:
            contents.append(replay.pose(sequence, times_us[index]))
    return contents


def core(feed: Feed, name: str) -> Estimate:
    """One of the firmware's filters."""
    return poses(feed.pose_times_s, replayed(feed, name))


def vqf_defaults(feed: Feed) -> Estimate:
    """VQF from PyPI with its default parameters."""
    import vqf

    samples = feed.samples
    # Samples from one magnetometer reading to the next.
    every = max(1.0, round(len(samples) / max(1, int(samples.has_mag.sum())), 1))
    step_s = 1.0 / samples.rate_hz
    tracker = vqf.VQF(step_s, step_s, every * step_s)
    out = np.empty((len(samples), 4))
    gyr, acc, mag = (
        np.ascontiguousarray(values, dtype=np.float64)
        for values in (samples.gyr, samples.acc, samples.mag)
    )
    for index, is_new in enumerate(samples.has_mag.tolist()):
        tracker.updateGyr(gyr[index])
        tracker.updateAcc(acc[index])
        if is_new:
            tracker.updateMag(mag[index])
        out[index] = tracker.getQuat9D()
    return Estimate(feed.times_s, out)


def vqf_offline(feed: Feed) -> Estimate:
    """VQF's smoother, which uses the whole recording for every pose."""
    from vqf import offlineVQF

    samples = feed.samples
    gyr, acc, mag = (
        np.ascontiguousarray(values, dtype=np.float64)
        for values in (samples.gyr, samples.acc, samples.mag_held)
    )
    found = offlineVQF(gyr, acc, mag, 1.0 / samples.rate_hz)
    return Estimate(feed.times_s, found["quat9D"])


CALIBRATION_S = 5.0  # at rest; `ahrs` gets the rates less their mean over it

# The gains that suit these recordings best, as far as we know.
MADGWICK_GAIN, MAHONY_GAIN, FUSION_GAIN = 0.06, 0.2, 0.1
# `ahrs` refuses an integral gain of 0; this one has no effect within an hour.
NO_INTEGRAL = 1e-12


def ahrs_madgwick(feed: Feed) -> Estimate:
    """Madgwick's filter from PyPI's `ahrs`."""
    from ahrs.filters import Madgwick

    found = Madgwick(**ahrs_input(feed), gain=MADGWICK_GAIN)
    # Its world frame has x north and y west.
    quarter = rotation.from_rotation_vector(np.array([0.0, 0.0, np.pi / 2]))
    return Estimate(feed.times_s, rotation.multiply(quarter, found.Q))


def ahrs_mahony(feed: Feed) -> Estimate:
    """Mahony's filter from PyPI's `ahrs`."""
    from ahrs.filters import Mahony

    found = Mahony(**ahrs_input(feed), k_P=MAHONY_GAIN, k_I=NO_INTEGRAL)
    return Estimate(feed.times_s, found.Q)


def ahrs_input(feed: Feed) -> dict[str, Any]:
    """Samples as `ahrs` expects them: rates less their mean over the start, where every
    recording rests. Between readings of the magnetometer these filters do better
    without a field, which zeros mean, than with the last reading.
    """
    samples = feed.samples
    rest = samples.gyr[: round(CALIBRATION_S * samples.rate_hz)]
    mag = np.where(samples.has_mag[:, None], samples.mag_held, 0.0)
    mag[0] = samples.mag_held[0]  # the filter starts from it
    return {
        "gyr": np.asarray(samples.gyr - rest.mean(axis=0)),
        "acc": samples.acc,
        "mag": mag,
        "frequency": samples.rate_hz,
    }


def fusion(feed: Feed) -> Estimate:
    """x-io's Fusion from PyPI's `imufusion` with its estimate of the bias."""
    import imufusion

    samples = feed.samples
    settings = imufusion.AhrsSettings()
    settings.sample_rate = samples.rate_hz
    settings.convention = imufusion.CONVENTION_ENU
    settings.gain = FUSION_GAIN
    ahrs, bias = imufusion.Ahrs(), imufusion.Bias()
    ahrs.set_settings(settings)
    at_rest = imufusion.BiasSettings()
    at_rest.sample_rate = samples.rate_hz
    bias.set_settings(at_rest)
    gyr_dps, acc_g = np.degrees(samples.gyr), samples.acc / GRAVITY_M_S2
    out = np.empty((len(samples), 4))
    for index, is_new in enumerate(samples.has_mag.tolist()):
        rate = bias.update(gyr_dps[index])
        if is_new:
            ahrs.update(rate, acc_g[index], samples.mag[index])
        else:
            ahrs.update_no_magnetometer(rate, acc_g[index])
        out[index] = ahrs.get_quaternion()
    return Estimate(feed.times_s, out)


ENGINES: dict[str, Engine] = {
    HOST: partial(core, name=MAIN),
    VQF: vqf_defaults,
    OFFLINE: vqf_offline,
    "ahrs-madgwick": ahrs_madgwick,
    "ahrs-mahony": ahrs_mahony,
    "imufusion": fusion,
    **{name: partial(core, name=name) for name in PAPERS},
}

# Engines that take seconds only.
QUICK = (HOST, VQF, OFFLINE, *PAPERS)
