# SPDX-License-Identifier: MIT
"""Which way the axes lie: the poses that a guide asks for, and a row on gravity in
them.

The body's axes: x to the front, y to the left, z to the top (docs/calibration.md).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

import numpy as np

from imud.calibration.algebra import units
from imud.calibration.poses import BASE_DOWN, StaticPose
from imud.calibration.recording import Sample, Scale
from imud.check.evidence import Evidence, Posed
from imud.check.rows import Row, RowVerdict, skipped
from imud.check.still import StillWindow
from imud.probes.self_test import AXES

LEFT_DOWN = StaticPose((0, -1, 0))
FRONT_UP = StaticPose((1, 0, 0))
ASKED = (BASE_DOWN, LEFT_DOWN, FRONT_UP)

STILL_S = 1.5
TIMEOUT_S = 40.0
TURNED = 0.7  # a new pose is more than 45 degrees from the one before
CLEAR = 0.9  # the cosine of 26 degrees: an axis is up if it is within that


class PoseGuide:
    """Asks for one pose after the other, and takes the mean of each once the probe lies
    still in another way than before. Time is that of the samples.
    """

    def __init__(self, scale: Scale, poses: Iterable[StaticPose] = ASKED) -> None:
        self._scale = scale
        self._left = deque(poses)
        self._window = StillWindow(scale, STILL_S)
        self._since_us: int | None = None
        self._before: np.ndarray | None = None
        self.found: list[Posed] = []

    @property
    def wanted(self) -> StaticPose | None:
        """The pose to be laid down; None: all are over."""
        return self._left[0] if self._left else None

    def start_from(self, acc: tuple[float, float, float]) -> None:
        """How it lay before the first pose."""
        self._before = units(np.array(acc))

    def feed(self, sample: Sample) -> None:
        """The next sample; samples after the last pose are left out."""
        if not self._left:
            return
        if self._since_us is None:
            self._since_us = sample.t_us
        means = self._window.feed(sample)
        if means is not None:
            up = units(means[:3])
            is_new = self._before is None or float(up @ self._before) < TURNED
            if is_new and np.abs(up).max() > CLEAR:
                self._before = up
                self._end(means[:3] * self._scale.acc_m_s2)
                return
        if sample.t_us - self._since_us > TIMEOUT_S * 1e6:
            self._end(None)

    def skip(self) -> None:
        """Leaves out the wanted pose."""
        if self._left:
            self._end(None)

    def _end(self, acc: np.ndarray | None) -> None:
        found = None if acc is None else (float(acc[0]), float(acc[1]), float(acc[2]))
        self.found.append(Posed(self._left.popleft(), found))
        self._window.clear()
        self._since_us = None


def rows(evidence: Evidence) -> Iterator[Row]:
    """One row; none where no poses were asked for."""
    normal = "x to the front, y to the left, z to the top"
    if not evidence.poses:
        return
    known = [(each.pose, each.acc_m_s2) for each in evidence.poses if each.acc_m_s2]
    if not known:
        yield skipped("axes", normal, "no pose was laid still")
        return
    wrong = []
    seen: dict[int, tuple[int, int]] = {}  # asked axis: measured axis and sign
    for pose, acc in known:
        share = units(np.array(acc))
        axis = int(np.argmax(np.abs(share)))
        asked = next(i for i, sign in enumerate(pose.sign) if sign)
        sign = int(np.sign(share[axis])) * pose.sign[asked]
        seen[asked] = axis, sign
        if (axis, sign) != (asked, 1):
            up = f"{'+' if share[axis] > 0 else '-'}{AXES[axis]}"
            wrong.append(f"{pose.words}: {up} points up, not {pose.name}")
    numbers = {
        each.pose.name: [round(value, 3) for value in each.acc_m_s2]
        for each in evidence.poses
        if each.acc_m_s2
    }
    if not wrong:
        measured = f"right in {len(seen)} of {len(evidence.poses)} poses"
        verdict = RowVerdict.GOOD
        if len(seen) < len(evidence.poses):
            verdict = RowVerdict.SKIPPED
        yield Row("axes", measured, normal, verdict, "", numbers)
        return
    measured = f"{_named(seen)} ({'; '.join(wrong)})"
    yield Row("axes", measured, normal, RowVerdict.FAULT, _cure(seen), numbers)


def _named(seen: dict[int, tuple[int, int]]) -> str:
    """Which axes are swapped or inverted."""
    parts = []
    for asked, (axis, sign) in sorted(seen.items()):
        if axis == asked and sign < 0:
            parts.append(f"{AXES[asked]} is inverted")
        elif axis > asked and seen.get(axis, (asked, 1))[0] == asked:
            parts.append(f"{AXES[asked]} and {AXES[axis]} are swapped")
        elif axis != asked and seen.get(axis, (asked, 1))[0] != asked:
            parts.append(f"{AXES[axis]} is where {AXES[asked]} should be")
    return ", ".join(parts) or "axes are rotated"


def _cure(seen: dict[int, tuple[int, int]]) -> str:
    again = "Repeat the poses to make sure that they were right"
    if len(seen) == 3:
        matrix = np.zeros((3, 3))
        for asked, (axis, sign) in seen.items():
            matrix[asked, axis] = sign
        if round(float(np.linalg.det(matrix))) == 1:
            return (
                f"{again}. If they were, the module is turned in its housing: mount it "
                "as docs/check.md shows, or let imud calibrate find out"
            )
        return (
            f"{again}. If they were, no mounting explains it: the chip's axes are "
            "mirrored, or the firmware has a fault. Please send this report"
        )
    return f"{again}, and do all three"
