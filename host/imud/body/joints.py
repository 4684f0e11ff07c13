# SPDX-License-Identifier: MIT
"""A joint's axes and centre, found from a motion.

For joints of one and two degrees of freedom about any axes; of a free joint only the
centre can be known.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace

import numpy as np

from imud import rotation
from imud.body import heading, hinge, tracks
from imud.body.chain import Joint
from imud.body.heading import BoolArray, Sight
from imud.body.hinge import AlignmentRefused
from imud.body.tracks import Track
from imud.rotation import FloatArray

ROUNDS = 4  # of axes by headings and headings by axes
STARTS = 24
PLAY_MIN = math.radians(0.5)
NOISE_MIN = 0.1  # m/s2, of forces at a centre
SPREAD_MIN = 0.01  # of the turns of a joint, about 8 degrees rms
CONSTANT = 1e-9
# Drift between two headings without the slide of their filters: that of gyroscopes, rad
# for a root of a second.
WALK = math.radians(0.4)
# Inside a building the fields at two places differ by more than a probe at rest states.
INDOORS = math.radians(6.0)
# Loose probes shake: the residual of the axes by their attitudes decides.
RESIDUAL_MAX = 0.7
PLAY_MAX = math.radians(12.0)
AXES = {1: "hinge", 2: "pair of axes"}


@dataclass(frozen=True, slots=True)
class JointModel:
    """A joint in the frames of the probes beside it.

    `axes`: unit vectors in the parent's and the child's probe: one axis of a hinge, or
    two that keep an angle with this `cosine`; `play`: rms of what they do not, rad.
    `arms`: the centre from each probe, m; `noise`: of the forces there, m/s2.
    """

    joint: Joint
    axes: tuple[FloatArray, FloatArray] | None = None
    play: float = 0.0
    cosine: float = 1.0
    arms: tuple[FloatArray, FloatArray] | None = None
    noise: float = 0.0

    def sights(self, parent: Track, child: Track) -> list[Sight]:
        """The sights of both probes on the heading between them."""
        stated = np.stack([parent.heading_sigma, child.heading_sigma], axis=1)
        found = [heading.magnetic(stated, INDOORS if self.joint.freedom else 0.0)]
        if self.axes is not None:
            first, second = (
                rotation.rotate(track.quat, axis)
                for track, axis in zip((parent, child), self.axes, strict=True)
            )
            if self.joint.freedom == 2:
                found.append(heading.of_angle(first, second, self.cosine, self.play))
            else:
                found.append(heading.of_axis(first, second, self.play))
        if self.arms is not None and parent.acc is not None and child.acc is not None:
            forces = _forces((parent, parent.acc), (child, child.acc), self.arms)
            found.append(heading.of_forces(*forces, self.noise))
        return found

    def at_rest(
        self, parent: Track, child: Track, rows: BoolArray
    ) -> tuple[float, float]:
        """The child's heading in rows in which nothing moves, and its sigma, rad.

        A filter's own heading slides while it learns the field, and all moments have
        the same errors, so together they count as one measurement.
        """
        sights = self.sights(parent, child)
        turns, sigmas = _turns(parent, child, sights)
        step = heading.HeadingFilter(
            float(np.nanmean(turns[rows])),
            float(np.nanmean(sigmas[rows])) ** 2,
        )
        for sight in sights[1:]:
            seen, variance = sight.turns[rows], sight.variance[rows]
            good = np.isfinite(variance)
            if good.any():
                mean = np.angle(np.exp(1j * seen[good]).mean(axis=0))
                step.update(0.0, [(mean.tolist(), float(variance[good].mean()), 0.0)])
                step.last_s = None
        # A loose probe does not rest in its mean attitude.
        return step.turn, math.hypot(step.sigma, self.play / 2.0)

    def turns(self, parent: Track, child: Track) -> tuple[FloatArray, FloatArray]:
        """The child's heading by all of a recording, and its sigma, rad, (n,)."""
        return _turns(parent, child, self.sights(parent, child))


def _turns(
    parent: Track, child: Track, sights: list[Sight]
) -> tuple[FloatArray, FloatArray]:
    is_there = np.isfinite(parent.quat[:, 0]) & np.isfinite(child.quat[:, 0])
    # The slide of both filters is known, so it is no error of the heading between them.
    slid = tracks.slides(child) - tracks.slides(parent)
    seen = [replace(each, turns=each.turns + slid[:, None]) for each in sights]
    step = heading.HeadingFilter(walk=WALK)
    found = heading.follow(step, parent.times_s, is_there, seen)
    turns, sigmas = heading.smoothed(parent.times_s, *found, WALK)
    return turns - slid, sigmas


def learn(joint: Joint, parent: Track, child: Track) -> JointModel:
    """The joint by a motion of both probes at equal times. Raises AlignmentRefused."""
    known = _centred(joint, parent, child)
    if joint.freedom == 1:
        return _hinge(known, parent, child)
    if joint.freedom == 2:
        return _universal(known, parent, child)
    return known


def _rows(parent: Track, child: Track) -> tuple[Track, Track]:
    """The rows in which both are there."""
    both = np.concatenate([parent.gyr, child.gyr], axis=1)
    good = np.asarray(np.isfinite(both).all(axis=1))
    return parent.rows(good), child.rows(good)


def _centred(joint: Joint, parent: Track, child: Track) -> JointModel:
    """With its centre, if forces show one."""
    one, other = _rows(parent, child)
    if one.acc is None or other.acc is None or len(one.times_s) < hinge.ROWS_MIN:
        return JointModel(joint)
    rate_hz = 1.0 / float(np.median(np.diff(one.times_s)))
    with contextlib.suppress(AlignmentRefused):
        found = hinge.centre((one.gyr, one.acc), (other.gyr, other.acc), rate_hz)
        arms = found.parent, found.child
        forces = _forces((one, one.acc), (other, other.acc), arms)
        up = [force[:, 2] for force in forces]
        noise = float(np.sqrt(np.mean((up[0] - up[1]) ** 2) / 2.0))
        return JointModel(joint, arms=arms, noise=max(noise, NOISE_MIN))
    return JointModel(joint)


_Felt = tuple[Track, FloatArray]  # a probe, and its specific forces


def _forces(
    parent: _Felt, child: _Felt, arms: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """The forces at the centre in each probe's world, m/s2."""
    found = []
    for (track, acc), arm in zip((parent, child), arms, strict=True):
        rate_hz = 1.0 / float(np.median(np.diff(track.times_s)))
        there = acc + hinge.levers(track.gyr, rate_hz) @ arm
        found.append(rotation.rotate(track.quat, there))
    return found[0], found[1]


def _hinge(known: JointModel, parent: Track, child: Track) -> JointModel:
    one, other = _rows(parent, child)
    if len(one.times_s) < hinge.ROWS_MIN:
        raise AlignmentRefused("no motion to align by")
    rate_hz = 1.0 / float(np.median(np.diff(one.times_s)))
    seen = hinge.axis(one.gyr, other.gyr, rate_hz, RESIDUAL_MAX)
    tried = [
        _refined(replace(known, axes=(seen.parent, sign * seen.child)), one, other)
        for sign in (1.0, -1.0)
    ]
    found = min(tried, key=lambda each: _across(each, one, other))
    _check(found)
    return found


def _check(found: JointModel) -> None:
    """Raises AlignmentRefused if a joint turns too much beside its axes."""
    if found.play > PLAY_MAX:
        left_deg = math.degrees(found.play)
        raise AlignmentRefused(
            f"no {AXES[found.joint.freedom]} fits: the residual is {left_deg:.0f} deg"
        )


def _refined(known: JointModel, parent: Track, child: Track) -> JointModel:
    """Its axes by the constant part of the turn between both probes."""
    known = replace(known, play=math.radians(known.joint.play_deg))
    for _ in range(ROUNDS):
        turn = rotation.to_matrix(between(known, parent, child))
        left, sizes, right = np.linalg.svd(turn.mean(axis=0))
        axes = left[:, 0], right[0]
        z1, z2 = (
            rotation.rotate(track.quat, axis)[:, 2]
            for track, axis in zip((parent, child), axes, strict=True)
        )
        level = float(np.mean(1.0 - z1 * z1))
        play = math.sqrt(float(np.mean((z1 - z2) ** 2)) / max(level, 0.1))
        known = replace(known, axes=axes, play=max(play, PLAY_MIN))
    if 1.0 - sizes[1] < SPREAD_MIN:
        raise AlignmentRefused("it hardly turned; bend it further")
    return known


def between(known: JointModel, parent: Track, child: Track) -> FloatArray:
    """parent_from_child of both probes, headings in step, (n, 4)."""
    turns, _ = known.turns(parent, child)
    stepped = rotation.multiply(heading.about_up(turns), child.quat)
    return rotation.multiply(rotation.inverse(parent.quat), stepped)


def _across(known: JointModel, parent: Track, child: Track) -> float:
    """Mean square of the rates between both that are not about the hinge."""
    axis = known.axes[0] if known.axes is not None else np.zeros(3)
    turn = between(known, parent, child)
    rate = rotation.rotate(turn, child.gyr) - parent.gyr
    along = (rate @ axis)[:, None] * axis
    return float(((rate - along) ** 2).mean())


def _universal(known: JointModel, parent: Track, child: Track) -> JointModel:
    one, other = _rows(parent, child)
    if len(one.times_s) < hinge.ROWS_MIN:
        raise AlignmentRefused("no motion to align by")
    for _ in range(ROUNDS):
        turn = rotation.to_matrix(between(known, one, other))
        axes, cosine, play = _pair(turn)
        known = replace(known, axes=axes, cosine=cosine, play=max(play, PLAY_MIN))
    if (1.0 - np.linalg.svd(turn.mean(axis=0))[1][:2]).min() < SPREAD_MIN:
        raise AlignmentRefused(
            "it hardly turned about one of its axes; bend it further"
        )
    _check(known)
    return known


def _pair(
    turn: FloatArray,
) -> tuple[tuple[FloatArray, FloatArray], float, float]:
    """Two axes that keep their angle over rotation matrices (n, 3, 3), its cosine, and
    its rms residual.
    """
    starts = np.random.default_rng(0).standard_normal((STARTS, 3))
    tried = [_settled(turn, each / np.linalg.norm(each)) for each in starts]
    play, first, second = min(tried, key=lambda each: each[0])
    return (first, second), float((turn @ second @ first).mean()), play


def _settled(
    turn: FloatArray, second: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """The residual, and both axes, from a first guess of the second one."""
    cost = np.inf
    while True:
        first = _steadiest(turn @ second)
        second = _steadiest(np.swapaxes(turn, 1, 2) @ first)
        now = float((turn @ second @ first).std())
        if cost - now < CONSTANT:
            return now, first, second
        cost = now


def _steadiest(vectors: FloatArray) -> FloatArray:
    """The direction along which vectors (n, 3) change least."""
    off = vectors - vectors.mean(axis=0)
    return np.asarray(np.linalg.eigh(off.T @ off)[1][:, 0])
