# SPDX-License-Identifier: MIT
"""How far a person is with the motion that aligns a body: how long it has stood still,
and how often each joint has bent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from imud import rotation
from imud.body import session
from imud.body.chain import Chain
from imud.body.tracks import Track
from imud.rotation import FloatArray

BENT_RAD, STRAIGHT_RAD = math.radians(25.0), math.radians(15.0)


class Following:
    """Follows tracks of all segments with a probe, piece by piece. `bends`: by child,
    since begin(). `still_s`: of rest after them, before begin() of any rest.
    """

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self.still_s = 0.0
        self.bends: dict[str, int] = {}
        self._straight: dict[str, FloatArray] = {}  # child from parent, of the probes
        self._bent: set[str] = set()

    def begin(self) -> None:
        """The body is straight now, and will move."""
        self.bends = {child.name: 0 for _, child in self._chain.joints()}
        self._straight.clear()
        self._bent.clear()

    def add(self, found: Mapping[str, Track]) -> None:
        """The next piece, at equal steps; empty: a probe is away."""
        if not found:
            self.still_s = 0.0
            return
        times_s = next(iter(found.values())).times_s
        step_s = float(times_s[1] - times_s[0])
        moves = np.flatnonzero(~session.is_still(found))
        since = -step_s * int(moves[-1] + 1) if len(moves) else self.still_s
        self.still_s = since + step_s * len(times_s)
        for parent, child in self._chain.joints():
            if self.bends and parent.name in found and child.name in found:
                one, other = found[parent.name].quat[-1], found[child.name].quat[-1]
                self._bend(child.name, rotation.multiply(rotation.inverse(one), other))
        if self.bends and not any(self.bends.values()):
            self.still_s = 0.0  # that of before the motion

    def _bend(self, name: str, now: FloatArray) -> None:
        if not np.isfinite(now).all():
            return
        straight = self._straight.setdefault(name, now)
        turn = rotation.multiply(rotation.inverse(straight), now)
        angle = 2.0 * math.acos(min(1.0, abs(float(turn[0]))))
        if angle > BENT_RAD and name not in self._bent:
            self._bent.add(name)
            self.bends[name] += 1
        elif angle < STRAIGHT_RAD:
            self._bent.discard(name)
