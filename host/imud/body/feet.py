# SPDX-License-Identifier: MIT
"""A foot as it walks, live: when it rests on the ground, and how far each stride is."""

from __future__ import annotations

from collections import deque

import numpy as np

from imud import rotation
from imud.body import contact
from imud.body.state import Contact, Vector
from imud.rotation import FloatArray

SWING_MAX_S = 3.0  # a longer one is not followed: its end is far from where it seems


class Foot:
    """One segment with `contact`."""

    def __init__(self) -> None:
        self.is_down = False
        self._rests = 0
        self._stride_m: float | None = None
        self._place: FloatArray | None = None
        self._calm_since_s: float | None = None
        self._last_s: float | None = None
        # Time and level force in the world without gravity, since the last rest.
        self._swing: deque[tuple[float, FloatArray | None]] = deque()

    def update(
        self, time_s: float, quat: FloatArray, gyr: FloatArray, acc: FloatArray | None
    ) -> None:
        """A moment: world_from_probe (4,), rates rad/s and forces m/s2 of the probe."""
        if self._last_s is not None and time_s - self._last_s > contact.SWING_S:
            self.lose()
        self._last_s = time_s
        force = None
        if acc is not None:
            force = rotation.rotate(quat, acc)
            force[2] -= contact.GRAVITY_M_S2
        self._swing.append((time_s, force))
        if time_s - self._swing[0][0] > SWING_MAX_S:
            self._swing.popleft()
        is_calm = bool(np.linalg.norm(gyr) < contact.RATE_MAX)
        if acc is not None:
            off = abs(float(np.linalg.norm(acc)) - contact.GRAVITY_M_S2)
            is_calm &= off < contact.FORCE_MAX_M_S2
        if not is_calm:
            self._calm_since_s = None
            self.is_down = False
            return
        if self._calm_since_s is None:
            self._calm_since_s = time_s
        if self.is_down:
            self._swing.clear()
            self._swing.append((time_s, force))
        elif time_s - self._calm_since_s >= contact.REST_S:
            self._land(self._calm_since_s)

    def lose(self) -> None:
        """Its probe is missing: nothing is known of the next stride."""
        self.is_down, self._calm_since_s = False, None
        self._place = None
        self._swing.clear()

    def _land(self, at_s: float) -> None:
        """It rests since `at_s`."""
        self.is_down = True
        rows = [each for each in self._swing if each[0] <= at_s]
        passed = at_s - rows[0][0] if rows else 0.0
        if self._rests and passed < contact.SWING_S:
            return  # a tremor within a rest
        self._rests += 1
        forces = [force for _, force in rows if force is not None]
        if self._place is None or len(forces) < len(rows) or passed > SWING_MAX_S:
            self._stride_m, self._place = None, np.zeros(3)
            return
        times_s = np.array([time_s for time_s, _ in rows])
        way = contact.swing(times_s, np.array(forces))[-1]
        self._stride_m = float(np.hypot(way[0], way[1]))
        self._place = self._place + way

    def state(self) -> Contact:
        place: Vector | None = None
        if self._place is not None:
            x, y, z = (round(each, 4) for each in self._place.tolist())
            place = x, y, z
        stride = None if self._stride_m is None else round(self._stride_m, 4)
        return Contact(
            is_down=self.is_down,
            rests=self._rests,
            stride_m=stride,
            place_m=place,
        )
