# SPDX-License-Identifier: MIT
"""Raw samples through a filter in floats, for a probe without the C module.

A step of the filter takes long and allocates memory: samples are added up, the filter
steps with their means, and the garbage is collected at a sample without a step.
"""

import gc
import struct
from array import array
from time import ticks_diff

from micropython import const

from . import wire
from .fast import add_axes, copy_axes
from .gyro_bias import GyroBias

_STARTING_US = const(3_000_000)
_FIELD_ABSENT_US = const(1_000_000)
_RESTART_US = const(250_000)  # a hand turns far in that time
_NULL = const(0x80)  # high byte of an axis without a reading
_CLIPPED = const(6)  # of acceleration, of rate: flags of a sample
_COLLECT_STEPS = const(8)  # some 3 kB each
_ONE_G = 9.80665
_ONE = 1073741824.0  # of a quaternion in a pose


class Fusion:
    """`filter`: of madgwick.py."""

    def __init__(self, filter):
        self.filter = filter
        self.fused = 0
        self.step_hz = filter.RATE_HZ
        self._sums = array("i", bytes(24))  # of rate and force
        self._field = bytearray(6)
        self._latched = 0
        self._steps = 0  # since the last collection

    def begin(self, rate_hz, hello):
        """The sensor is ready, and described in the hello."""
        self._every = (rate_hz + self.filter.RATE_HZ - 1) // self.filter.RATE_HZ
        self.step_hz = rate_hz // self._every
        acc_lsb, gyr_lsb = (
            struct.unpack_from("<I", hello, place)[0] * 1e-9
            for place in (wire.HELLO_ACC_LSB, wire.HELLO_GYR_LSB)
        )
        self._gyr_lsb = gyr_lsb / self._every
        one_g = self._every * _ONE_G / acc_lsb
        self._bias = GyroBias(self._gyr_lsb, one_g, self._every)
        self._last = None
        self._forget()

    def _forget(self):
        for n in range(6):
            self._sums[n] = 0
        self._count = self._flags = 0
        self._has_field = False

    def take(self, raw, stamp):
        """Adds a sample. True: the filter has stepped."""
        self._flags |= raw[wire.RAW_SAMPLE_FLAGS]
        add_axes(raw, wire.RAW_GYR, self._sums, 0)
        add_axes(raw, wire.RAW_ACC, self._sums, 3)
        if raw[wire.RAW_MAG + 1] != _NULL:
            copy_axes(raw, wire.RAW_MAG, self._field, 0)
            self._has_field = True
        self._count += 1
        if self._count < self._every:
            if self._steps >= _COLLECT_STEPS:
                self._steps = 0
                gc.collect()
            return False
        self._step(stamp)
        self._steps += 1
        self.fused += self._every
        self._forget()
        return True

    def _step(self, stamp):
        interval_us = 0 if self._last is None else ticks_diff(stamp, self._last)
        if self._last is None or interval_us > _RESTART_US:
            self.filter.restart()
            self._age_us = 0
            self._field_age_us = _FIELD_ABSENT_US
            interval_us = 1_000_000 // self.step_hz
        self._last = stamp
        flags = self._flags
        if flags & _CLIPPED:
            self._latched |= wire.POSE_CLIPPED
        if flags & wire.SAMPLE_GAP:
            self._latched |= wire.POSE_GAP
        field = struct.unpack("<3h", self._field) if self._has_field else None
        if field == (0, 0, 0):  # has no direction
            field = None
        field_age_us = 0 if field is not None else self._field_age_us + interval_us
        self._age_us = min(self._age_us + interval_us, _STARTING_US)
        self._field_age_us = min(field_age_us, _FIELD_ABSENT_US)
        sums, lsb, bias = self._sums, self._gyr_lsb, self._bias
        if bias.rad_s is None:
            bias.take(sums, flags & (wire.SAMPLE_GYR_CLIPPED | wire.SAMPLE_GAP) != 0)
        x, y, z = sums[0] * lsb, sums[1] * lsb, sums[2] * lsb
        if bias.rad_s is not None:
            x, y, z = x - bias.rad_s[0], y - bias.rad_s[1], z - bias.rad_s[2]
        force = sums[3], sums[4], sums[5]
        self.filter.step((x, y, z), force, field, interval_us * 1e-6)

    def found_bias(self):
        """Samples of the gyroscope's bias, once, as soon as it is known; else 0."""
        return self._bias.told()

    def fill(self, pose):
        """Fills in a pose message. The filter states no errors: they are null."""
        flags, self._latched = self._latched, 0
        if self._age_us < _STARTING_US:
            flags |= wire.POSE_STARTING
        if self._bias.rad_s is None:
            flags |= wire.POSE_UNCALIBRATED
        if self._field_age_us >= _FIELD_ABSENT_US:
            flags |= wire.POSE_MAG_ABSENT | wire.POSE_HEADING_FREE
        w, x, y, z = self.filter.orientation()
        parts = int(w * _ONE), int(x * _ONE), int(y * _ONE), int(z * _ONE)
        struct.pack_into("<4i", pose, wire.POSE_Q, *parts)
        struct.pack_into("<H", pose, wire.POSE_POSE_FLAGS, flags)
