# SPDX-License-Identifier: MIT
"""The guide of a known turn: the probe is laid against a stop, turned by so many
degrees, and laid again, as with the wedge and the dividing plate of hardware/.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from imud import rotation
from imud.calibration.recording import Sample, Scale
from imud.check.still import StillWindow
from imud.params.value import Params
from imud.probes.references import References
from imud.published import SinceOrigin
from imud.rotation import FloatArray

REST_S = 3.0  # the rest at each end, in which the filter levels
TIMEOUT_S = 60.0  # to wait for each rest, by the samples' time
SETTLED_LOOKS = 5
MOVED_DEG = 3.0  # by less it was not turned; or half of a smaller turn


@dataclass(frozen=True, slots=True)
class Lying:
    """The probe as it lay: means of the last REST_S seconds."""

    first: int  # index of the first sample
    last: int
    acc: FloatArray  # counts
    gyr: FloatArray  # counts
    mag: FloatArray | None  # counts
    q: tuple[float, float, float, float]  # of the last pose, world_from_body


@dataclass(frozen=True, slots=True)
class TurnSeen:
    """Two rests, and the samples between them."""

    rests: tuple[Lying, Lying]
    gyr: FloatArray  # counts, from the first sample of the first rest on
    steps_s: FloatArray  # from each of these to the next
    temperature_c: float | None
    since: SinceOrigin | None  # of the second pose, relative to the first


@dataclass(slots=True)
class TurnGuide:
    """Waits for two rests with a turn of about `wanted_deg` between them; no I/O."""

    scale: Scale
    params: Params
    wanted_deg: float
    _window: StillWindow = field(init=False)
    _samples: list[Sample] = field(default_factory=list)
    _references: References = field(default_factory=References)
    _pose: Mapping[str, Any] | None = None
    _first: Lying | None = None
    _captured: str | None = None
    _coming: tuple[Lying, str | None] | None = None
    _begin_us: int | None = None
    _turned: FloatArray = field(default_factory=rotation.IDENTITY.copy)
    found: TurnSeen | None = None

    def __post_init__(self) -> None:
        self._window = StillWindow(self.scale, REST_S)
        self._references.tell(self.params.encode())

    @property
    def has_first(self) -> bool:
        """Whether it lay still once: now it is to be turned."""
        return self._first is not None

    @property
    def is_late(self) -> bool:
        """Whether a rest did not come in time."""
        if self._begin_us is None or not self._samples:
            return False
        return self._samples[-1].t_us - self._begin_us > TIMEOUT_S * 1e6

    def on_pose(self, pose: Mapping[str, Any]) -> None:
        """A pose as it is published."""
        self._pose = pose
        self._references.on_pose(pose)

    def on_sample(self, sample: Sample) -> None:
        """A raw sample. After the second rest they are left out."""
        if self.found is not None:
            return
        if self._begin_us is None:
            self._begin_us = sample.t_us
        self._samples.append(sample)
        means = self._window.feed(sample)
        first, pose = self._first, self._pose
        if first is not None:
            self._follow(sample, first)
        if means is None or pose is None:
            return
        rest = self._rest(means, pose)
        if first is not None and self._has_moved():
            # By then the window is past the end of the motion.
            if self._window.looks >= SETTLED_LOOKS:
                self._end(first, rest)
            return
        # As long as it lies, the first rest is its last seconds: the shorter the time
        # between both, the less a gyroscope's bias can change. Each one counts once the
        # next look has found it still, so it contains no beginning of the turn.
        coming, self._coming = self._coming, (rest, self._references.capture())
        if coming is None or self._window.looks < 2:
            return
        if first is None:
            self._begin_us = sample.t_us
        self._first, self._captured = coming
        self._turned = rotation.IDENTITY.copy()

    def _follow(self, sample: Sample, first: Lying) -> None:
        """Adds a sample's turn, of which only the size counts here."""
        rate = (np.array(sample.gyr) - first.gyr) * self.scale.gyr_rad_s
        step = rotation.from_rotation_vector(rate / self.scale.rate_hz)
        self._turned = rotation.multiply(self._turned, step)

    def _has_moved(self) -> bool:
        least = min(MOVED_DEG, self.wanted_deg / 2.0)
        return degrees_of(self._turned) > least

    def _rest(self, means: FloatArray, pose: Mapping[str, Any]) -> Lying:
        count = round(REST_S * self.scale.rate_hz)
        known = [each.mag for each in self._samples[-count:] if each.mag is not None]
        return Lying(
            max(0, len(self._samples) - count),
            len(self._samples),
            means[:3],
            means[3:],
            np.mean(np.array(known, dtype=float), axis=0) if known else None,
            pose["q"],
        )

    def _end(self, first: Lying, second: Lying) -> None:
        between = self._samples[first.first : second.last]
        captured = self._captured
        since = None if captured is None else self._references.since_capture(captured)
        self.found = TurnSeen(
            (first, second),
            np.array([each.gyr for each in between], dtype=float),
            np.diff([each.t_us for each in between]) * 1e-6,
            self._samples[-1].temperature_c,
            since,
        )


def degrees_of(turn: FloatArray) -> float:
    """The angle of a quaternion, 0 to 180."""
    return math.degrees(float(np.linalg.norm(rotation.to_rotation_vector(turn))))
