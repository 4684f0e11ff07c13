# SPDX-License-Identifier: MIT
"""The gyroscope's bias from the first seconds at rest, with the limits of
core/fusion/calibrate.c.
"""

from micropython import const

_SAMPLES = const(512)
_SPAN_RAD_S = 0.0524  # 3 deg/s
_BIAS_RAD_S = 0.698  # 40 deg/s
_TURN = 0.0087  # rad, 0.5 degrees between the two halves


class GyroBias:
    """Takes sums of `every` samples. `lsb`: rad/s a count of a sum; `one_g`: counts of
    one.
    """

    def __init__(self, lsb, one_g, every):
        self._steps = _SAMPLES // every
        self._span_max = _SPAN_RAD_S / lsb
        self._far_max = _BIAS_RAD_S / lsb
        self._turn_max = _TURN * one_g * self._steps / 2
        self._lsb = lsb
        self._is_told = False
        self.rad_s = None  # three numbers, once it is known
        self._begin()

    def _begin(self):
        self._count = 0
        self._sums = [0, 0, 0]
        self._turns = [0, 0, 0]
        self._low = [0, 0, 0]
        self._high = [0, 0, 0]

    def take(self, sums, is_broken):
        """`sums`: three of rate, three of force. Begins again where it moved."""
        sign = -1 if self._count < self._steps // 2 else 1
        for axis in range(3):
            value = sums[axis]
            is_first = self._count == 0
            low = value if is_first else min(self._low[axis], value)
            high = value if is_first else max(self._high[axis], value)
            self._low[axis], self._high[axis] = low, high
            self._sums[axis] += value
            self._turns[axis] += sign * sums[axis + 3]
            if high - low > self._span_max or abs(value) > self._far_max:
                is_broken = True
        self._count += 1
        is_last = self._count == self._steps
        if is_last and max(map(abs, self._turns)) > self._turn_max:
            is_broken = True
        if is_broken:
            self._begin()
        elif is_last:
            self.rad_s = tuple(total * self._lsb / self._steps for total in self._sums)

    def told(self):
        """How many samples it is the mean of, once; else 0."""
        if self.rad_s is None or self._is_told:
            return 0
        self._is_told = True
        return _SAMPLES
