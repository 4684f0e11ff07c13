# SPDX-License-Identifier: MIT
"""A Li-ion cell at an ADC: its voltage, smoothed, and whether it is nearly empty.

The limits are those of core/drivers/battery.h.
"""

from micropython import const

_LOW_MV = const(3300)
_GOOD_MV = const(3500)
_MIN_MV = const(2000)  # outside these two it is no cell
_MAX_MV = const(4600)
_LOW_STEADY = const(10)  # readings
_WEIGHT = const(4)  # of the mean
_READINGS = const(16)  # in a row, against noise
_UNKNOWN = const(65535)  # null in the message

_EVENT_BATTERY_LOW = const(21)
_CAUSE_BATTERY = const(18)


class Battery:
    """`adc`: a machine.ADC; `full_mv`: what the cell has where it reads its full scale,
    which is 6600 behind a divider by two with a reference of 3.3 V.
    """

    def __init__(self, adc, full_mv):
        self._adc = adc
        self._full_mv = full_mv
        self._low_for = 0
        self.mv = _UNKNOWN
        self.is_low = False

    def step(self, probe):
        """Reads it once and tells the probe; call it once a second."""
        total = 0
        for _ in range(_READINGS):
            total += self._adc.read_u16()
        self._take(total * self._full_mv // (_READINGS * 65535))
        probe.battery(self.mv, self.is_low)
        if self._low_for == _LOW_STEADY and not self.is_low:
            self.is_low = True
            probe.tell(_EVENT_BATTERY_LOW, _CAUSE_BATTERY, self.mv)

    def _take(self, mv):
        if not _MIN_MV <= mv <= _MAX_MV:
            self.mv = _UNKNOWN
        elif self.mv == _UNKNOWN:
            self.mv = mv
        else:
            self.mv += (mv - self.mv + _WEIGHT // 2) // _WEIGHT
        if self.mv > _GOOD_MV:
            self.is_low = False
        self._low_for = min(self._low_for + 1, _LOW_STEADY) if self.mv < _LOW_MV else 0
