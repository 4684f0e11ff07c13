# SPDX-License-Identifier: MIT
"""A foot as it walks, live: when it rests on the ground, and how far each stride is."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from imud import rotation
from imud.body import contact
from imud.body.chain import Chain
from imud.body.contact import Pose, Walker
from imud.body.history import ProbeHistory
from imud.body.mounting import Mount
from imud.body.stance import StanceDetector
from imud.body.state import Contact, vector
from imud.body.tracks import Track
from imud.body.zero_velocity import Clipped
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

TURNS_REST_S = 0.12  # of rates alone, which are those of some 25 poses a second
UP = np.array([0.0, 0.0, GRAVITY_M_S2])


class Foot:
    """One segment with `contact`."""

    def __init__(self) -> None:
        self._walker: Walker | None = None
        self._last_s: float | None = None
        self._clipped_s = -math.inf  # the last sample at the end of a range
        self._rests = 0  # before that walker
        # Of poses alone, which have no forces.
        self._turns = StanceDetector()
        self._calm_s = 0.0
        self._is_down = False

    def update(self, samples: FloatArray, pose: Pose) -> None:
        """Samples since the last call, rows of (n, 9): time s, rates rad/s, forces m/s2
        of the probe, whether each is clipped; and the pose at about their time.
        """
        for row in samples:
            time_s = float(row[0])
            passed_s = 0.0 if self._last_s is None else time_s - self._last_s
            if passed_s > contact.GAP_S:
                self.lose()
                passed_s = 0.0
            if self._walker is None:
                self._walker = Walker()
            self._last_s = time_s
            clipped = Clipped(*map(bool, row[7:9]))
            self._clipped_s = time_s if any(row[7:9]) else self._clipped_s
            self._walker.update(time_s, passed_s, (row[1:4], row[4:7]), pose, clipped)

    def turn(self, time_s: float, gyr: FloatArray) -> None:
        """A moment of a probe that sends poses alone: rates show rests, not places."""
        if self._walker is not None:
            self.lose()
        passed_s = 0.0 if self._last_s is None else time_s - self._last_s
        self._last_s = time_s
        self._turns.update(passed_s, gyr, UP)
        self._calm_s = self._calm_s + passed_s if self._turns.is_calm else 0.0
        is_down = self._calm_s >= TURNS_REST_S
        self._rests += is_down and not self._is_down
        self._is_down = is_down

    def lose(self) -> None:
        """Its probe is missing: the next stride is unknown, and its path restarts."""
        if self._walker is not None:
            self._rests += self._walker.rests
        self._walker, self._last_s = None, None
        self._calm_s, self._is_down = 0.0, False

    def remark(self) -> str | None:
        """A remark if it has not rested for long, with the error of its position, or if
        it moves beyond what its sensors measure.
        """
        walker = self._walker
        if walker is None or walker.rest is None or self._last_s is None:
            return None
        if self._last_s - self._clipped_s <= contact.LONG_S:
            return "beyond the range of its sensors: its path is less certain"
        away_s = self._last_s - walker.rest.end_s
        if away_s <= contact.LONG_S:
            return None
        off_m = 2.0 * float(np.linalg.norm(walker.sigmas))
        return f"no rest for {away_s:.0f} s: its position error is up to {off_m:.1f} m"

    def state(self) -> Contact:
        """The contact of the foot now: on the ground or not, its rests so far, and, of
        a foot that walks, the last stride and the last place of rest, m in the world,
        if known.
        """
        walker = self._walker
        rest = walker.rest if walker is not None else None
        stride = walker.stride_m if walker is not None else None
        return Contact(
            is_down=self._is_down if walker is None else walker.is_down,
            rests=self._rests + (0 if walker is None else walker.rests),
            stride_m=None if stride is None else round(stride, 4),
            place_m=None if rest is None else vector(rest.place),
            place_sigma_m=None if rest is None else vector(rest.sigmas),
        )


class Feet:
    """All feet of a body."""

    def __init__(self, chain: Chain) -> None:
        self._feet = {each.name: Foot() for each in chain.segments if each.is_contact}
        self._last_s: float | None = None

    def update(
        self,
        time_s: float,
        quats: Mapping[str, FloatArray],
        tracks: Mapping[str, Track],
        mounts: Mapping[str, Mount],
        histories: Mapping[str, ProbeHistory],
    ) -> None:
        """A moment: `quats`, world_from_segment, and `tracks` of this moment alone, all
        by segment.
        """
        since_s, self._last_s = self._last_s, time_s
        for name, foot in self._feet.items():
            quat, track, mount = quats[name][0], tracks[name], mounts.get(name)
            if mount is None or not np.isfinite(quat).all():
                foot.lose()
            elif track.acc is None:
                foot.turn(time_s, track.gyr[0])
            else:
                turned = rotation.inverse(mount.probe_from_segment)
                probe = rotation.multiply(quat, turned)
                pose = probe, float(track.tilt_sigma[0]), float(track.heading_sigma[0])
                after_s = time_s if since_s is None else since_s
                foot.update(histories[name].samples(after_s, time_s), pose)

    def state(self, name: str) -> Contact | None:
        foot = self._feet.get(name)
        return foot.state() if foot is not None else None

    def remarks(self) -> list[str]:
        told = ((name, foot.remark()) for name, foot in self._feet.items())
        return [f"{name}: {remark}" for name, remark in told if remark is not None]
