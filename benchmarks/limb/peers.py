# SPDX-License-Identifier: MIT
"""Joint angles as others have them, from the same samples as ours."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.common.engines import ENGINES, VQF, Engine
from benchmarks.common.feed import Feed
from imud import rotation
from imud.body import angles, chain
from imud.body.posture import Posture
from imud.rotation import FloatArray
from imud.virtual import leg
from imud.virtual.leg_probes import USUAL

STOOD_S = (1.0, 5.5)


def opensense(feeds: Mapping[str, Feed], times_s: FloatArray) -> Posture:
    """VQF for each probe; a pose aligns, and the thigh's probe says what is ahead.

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
