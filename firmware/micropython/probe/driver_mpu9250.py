# SPDX-License-Identifier: MIT
"""The MPU-9250 with its AK8963 in MicroPython: set-up without self-test, and its burst
to raw messages.

Documents: RM = RM-MPU-9250A-00 rev 1.6 (registers by name), AK = AK8963 data sheet
MS1356-E-02. core/drivers/mpu9250_setup.c has the same registers with the reasons for
their values. The chip's own I2C master reads the AK8963, which it sets up a register at
a time.
"""

import struct
from time import ticks_diff

from micropython import const

from . import wire
from .ak8963 import REFUSED, answer, ask, transfer
from .fast import swap_axes

_ADDRESS = const(0x68)  # pin AD0 low
_WHO_AM_I = const(0x75)
_PWR_MGMT_1 = const(0x6B)
_ACCEL_XOUT_H = const(0x3B)
_WIA = const(0x00)  # of the AK8963
_ST1_READY = const(0x01)
_ST2_OVERFLOW = const(0x08)
_ST2_16_BIT = const(0x10)
_AK_MAX = const(32760)  # AK 8.3: measurement data
_INERTIAL = const(14)

_MASTER_OFF_US = const(3_500)  # a burst of the AK8963 takes less
_STARTUP_US = const(110_000)
_GYRO_START_US = const(50_000)
_SETTLE_US = const(75_000)
_FORCE_US = const(1_000_000)  # within which the force has to be near 1 g
_POLL_US = const(5_000)
_TRIES = const(50)  # of a transfer that the AK8963 refuses
# Samples: 1 s without a field, and 10 s until an AK8963 that is absent is tried again.
_SILENT = const(200)
_ABSENT = const(2000)
_LEFT_OUT = const(7)  # core/drivers/mag_watch.h
# From 0.75 to 1.25 g, squared; 2048 counts a g.
_FORCE_MIN = const(1536 * 1536)
_FORCE_MAX = const(2560 * 2560)

# Registers and values, in their order: the gyroscope's PLL; all on; 92 Hz; 99 Hz; 2000
# deg/s; 16 g; the master waits for the AK8963's bytes, 400 kHz; it is on.
_INERTIAL_SETUP = b"\x6b\x01\x6c\x00\x1a\x02\x1d\x02\x1b\x18\x1c\x18\x24\x4d\x6a\x20"
_MASTER_OFF = b"\x6a\x00"
_MASTER_ON = b"\x6a\x20"
# 200 Hz; a pulse at each sample; data-ready.
_RUN = b"\x19\x04\x37\x00\x38\x01"
# SLV0 reads ST1 to ST2, eight bytes.
_FOLLOW_AK = b"\x25\x8c\x26\x02\x27\x88"


_LOST = const(1000)  # of an OSError: with the cause, the sensor is lost


class Driver:
    rate_hz = 200

    def __init__(self):
        self.who_am_i = 0
        self.detail = 0  # of an OSError with a cause
        self._has_mag = False
        self._without = 0  # samples since the last field, or since it is absent
        self._spoiled = 0  # set-ups, by an AK8963 without fields: as in mag_watch.h
        self._adjust = bytearray(3)
        self._field = bytearray(6)  # last read

    def begin(self, i2c=None):
        self._i2c = i2c or self._i2c
        self._step = 0
        self._since = None
        self._without = 0
        self._was_ready = False  # the field of the sample before was

    def _write(self, pairs):
        for at in range(0, len(pairs), 2):
            self._i2c.writeto_mem(_ADDRESS, pairs[at], pairs[at + 1 : at + 2])

    def _register(self, register):
        return self._i2c.readfrom_mem(_ADDRESS, register, 1)[0]

    def set_up(self, now):
        """One step; True once samples flow. Raises OSError."""
        if self._since is not None and ticks_diff(now, self._since) < self._wait_us:
            return False
        self._since = now
        self._step += 1
        self._wait_us = _STARTUP_US
        if self._step == 2:
            # Nothing is written before: a clock may be at this address.
            self._identify()
            # A reset while the master reads can leave the AK8963 holding its bus (RM
            # 106, of I2C_MST_RST).
            self._write(_MASTER_OFF)
            self._wait_us = _MASTER_OFF_US
        elif self._step == 3:
            self._write(b"\x6b\x80")  # H_RESET
        elif self._step == 4:
            self._write(_INERTIAL_SETUP)
            self._wait_us = _GYRO_START_US
        elif self._step == 5:
            self._set_up_field()
            self._data = bytearray(_INERTIAL + (8 if self._has_mag else 0))
            self._write(_RUN)
            self._wait_us = _SETTLE_US
        elif self._step == 6:
            self._compare(_INERTIAL_SETUP[:-2])
            self._compare(_RUN)
            self._compare(_MASTER_ON + _FOLLOW_AK if self._has_mag else _MASTER_OFF)
            self._wait_us = 0
        elif self._step > 6:
            return self._is_about_1_g()
        return False

    def _fail(self, cause, more=0):
        self.detail = self.who_am_i + 256 * more
        raise OSError(_LOST + cause)

    def _identify(self):
        """By InvenSense's names, or a relative's registers: mpu9250_setup.c."""
        self.who_am_i = who = self._register(_WHO_AM_I)
        power = self._i2c.readfrom_mem(_ADDRESS, _PWR_MGMT_1, 2)
        is_relative = who not in (0x00, 0xFF) and bytes(power) == b"\x01\x00"
        if not (is_relative or 0x70 <= who <= 0x74):
            self._fail(wire.CAUSE_WRONG_CHIP)

    def _compare(self, pairs):
        """Whether registers hold what was written to them."""
        for at in range(0, len(pairs), 2):
            if self._register(pairs[at]) != pairs[at + 1]:
                self._fail(wire.CAUSE_REGISTERS, pairs[at])

    def _is_about_1_g(self):
        """Whether the force is; raises where it is not for _FORCE_US."""
        x, y, z = struct.unpack(
            ">hhh", self._i2c.readfrom_mem(_ADDRESS, _ACCEL_XOUT_H, 6)
        )
        if _FORCE_MIN <= x * x + y * y + z * z <= _FORCE_MAX:
            return True
        if self._step * _POLL_US > _FORCE_US:
            self._fail(wire.CAUSE_FORCE)
        self._wait_us = _POLL_US
        return False

    def _transfer(self, register, value=None):
        """One register of the AK8963; below 0 where it is not there."""
        found = REFUSED
        for _ in range(_TRIES):
            found = transfer(self._i2c, register, value)
            if found != REFUSED:
                break
        return found

    def _set_up_field(self):
        # WIA. CNTL2: reset. CNTL1: fuse ROM; ASAX; CNTL1: off, then 100 Hz, 16 bits.
        is_out = self._spoiled & _LEFT_OUT == _LEFT_OUT
        self._has_mag = (
            not is_out and self._transfer(_WIA) == 0x48 and self._begin_field()
        )
        if not self._has_mag:
            self._write(_MASTER_OFF)

    def _begin_field(self):
        """Whether the AK8963 took all that it needs to measure."""
        for register, value in ((0x0B, 0x01), (0x0A, 0x0F)):
            if self._transfer(register, value) < 0:
                return False
        for axis in range(3):
            adjust = self._transfer(0x10 + axis)
            if adjust < 0:
                return False
            self._adjust[axis] = adjust
        if self._transfer(0x0A, 0x00) < 0:
            return False
        self._write(_FOLLOW_AK)
        return self._transfer(0x0A, 0x16) >= 0

    def describe(self, hello):
        """Fills in what a hello says of the sensor."""
        hello[wire.HELLO_SENSOR] = (
            wire.SENSOR_MPU9250 if self._has_mag else wire.SENSOR_MPU6500
        )
        hello[wire.HELLO_WHO_AM_I] = self.who_am_i
        hello[wire.HELLO_WHO_AM_I + 1] = 0x48 if self._has_mag else 0
        for axis in range(3):
            adjust = self._adjust[axis] if self._has_mag else 0
            hello[wire.HELLO_MAG_ADJUST + axis] = adjust
        struct.pack_into("<H", hello, wire.HELLO_SAMPLE_RATE, self.rate_hz)
        struct.pack_into("<I", hello, wire.HELLO_ACC_LSB, 4788403)  # 16 g / 32768
        struct.pack_into("<I", hello, wire.HELLO_GYR_LSB, 1065264)  # 2000 deg/s / 32768
        struct.pack_into("<I", hello, wire.HELLO_MAG_LSB, 150000)  # 0.15 uT

    def read(self, raw):
        """Reads a sample into a raw message; False where it is no reading."""
        data = self._data
        self._i2c.readfrom_mem_into(_ADDRESS, _ACCEL_XOUT_H, data)
        if _is_one_value(data):
            return False
        swap_axes(data, 0, raw, wire.RAW_ACC)
        swap_axes(data, 8, raw, wire.RAW_GYR)
        flags = 0
        if _is_clipped(raw, wire.RAW_ACC):
            flags |= wire.SAMPLE_ACC_CLIPPED
        if _is_clipped(raw, wire.RAW_GYR):
            flags |= wire.SAMPLE_GYR_CLIPPED
        counts = _signed(data[7], data[6])
        # RM 65: 333.87 counts a degC, from 21 degC; 19629 is 100 / 333.87 * 2^16.
        _put(raw, wire.RAW_TEMPERATURE, ((counts * 19629 + 32768) >> 16) + 2100)
        for axis in range(0, 6, 2):
            _put(raw, wire.RAW_MAG + axis, -32768)
        if self._has_mag:
            flags |= self._take_field(data, raw)
        self._follow_field()
        raw[wire.RAW_SAMPLE_FLAGS] = flags
        return True

    def _follow_field(self):
        """Has the sensor set up again where the AK8963 is silent, or is back."""
        self._without += 1
        if self._has_mag:
            if self._without > _SILENT:
                self._spoiled = (self._spoiled << 1 | self._spoiled | 1) & 127
                self._fail(wire.CAUSE_MAG_SILENT)
            return
        pause = _ABSENT * (1 + self._spoiled)
        if self._without == pause:
            self._write(_MASTER_ON)
            ask(self._i2c, _WIA)
        elif self._without > pause + 1:
            self._without = 0
            is_back = answer(self._i2c) == 0x48
            self._write(_MASTER_OFF)
            if is_back:
                self._spoiled -= self._spoiled & _LEFT_OUT == _LEFT_OUT
                self._fail(wire.CAUSE_MAG_SILENT)

    def _take_field(self, data, raw):
        """The magnetic field where it is new; returns flags of the sample."""
        status, end = data[_INERTIAL], data[_INERTIAL + 7]
        is_new = not self._was_ready
        self._was_ready = bool(status & _ST1_READY)
        if status & 0xFD != _ST1_READY or end & 0xF7 != _ST2_16_BIT:
            return 0
        x = _signed(data[_INERTIAL + 1], data[_INERTIAL + 2])
        y = _signed(data[_INERTIAL + 3], data[_INERTIAL + 4])
        z = _signed(data[_INERTIAL + 5], data[_INERTIAL + 6])
        # Ready twice running with the same bytes: the chip's master did not renew them.
        for n in range(6):
            byte = data[_INERTIAL + 1 + n]
            is_new = is_new or byte != self._field[n]
            self._field[n] = byte
        if not is_new or min(x, y, z) < -_AK_MAX or max(x, y, z) > _AK_MAX:
            return 0
        self._without = self._spoiled = 0
        # AK 8.3: H * ((ASA - 128) * 0.5 / 128 + 1), rounded.
        x = (x * (128 + self._adjust[0]) + 128) >> 8
        y = (y * (128 + self._adjust[1]) + 128) >> 8
        z = (z * (128 + self._adjust[2]) + 128) >> 8
        if end & _ST2_OVERFLOW or max(abs(x), abs(y), abs(z)) > 32767:
            return wire.SAMPLE_MAG_OVERFLOW
        # PS 9.1: the AK8963's x is the others' y, its y their x, its z points the
        # other way.
        _put(raw, wire.RAW_MAG, y)
        _put(raw, wire.RAW_MAG + 2, x)
        _put(raw, wire.RAW_MAG + 4, -z)
        return 0


def _is_one_value(data):
    """Whether it is the byte of an undriven or held bus: no reading."""
    first = data[0]
    if first not in (0x00, 0xFF):
        return False
    for n in range(1, _INERTIAL):
        if data[n] != first:
            return False
    return True


def _is_clipped(raw, place):
    """Whether one of three axes is at the end of its range."""
    for n in range(0, 6, 2):
        if 32767 <= (raw[place + n] | raw[place + n + 1] << 8) <= 32769:
            return True
    return False


def _signed(low, high):
    value = low | high << 8
    return value - 65536 if value >= 32768 else value


def _put(raw, place, value):
    raw[place] = value & 0xFF
    raw[place + 1] = (value >> 8) & 0xFF
