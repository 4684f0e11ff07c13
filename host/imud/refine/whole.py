# SPDX-License-Identifier: MIT
"""A recording of any length: windows that follow each other, each of which begins with
what is known by all before it, and looks ahead of what it keeps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.refine.checks import OWN_KNOWN_UT, Doubt, doubts_of, doubts_of_readings
from imud.refine.model import (
    ACC,
    ACC_BIAS,
    FIELD,
    GYR,
    MAG,
    OWN,
    TURN,
    BoolArray,
    Estimate,
    Priors,
    Recording,
)
from imud.refine.reach import off_by, searched
from imud.refine.strapdown import course_of
from imud.refine.window import Before, Window
from imud.rotation import FloatArray

KEPT_S, AHEAD_S = 300.0, 60.0
FADE_S = 30.0  # in which a window takes over from the one before it
# Stated beside the covariance's: what a chip's tilt is off by where nothing shows it,
# and what linear equations leave out; more of it where no hand holds the sensor, and
# for a magnetometer that is not calibrated in a room whose field is uneven.
TILT_LEAST_DEG, TILT_SHARE = 0.1, 1.25
FAR_SHARE, UNKNOWN_SHARE = 1.4, 1.4
# How far sound sensors are from their calibrations, in sigmas of these, on nine tenths
# of the recordings and more.
USUAL_SIGMAS = (2.5, 2.0, 1.25)
RESTLESS_SHARE = 1.5  # and where no rest tells level and bias
# Of changes of the heading: the gyroscope's noise in the model is ten times a chip's,
# since it stands for what has no place there.
CHANGE_SHARE = 0.7
HAND_M_S = 1.0
FIELD_LEAST_UT = 5.0  # the earth's is 25 and more
NUMBER_MOST = 1e5  # rad/s, m/s2 or uT: no sensor reads that
UNSOLVED = Doubt("its readings determine no poses", True)
UPRIGHT = TURN.stop - 1  # about up: heading


@dataclass(frozen=True, slots=True)
class Part:
    """Poses of n samples that follow those of the part before, with one-sigma errors
    in degrees: NaN where they are withheld, for the reasons in `doubts`.
    """

    quats: FloatArray  # (n, 4), world_from_body
    tilt_deg: FloatArray
    heading_deg: FloatArray
    change_deg: FloatArray  # of the heading since the first pose
    is_rest: BoolArray
    fields: FloatArray  # (intervals, 3), in the world, uT
    doubts: tuple[Doubt, ...]


def parts_of(
    recording: Recording,
    priors: Priors,
    delay_s: float = 0.0,
    tell: Callable[[float], None] = lambda _: None,
) -> Iterator[tuple[Part, Window | None]]:
    """All of it, a window at a time; None: it has no estimate. `delay_s`: by which
    samples are later than what they measure; `tell` is told the share that is done.
    """
    kept, ahead = (round(s / recording.node_s) for s in (KEPT_S, AHEAD_S))
    count, start = recording.count, 0
    before: Before | None = None
    first = FirstPose()
    seam: FloatArray | None = None
    while start < count:
        is_last = count - start <= kept + ahead
        end = count if is_last else start + kept + ahead
        part = usable(recording.part(start, end))
        done = start / count

        def told(share: float, done: float = done, size: int = end - start) -> None:
            tell(done + share * size / count)

        keep = end - start if is_last else kept
        samples = keep * recording.each
        try:
            with np.errstate(all="ignore"):  # what is not finite ends the search
                window = searched(part, priors, before, told)
                quats = window.course.late(-delay_s * recording.rate_hz)
                sigmas = _sigmas(window, keep, first)
                found = _faded(window, quats[:samples], sigmas, seam)
                before = None if is_last else window.known_before(keep)
        except np.linalg.LinAlgError:
            found = _without(part.part(0, keep), seam)
            before, seam, first = None, found.quats[-1], FirstPose(is_lost=True)
            yield found, None
        else:
            seam = None if is_last else quats[samples]
            yield found, window
            del window  # hundreds of MB, while the next one is searched
        start += keep


def usable(recording: Recording) -> Recording:
    """The same without numbers that are none, and without a dead magnetometer."""
    gyr, acc, mag = recording.gyr, recording.acc, recording.mag
    # Comparisons with NaN are false.
    is_good = np.asarray((np.abs(np.hstack([gyr, acc])) < NUMBER_MOST).all(axis=1))
    if not is_good.all():
        gyr, acc = (np.where(is_good[:, None], rows, 0.0) for rows in (gyr, acc))
    is_read: BoolArray = np.asarray((np.abs(mag) < NUMBER_MOST).all(axis=1))
    sizes = np.linalg.norm(mag[is_read], axis=1)
    if len(sizes) and np.median(sizes) < FIELD_LEAST_UT:
        is_read[:] = False
    mag = np.where(is_read[:, None], mag, np.nan)
    is_bad = ~is_good
    if recording.is_bad is not None:
        is_bad |= recording.is_bad
    return Recording(recording.rate_hz, gyr, acc, mag, is_bad)


def _without(recording: Recording, seam: FloatArray | None) -> Part:
    """Poses by the gyroscope alone, of which nothing is stated."""
    estimate = Estimate.begun(recording.count)
    if seam is not None:
        estimate.first = seam
    quats = course_of(recording, estimate, np.zeros(3)).ends
    unknown = np.full(len(quats), np.nan)
    is_rest, fields = np.zeros(len(quats), bool), estimate.states[1:, FIELD]
    doubts = UNSOLVED, *doubts_of_readings(recording)
    return Part(quats, unknown, unknown, unknown, is_rest, fields, doubts)


def _faded(
    window: Window, quats: FloatArray, sigmas: FloatArray, seam: FloatArray | None
) -> Part:
    """A part that begins with the pose `seam`. What the two windows differ by there
    is stated, too.
    """
    recording = window.recording
    tilt, heading, change = sigmas
    if seam is not None:
        off = rotation.to_rotation_vector(
            rotation.multiply(seam, rotation.inverse(quats[0]))
        )
        left = np.clip(1.0 - np.arange(len(quats)) / (FADE_S * recording.rate_hz), 0, 1)
        turns = rotation.from_rotation_vector(left[:, None] * off)
        quats = rotation.multiply(turns, quats)
        level, about_up = (left * math.degrees(x) for x in (np.hypot(*off[:2]), off[2]))
        tilt = np.hypot(tilt, level)
        heading, change = np.hypot(heading, about_up), np.hypot(change, about_up)
    doubts = doubts_of(window)
    if any(each.is_of_all for each in doubts):
        tilt = np.full(len(quats), np.nan)
    if any(each.is_of_all or each.is_of_changes for each in doubts):
        change = np.full(len(quats), np.nan)
    if doubts:
        heading = np.full(len(quats), np.nan)
    is_rest = np.repeat(window.is_rest, recording.each)[: len(quats)]
    fields = window.estimate.states[: len(quats) // recording.each, FIELD].copy()
    return Part(quats, tilt, heading, change, is_rest, fields, doubts)


@dataclass(slots=True)
class FirstPose:
    """What the heading of the first pose shares with that of a window's first."""

    variance: float = math.nan  # of the first pose's heading, rad2
    share: float = 1.0  # its covariance with the window's first, over that's variance
    is_lost: bool = False  # a window without an estimate is between

    def changes(self, window: Window, keep: int, own: FloatArray) -> FloatArray:
        """Variances of the heading's change since the first pose, at each node.
        `own`: of the heading.
        """
        if self.is_lost:
            return np.full(len(own), np.nan)
        if math.isnan(self.variance):
            self.variance = float(own[0])
        common = self.share * window.solution.covariance_with(0, UPRIGHT)[:, UPRIGHT]
        found = own + self.variance - 2.0 * common
        self.share = float(common[keep] / own[keep])
        return np.maximum(found, 0.0)


def _surprises(window: Window) -> tuple[float, float, float]:
    """Factors of what is stated, where a sensor is farther from its calibration than it
    said: accelerometer, gyroscope, magnetometer.
    """
    own = float(np.abs(window.estimate.states[0, OWN]).max()) / window.priors.own
    off = (
        math.hypot(off_by(window, ACC), off_by(window, ACC_BIAS)),
        off_by(window, GYR),
        math.hypot(off_by(window, MAG), own),
    )
    acc, gyr, mag = (max(1.0, a / b) for a, b in zip(off, USUAL_SIGMAS, strict=True))
    return acc, gyr, mag


def _sigmas(window: Window, keep: int, first: FirstPose) -> FloatArray:
    """Of tilt, heading and its changes, in degrees, for the first `keep` intervals."""
    variances = np.diagonal(window.solution.covariances(), axis1=1, axis2=2)
    priors = window.priors
    share = FAR_SHARE if priors.speed > HAND_M_S else 1.0
    if window.before is None and not window.is_rest.any():
        share *= RESTLESS_SHARE
    acc, gyr, mag = _surprises(window)
    level = np.degrees(np.sqrt(variances[:, TURN][:, :2].mean(axis=1)))
    level *= TILT_SHARE * share * max(acc, gyr)
    heading = variances[:, UPRIGHT]
    change = np.sqrt(first.changes(window, keep, heading))
    change *= CHANGE_SHARE * share * gyr
    heading = heading * (mag if priors.own <= OWN_KNOWN_UT else UNKNOWN_SHARE) ** 2
    each = window.recording.each
    at = (np.arange(keep * each) + 1.0) / each
    nodes = np.arange(len(variances))
    sigmas = np.hypot(TILT_LEAST_DEG, level), *np.degrees((np.sqrt(heading), change))
    return np.stack([np.interp(at, nodes, sigma) for sigma in sigmas])
