# SPDX-License-Identifier: MIT
"""When a foot rests on the ground, and its path in the world with its errors.

A foot rests where its stance is calm, and its speed, as far as it is known, agrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from imud import rotation
from imud.body import level
from imud.body.stance import (
    FORCE_RANGE_M_S2,
    RATE_RANGE_RAD_S,
    StanceDetector,
    clipped,
)
from imud.body.tracks import BoolArray, Track
from imud.body.zero_velocity import (
    FAR_STANDING,
    SAME_S,
    UNCLIPPED,
    Clipped,
    Step,
    ZeroVelocity,
    smoothed,
)
from imud.rotation import FloatArray

REST_S = 0.02  # of less, so many seconds make a rest
SWING_S = 0.15  # a shorter pause between rests is none
# Nobody steps so soon; but a foot that rolls off its toes may slow down once more.
STEP_S = 0.3
# So calm for so long, and it stands, although its speed seems some sigmas off; and for
# so long, whatever that seems: a foot in the air is so calm for 0.3 s at most.
SURE, SURE_S, SURELY_S, FIRST_S = 1.0, 0.15, 0.5, 0.4
STILL_S = 1.0  # of it show the bias of the rates
GAP_S = 0.1  # without samples, after which the place is unknown
TURNS_RAD_S = math.radians(0.2)  # a heading drifts by so much while it is carried on
MISSED_S = 1.2  # without a rest, and one was missed by who ever runs
LONG_S = 3.0  # without a rest its place is hardly known
# A push on a standing foot also moves it: m/s for a root of an energy.
MOVES_S = 0.01
ALIKE = 0.4  # the share of it that is the same at each rest, and adds up

# The estimate of a probe's own filter: world_from_probe, one-sigma errors of tilt and
# heading in rad; NaN: not known.
Pose = tuple[FloatArray, float, float]


@dataclass(slots=True)
class Rest:
    """A rest of a foot: when it began, when it was last seen, where it is, m, and how
    fast it moves in spite of resting, m/s.
    """

    begin_s: float
    end_s: float
    place: FloatArray
    sigmas: FloatArray
    moves_m_s: float


class Walker:
    """A foot's place from rest to rest, sample by sample."""

    def __init__(self) -> None:
        self.stance = StanceDetector()
        self.filter: ZeroVelocity | None = None
        self.rests = 0
        self.rest: Rest | None = None  # the last one
        self.before: Rest | None = None  # and the one before it
        self.is_down = False
        self.landed: FloatArray | None = None  # what the first moment of a rest showed
        self._calm_s = self._sure_s = self._same_m = 0.0
        self._still_s, self._turned = 0.0, np.zeros(3)
        self._faced_s = self._stood_s = -math.inf

    def update(
        self,
        time_s: float,
        step_s: float,
        measured: tuple[FloatArray, FloatArray],
        pose: Pose,
        clipped: Clipped = UNCLIPPED,
    ) -> Step | None:
        """A sample, `step_s` after the last: rates in rad/s and forces in m/s2 of the
        probe. Returns the step of the place's filter, once it has begun.
        """
        gyr, acc = measured
        self.landed = None
        self.stance.update(step_s, gyr, acc)
        self._calm_s = self._calm_s + step_s if self.stance.is_calm else 0.0
        is_sure = self.stance.energy < SURE
        self._sure_s = self._sure_s + step_s if is_sure else 0.0
        quat, tilt, heading = pose
        step = None
        if self.filter is not None:
            step = self.filter.advance(step_s, gyr, acc, clipped)
            self._weigh(self.filter, step_s, gyr)
        elif self._sure_s >= FIRST_S and np.isfinite([*quat, tilt]).all():
            known = heading if math.isfinite(heading) else 0.0
            self.filter = ZeroVelocity(quat, tilt, known)
            self._faced_s = time_s
        if self._calm_s < REST_S:
            self.is_down = False
        elif self.filter is not None:
            self._stand(self.filter, time_s, gyr, pose)
        return step

    def _weigh(self, filter_: ZeroVelocity, step_s: float, gyr: FloatArray) -> None:
        """A sample of a foot that may stand: a second of them shows the rates' bias."""
        if self._sure_s < SURE_S:
            self._still_s, self._turned = 0.0, np.zeros(3)
            return
        self._still_s += step_s
        self._turned = self._turned + gyr * step_s
        if self._still_s >= STILL_S:
            filter_.still(self._turned / self._still_s)
            self._still_s, self._turned = 0.0, np.zeros(3)

    def _stand(
        self, filter_: ZeroVelocity, time_s: float, gyr: FloatArray, pose: Pose
    ) -> None:
        """A sample at which it seems to stand."""
        sigma = MOVES_S * math.sqrt(self.stance.energy)
        is_new = not self.is_down
        if not is_new and time_s - self._stood_s < SAME_S:
            return
        since_s = time_s - self.rest.end_s if self.rest is not None else math.inf
        if is_new and SWING_S <= since_s < STEP_S and self._sure_s < SURE_S:
            return
        # A foot that glides off slowly from a rest measures no more than a standing
        # one: its error grows.
        must = 0.0
        if is_new and (self._sure_s >= SURELY_S or self._is_due(time_s, sigma)):
            must = math.inf
        elif is_new and self._sure_s >= SURE_S:
            must = FAR_STANDING
        if not filter_.agrees(gyr, sigma, is_new=is_new, must=must):
            self.is_down = False
            if not is_new:
                self._sure_s = 0.0
            return
        change = filter_.stand(gyr, sigma)
        self._stood_s, self.is_down = time_s, True
        quat, _, heading = pose
        if math.isfinite(heading) and math.isfinite(float(quat[0])):
            filter_.face(quat, heading, time_s - self._faced_s)
            self._faced_s = time_s
        if is_new:
            self.landed = change
            if self.rest is None or time_s - self.rest.end_s >= SWING_S:
                self._begin(time_s - self._calm_s)
        if self.rest is not None:
            self.rest.end_s, self.rest.place = time_s, filter_.place
            self.rest.moves_m_s = min(self.rest.moves_m_s, sigma)
            self.rest.sigmas = self.sigmas

    def _is_due(self, time_s: float, sigma: float) -> bool:
        """Whether it stands as calmly as at its last rests, of which some were missed:
        then it is the speed that is wrong.
        """
        rest = self.rest
        if rest is None or self.before is None or time_s - rest.end_s < MISSED_S:
            return False
        return sigma < max(rest.moves_m_s, self.before.moves_m_s)

    def _begin(self, begin_s: float) -> None:
        """A rest."""
        self.rests += 1
        if self.rest is not None:
            self._same_m = self.same_m
        self.before = self.rest
        self.rest = Rest(begin_s, begin_s, np.zeros(3), np.zeros(3), math.inf)

    @property
    def same_m(self) -> float:
        """The common error of all rests that move in the same way, up to the last one,
        m.
        """
        if self.rest is None or self.before is None:
            return 0.0
        passed_s = self.rest.begin_s - self.before.begin_s
        return self._same_m + ALIKE * self.rest.moves_m_s * passed_s

    @property
    def sigmas(self) -> FloatArray:
        """One-sigma errors of its place, m."""
        if self.filter is None:
            return np.full(3, np.nan)
        return np.asarray(np.hypot(self.filter.sigmas, self.same_m))

    @property
    def stride_m(self) -> float | None:
        """The level distance of the last two rests."""
        if self.rest is None or self.before is None:
            return None
        return float(np.hypot(*(self.rest.place - self.before.place)[:2]))


@dataclass(frozen=True, slots=True)
class FootPath:
    """A foot's path: place and one-sigma errors in m, world axes, from its first rest;
    NaN where it is not known. `rests`: first and last row of each rest. `strides`: m,
    level distance from rest to rest. `remarks` for people.
    """

    times_s: FloatArray
    place: FloatArray
    sigmas: FloatArray
    rests: tuple[tuple[int, int], ...]
    strides: FloatArray
    remarks: tuple[str, ...]


def path(track: Track) -> FootPath:
    """The path of a foot's probe, from poses and forces. ValueError without forces."""
    if track.acc is None:
        raise ValueError("the path of a foot needs raw samples: poses have no forces")
    return _Path(track, track.acc).found()


class _Path:
    """Goes through a track once."""

    def __init__(self, track: Track, acc: FloatArray) -> None:
        self._track, self._acc = track, acc
        count = len(track.times_s)
        self.place = np.full((count, 3), np.nan)
        self.sigmas = np.full((count, 3), np.nan)
        self.rests: list[tuple[int, int]] = []
        self.places: list[FloatArray] = []
        self.remarks: list[str] = []
        # Since the last rest: steps, each with the row that it begins at.
        self._swing: list[tuple[int, Step]] = []
        self._row = 0  # the last one stored

    def found(self) -> FootPath:
        track = self._track = faced(self._track)
        steps_s = np.diff(track.times_s, prepend=track.times_s[0])
        both = np.concatenate([track.gyr, self._acc], axis=1)
        is_whole: BoolArray = np.asarray(np.isfinite(both).all(axis=1))
        rates = clipped(track.gyr, RATE_RANGE_RAD_S).tolist()
        forces = clipped(self._acc, FORCE_RANGE_M_S2).tolist()
        walker, missing_s = Walker(), 0.0
        for row, time_s in enumerate(track.times_s.tolist()):
            missing_s += float(steps_s[row])
            if not is_whole[row]:
                continue
            if missing_s > GAP_S and walker.filter is not None:
                self._lose(time_s, missing_s)
                break
            step = walker.update(
                time_s,
                missing_s,
                (track.gyr[row], self._acc[row]),
                (
                    track.quat[row],
                    float(track.tilt_sigma[row]),
                    float(track.heading_sigma[row]),
                ),
                Clipped(rates[row], forces[row]),
            )
            missing_s = 0.0
            self._keep(row, walker, step)
        self._tell_long(walker)
        ends = np.array(self.places).reshape(-1, 3)
        moved = np.diff(ends, axis=0)
        return FootPath(
            track.times_s,
            *(self.place, self.sigmas, tuple(self.rests)),
            np.hypot(moved[:, 0], moved[:, 1]),
            tuple(self.remarks),
        )

    def _keep(self, row: int, walker: Walker, step: Step | None) -> None:
        if walker.filter is None:
            return
        if step is not None:
            self._swing.append((self._row, step))
        self._row = row
        self.place[row] = walker.filter.place
        self.sigmas[row] = walker.sigmas
        if not walker.is_down:
            return
        if walker.landed is not None and self._swing:
            # The path since the last rest, corrected by this rest.
            rows, steps = map(list, zip(*self._swing, strict=True))
            changes, sigmas = smoothed(steps, walker.landed, walker.filter.covariance)
            self.place[rows] += changes
            self.sigmas[rows] = np.hypot(sigmas, walker.same_m)
        self._swing = []
        if walker.rests > len(self.rests):
            self.rests.append((row, row))
            self.places.append(walker.filter.place)
        self.rests[-1] = self.rests[-1][0], row
        self.places[-1] = walker.filter.place

    def _lose(self, time_s: float, missing_s: float) -> None:
        at_s = time_s - float(self._track.times_s[0])
        self.remarks.append(
            f"{missing_s:.1f} s of samples are missing at {at_s:.1f} s: its position "
            "is unknown from there on"
        )

    def _tell_long(self, walker: Walker) -> None:
        """The longest time without a rest, if that is long."""
        times_s = self._track.times_s
        if walker.filter is None:
            self.remarks.append("it never rests, so its position is unknown")
            return
        known = np.flatnonzero(np.isfinite(self.place[:, 0]))
        ends = [*(each[1] for each in self.rests)]
        begins = [*(each[0] for each in self.rests[1:]), int(known[-1])]
        away_s, at_s, row = max(
            (float(times_s[to] - times_s[since]), float(times_s[since]), to)
            for since, to in zip(ends, begins, strict=True)
        )
        if away_s > LONG_S:
            off_m = float(np.linalg.norm(self.sigmas[row]))
            self.remarks.append(
                f"no rest for {away_s:.1f} s from {at_s - times_s[0]:.1f} s on: its "
                f"position error is then up to {2.0 * off_m:.1f} m"
            )


def faced(track: Track) -> Track:
    """With the best early heading in all rows before it: until a compass has settled, a
    filter's own heading is arbitrary or poor. How it turned in a gap is not known.
    """
    away_s = track.times_s - track.times_s[0]
    worth = track.heading_sigma**2 + (TURNS_RAD_S * away_s) ** 2
    known = np.flatnonzero(np.isfinite(worth))
    if not known.size:
        return track
    steps_s = np.diff(track.times_s)
    gaps = 1 + np.flatnonzero(steps_s > GAP_S)
    begin = int(max([0, *gaps[gaps <= known[0]]]))
    end = int(min([len(worth), *gaps[gaps > known[0]]]))
    first = begin + int(np.nanargmin(worth[begin:end]))
    rate_hz = 1.0 / float(np.median(steps_s))
    turns = level.strapdown(np.nan_to_num(track.gyr[begin : first + 1]), rate_hz)
    back = rotation.multiply(track.quat[first], rotation.inverse(turns[-1]))
    quat, sigma = track.quat.copy(), track.heading_sigma.copy()
    quat[begin:first] = rotation.multiply(back, turns[:-1])
    sigma[begin:first] = sigma[first]
    return replace(track, quat=quat, heading_sigma=sigma)
