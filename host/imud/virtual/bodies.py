# SPDX-License-Identifier: MIT
"""Rigid bodies in motion: the paths of their points, and the readings of a sensor on
them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.curves import Curve, Turning


@dataclass(frozen=True, slots=True)
class RigidBody:
    """A rigid body over time: its attitude, and the place of its origin in the world
    (m, east-north-up, shape (n, 3)).
    """

    turning: Turning
    place: Curve

    @classmethod
    def still(cls, quat: FloatArray, count: int) -> RigidBody:
        """A body at rest at the world's origin."""
        return cls(held(quat, count), Curve(*np.zeros((3, count, 3))))

    def at(self, arm: FloatArray) -> Curve:
        """The place of a point of the body; `arm` in m from its origin, body frame."""
        turning = self.turning
        speed = np.cross(turning.rate, arm)
        force = np.cross(turning.acceleration, arm) + np.cross(turning.rate, speed)
        return self.place + Curve(
            rotation.rotate(turning.quat, arm),
            rotation.rotate(turning.quat, speed),
            rotation.rotate(turning.quat, force),
        )

    def hinged(self, arm: FloatArray, turning: Turning) -> RigidBody:
        """Another body, hinged at a point of this one and turned about it."""
        return RigidBody(self.turning.then(turning), self.at(arm))

    def specific_force(self) -> FloatArray:
        """Specific force at the origin, m/s2, body frame: +g up at rest."""
        up = np.array([0.0, 0.0, GRAVITY_M_S2])
        return rotation.rotate(
            rotation.inverse(self.turning.quat), self.place.second + up
        )


def held(quat: FloatArray, count: int) -> Turning:
    """An attitude that does not change."""
    still = np.zeros((count, 3))
    return Turning(np.broadcast_to(quat, (count, 4)), still, still)
