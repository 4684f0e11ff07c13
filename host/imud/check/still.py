# SPDX-License-Identifier: MIT
"""Whether a probe lies still, sample by sample."""

from __future__ import annotations

from collections import deque

import numpy as np

from imud.calibration.recording import Sample, Scale
from imud.check.readings import DEG, MG, STILL_DPS, STILL_MG
from imud.rotation import FloatArray

LOOKS = 15  # at a window, while it passes by


class StillWindow:
    """The accelerations and rates, counts, of the last `seconds`."""

    def __init__(self, scale: Scale, seconds: float) -> None:
        self._scale = scale
        self._rows: deque[tuple[int, ...]] = deque(
            maxlen=max(4, round(seconds * scale.rate_hz))
        )
        self._fed = 0
        self.looks = 0  # in a row at which it lay still

    def feed(self, sample: Sample) -> FloatArray | None:
        """Takes a sample. The means of the window, shape (6,), if the probe lay still
        in all of it; looked at LOOKS times a window, and None in between.
        """
        self._rows.append((*sample.acc, *sample.gyr))
        self._fed += 1
        count = self._rows.maxlen or 0
        if self._fed % max(1, count // LOOKS) or len(self._rows) < count:
            return None
        table = np.array(self._rows, dtype=float)
        acc = table[:, :3].std(axis=0) * self._scale.acc_m_s2 / MG
        gyr = table[:, 3:].std(axis=0) * self._scale.gyr_rad_s * DEG
        if acc.max() >= STILL_MG or gyr.max() >= STILL_DPS:
            self.looks = 0
            return None
        self.looks += 1
        return np.asarray(table.mean(axis=0))

    def clear(self) -> None:
        self._rows.clear()
        self.looks = 0
