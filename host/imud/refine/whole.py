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
from imud.refine.checks import OWN_KNOWN_UT, Doubt, doubts_of
from imud.refine.model import TURN, BoolArray, Priors, Recording
from imud.refine.reach import searched
from imud.refine.window import Before, Window
from imud.rotation import FloatArray

KEPT_S, AHEAD_S = 300.0, 60.0
FADE_S = 30.0  # in which a window takes over from the one before it
# Stated beside the covariance's: what a chip's tilt is off by where nothing shows it,
# and what linear equations leave out; more of it where no hand holds the sensor, and
# for a magnetometer that is not calibrated in a room whose field is uneven.
TILT_LEAST_DEG, TILT_SHARE = 0.1, 1.25
FAR_SHARE, UNKNOWN_SHARE = 1.4, 1.4
# Of changes of the heading: the gyroscope's noise in the model is ten times a chip's,
# since it stands for what has no place there.
CHANGE_SHARE = 0.6
HAND_M_S = 1.0
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
    doubts: tuple[Doubt, ...]
    window: Window


def parts_of(
    recording: Recording,
    priors: Priors,
    delay_s: float = 0.0,
    tell: Callable[[float], None] = lambda _: None,
) -> Iterator[Part]:
    """All of it, a window at a time. `delay_s`: by which samples are later than what
    they measure; `tell` is told the share that is done.
    """
    kept, ahead = (round(s / recording.node_s) for s in (KEPT_S, AHEAD_S))
    count, start = recording.count, 0
    before: Before | None = None
    first = FirstPose()
    seam: FloatArray | None = None
    while start < count:
        is_last = count - start <= kept + ahead
        end = count if is_last else start + kept + ahead
        part = recording.part(start, end)
        done = start / count

        def told(share: float, done: float = done, size: int = end - start) -> None:
            tell(done + share * size / count)

        window = searched(part, priors, before, told)
        keep = end - start if is_last else kept
        quats = window.course.late(-delay_s * recording.rate_hz)
        sigmas = _sigmas(window, keep, first)
        samples = keep * recording.each
        yield _faded(window, quats[:samples], sigmas, seam)
        if is_last:
            return
        seam = quats[samples]
        before = window.known_before(keep)
        start += keep


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
        tilt = change = np.full(len(quats), np.nan)
    if doubts:
        heading = np.full(len(quats), np.nan)
    is_rest = np.repeat(window.is_rest, recording.each)[: len(quats)]
    return Part(quats, tilt, heading, change, is_rest, doubts, window)


@dataclass(slots=True)
class FirstPose:
    """What the heading of the first pose shares with that of a window's first."""

    variance: float = math.nan  # of the first pose's heading, rad2
    share: float = 1.0  # its covariance with the window's first, over that's variance

    def changes(self, window: Window, keep: int, own: FloatArray) -> FloatArray:
        """Variances of the heading's change since the first pose, at each node.
        `own`: of the heading.
        """
        if math.isnan(self.variance):
            self.variance = float(own[0])
        common = self.share * window.solution.covariance_with(0, UPRIGHT)[:, UPRIGHT]
        found = own + self.variance - 2.0 * common
        self.share = float(common[keep] / own[keep])
        return np.maximum(found, 0.0)


def _sigmas(window: Window, keep: int, first: FirstPose) -> FloatArray:
    """Of tilt, heading and its changes, in degrees, for the first `keep` intervals."""
    variances = np.diagonal(window.solution.covariances(), axis1=1, axis2=2)
    priors = window.priors
    share = TILT_SHARE * (FAR_SHARE if priors.speed > HAND_M_S else 1.0)
    level = share * np.degrees(np.sqrt(variances[:, TURN][:, :2].mean(axis=1)))
    heading = variances[:, UPRIGHT]
    change = CHANGE_SHARE * np.sqrt(first.changes(window, keep, heading))
    if priors.own > OWN_KNOWN_UT:
        heading = heading * UNKNOWN_SHARE**2
    each = window.recording.each
    at = (np.arange(keep * each) + 1.0) / each
    nodes = np.arange(len(variances))
    sigmas = np.hypot(TILT_LEAST_DEG, level), *np.degrees((np.sqrt(heading), change))
    return np.stack([np.interp(at, nodes, sigma) for sigma in sigmas])
