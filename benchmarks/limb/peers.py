# SPDX-License-Identifier: MIT
"""Joint angles by other methods, from the same samples."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.common.engines import ENGINES, VQF, Engine
from benchmarks.common.feed import Feed
from imud import rotation
from imud.body import angles, chain, fused, heading, hinge, joints
from imud.body.posture import Posture
from imud.body.tracks import Track
from imud.calibration.algebra import across
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual import leg
from imud.virtual.leg_probes import USUAL
from imud.virtual.motion import Motion

STOOD_S = (1.0, 5.5)
HEADING_S = 5.0  # time constant of the heading between two probes
# Below both a foot rests; a shorter rest is none, a shorter swing ends none.
RATE_MAX_RAD_S, FORCE_MAX_M_S2 = np.radians(40.0), 1.5
REST_S, SWING_S = 0.12, 0.15


def opensense(feeds: Mapping[str, Feed], times_s: FloatArray) -> Posture:
    """VQF for each probe; a pose aligns, and the thigh's probe defines what is ahead.

    A. Al Borno et al., OpenSense, J. NeuroEng. Rehabil. 19:22, 2022.
    """
    quats = _quats(ENGINES[VQF], feeds, times_s)
    is_stood = (times_s > STOOD_S[0]) & (times_s < STOOD_S[1])
    base = rotation.multiply(_mean(quats["thigh"][is_stood]), rotation.inverse(USUAL))
    x, y, _ = rotation.rotate(base, np.array([1.0, 0.0, 0.0]))
    upright = rotation.from_matrix(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))
    facing = np.array([0.0, 0.0, np.arctan2(y, x)])
    stood = rotation.multiply(rotation.from_rotation_vector(facing), upright)
    aligned = {
        name: rotation.multiply(
            each, rotation.multiply(rotation.inverse(_mean(each[is_stood])), stood)
        )
        for name, each in quats.items()
    }
    return _posture(aligned, times_s)


def rozanowski(feeds: Mapping[str, Feed], times_s: FloatArray) -> Posture:
    """Madgwick's filter for each probe, taken to sit as it is meant to."""
    quats = _quats(ENGINES["madgwick"], feeds, times_s)
    worn = {
        name: rotation.multiply(each, rotation.inverse(USUAL))
        for name, each in quats.items()
    }
    return _posture(worn, times_s)


def one_degree(parent: Motion, child: Motion, pose: tuple[float, float]) -> FloatArray:
    """The angle of a hinge, rad, (n,), zero in the mean of the pose, without a compass:
    its one degree of freedom shows the heading between both probes at each moment,
    weighted by how level the axis is and low-passed forwards and backwards.

    D. Laidig, T. Schauer, T. Seel, IEEE ICORR 2017:971. The axis: T. Seel 2014.
    """
    tracks = [_inertial(each) for each in (parent, child)]
    moving = [each.between(pose[1], np.inf) for each in tracks]
    seen = hinge.axis(moving[0].gyr, moving[1].gyr, parent.rate_hz, joints.RESIDUAL_MAX)
    found = [
        _corrected(tracks[0], tracks[1], seen.parent, sign * seen.child)
        for sign in (1.0, -1.0)
    ]
    (_, angle) = min(found, key=lambda each: each[0])
    stood = (tracks[0].times_s >= pose[0]) & (tracks[0].times_s < pose[1])
    return np.unwrap(angle) - float(np.angle(np.exp(1j * angle[stood]).mean()))


def rests_by_thresholds(track: Track) -> list[tuple[float, float]]:
    """From and to, s, of each rest of a foot, by fixed thresholds."""
    assert track.acc is not None
    off = np.abs(np.linalg.norm(track.acc, axis=1) - GRAVITY_M_S2)
    rates = np.linalg.norm(track.gyr, axis=1)
    is_calm = (rates < RATE_MAX_RAD_S) & (off < FORCE_MAX_M_S2)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_calm, [0]])))
    found: list[tuple[float, float]] = []
    for first, end in edges.reshape(-1, 2).tolist():
        begin_s, end_s = float(track.times_s[first]), float(track.times_s[end - 1])
        if found and begin_s - found[-1][1] < SWING_S:
            found[-1] = found[-1][0], end_s
        else:
            found.append((begin_s, end_s))
    return [each for each in found if each[1] - each[0] >= REST_S]


def _inertial(motion: Motion) -> Track:
    times_s = np.arange(len(motion)) / motion.rate_hz
    return fused.attitudes(
        times_s, motion.gyr, motion.acc, np.full_like(motion.mag, np.nan)
    )


def _corrected(
    parent: Track, child: Track, first: FloatArray, second: FloatArray
) -> tuple[float, FloatArray]:
    """The residual of the axes, and the angle."""
    ends = [
        rotation.rotate(track.quat, axis)
        for track, axis in ((parent, first), (child, second))
    ]
    (x1, y1, _), (x2, y2, _) = ends[0].T, ends[1].T
    weighted = (x1 + 1j * y1) * (x2 - 1j * y2)
    step = float(np.median(np.diff(parent.times_s)))
    share = step / HEADING_S
    for _ in range(2):
        state, smoothed = 0j, np.empty_like(weighted)
        for index, each in enumerate(weighted):
            state += (each - state) * max(share, 1.0 / (index + 1))
            smoothed[index] = state
        weighted = smoothed[::-1]
    stepped = rotation.multiply(heading.about_up(np.angle(weighted)), child.quat)
    left = rotation.rotate(stepped, second) - ends[0]
    turn = rotation.multiply(rotation.inverse(parent.quat), stepped)
    # To a frame of both whose axes lie on each other.
    seen = rotation.rotate(turn, across(second))
    angle = angles.about(first, np.broadcast_to(across(first), seen.shape), seen)
    return float((left**2).mean()), angle


def _quats(
    engine: Engine, feeds: Mapping[str, Feed], times_s: FloatArray
) -> dict[str, FloatArray]:
    found = {}
    for name, feed in feeds.items():
        estimate = engine(feed)
        found[name] = rotation.interpolate(times_s, estimate.times_s, estimate.quats)
    return found


def _mean(quats: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.eigh(quats.T @ quats)[1][:, -1])


def _posture(quats: Mapping[str, FloatArray], times_s: FloatArray) -> Posture:
    body = chain.read(leg.CHAIN, "leg")
    found = {
        child.name: angles.joint_angles(
            quats[parent.name], quats[child.name], child.joint, body.side
        )
        for parent, child in body.joints()
    }
    return Posture(times_s, dict(quats), found, {})
