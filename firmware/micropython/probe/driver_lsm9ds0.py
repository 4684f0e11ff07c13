# SPDX-License-Identifier: MIT
"""The LSM9DS0 in MicroPython: set-up without self-test, and its bursts to raw messages.

Document: DS = LSM9DS0 data sheet, DocID024763 rev 2 (registers by name, chapter 8).
core/drivers/lsm9ds0.c has the same registers with the reasons for their values.
"""

import struct
from time import ticks_diff

from micropython import const

from . import wire
from .fast import copy_axes, is_beyond

_AUTO = const(0x80)  # DS 6.1.1: of the sub-address
_WHO_AM_I = const(0x0F)
_CTRL1_G = const(0x20)
_CTRL5_G = const(0x24)
_STATUS_G = const(0x27)
_TEMPERATURE = const(0x05)
_CTRL0_XM = const(0x1F)
_STATUS_A = const(0x27)
_FRESH = const(0x0F)  # of a status: each axis, and all
_OVERRUN = const(0x80)

_GYR_MAX = const(28571)  # 2000 deg/s, 70 mdps each
_ACC_MAX = const(21857)  # 16 g, 0.732 mg each
_MAG_MAX = const(25000)  # 2 gauss, 0.08 mgauss each
_HELD_MAX = const(4)  # samples: then the accelerometer stands still
# Samples: 1 s without a field; 10 s, and as many for each of `_spoiled`, before a
# magnetometer that was left out is used again.
_SILENT = const(380)
_ABSENT = const(3800)
_LEFT_OUT = const(7)  # core/drivers/mag_watch.h

_BOOT_US = const(20_000)
_START_US = const(800_000)

# CTRL_REG1_G to 5: 380 Hz, 100 Hz low-pass, on; data-ready on DRDY_G; BDU, 2000 deg/s;
# LPF2. CTRL_REG0_XM to 7: 800 Hz; BDU; 194 Hz, 16 g; temperature, high resolution, 100
# Hz; 2 gauss; continuous.
_G = b"\xbf\x00\x08\xa0\x02"
_XM = b"\x00\x9f\x60\x00\x00\xf4\x00\x00"

_ONES = b"\xff" * 9  # bytes of a bus that nobody drives
_LOST = const(1000)  # of an OSError: with the cause, the sensor is lost


class Driver:
    rate_hz = 380

    def __init__(self, gyr=0x6B, xm=0x1D):
        self._gyr = gyr
        self._xm = xm
        self.detail = 0  # of an OSError with a cause
        self._spoiled = 0  # set-ups, by a magnetometer without fields
        self._axes = bytearray(7)  # a status, three axes
        self._more = bytearray(9)  # the temperature before them

    def begin(self, i2c=None):
        self._i2c = i2c or self._i2c
        self._step = 0
        self._since = None
        self._held = 0
        self._without = 0  # samples since the last field, or since it is left out
        self._has_mag = self._spoiled & _LEFT_OUT != _LEFT_OUT

    def set_up(self, now):
        """One step; True once samples flow. Raises OSError."""
        if self._since is not None and ticks_diff(now, self._since) < self._wait_us:
            return False
        self._since = now
        self._step += 1
        if self._step == 1:
            self._wait_us = _BOOT_US
        elif self._step == 2:
            self._identify()
        elif self._step == 3:
            self._wait_us = _START_US
            self._i2c.writeto_mem(self._gyr, _CTRL1_G | _AUTO, _G)
            self._i2c.writeto_mem(self._xm, _CTRL0_XM | _AUTO, _XM)
        else:
            self._compare(self._gyr, _CTRL1_G, _G, 0xD4)
            self._compare(self._xm, _CTRL0_XM, _XM, 0x49)
            return True
        return False

    def _compare(self, address, register, values, name):
        """Raises where registers do not hold what was written to them."""
        held = self._i2c.readfrom_mem(address, register | _AUTO, len(values))
        for n in range(len(values)):
            if held[n] != values[n]:
                self.detail = name + 256 * (register + n)
                raise OSError(_LOST + wire.CAUSE_REGISTERS)

    def _identify(self):
        for address, name in ((self._gyr, 0xD4), (self._xm, 0x49)):
            self.detail = self._i2c.readfrom_mem(address, _WHO_AM_I, 1)[0]
            if self.detail != name:
                raise OSError(_LOST + wire.CAUSE_WRONG_CHIP)
        self._i2c.writeto_mem(self._gyr, _CTRL5_G, b"\x80")  # BOOT
        self._i2c.writeto_mem(self._xm, _CTRL0_XM, b"\x80")

    def describe(self, hello):
        """Fills in what a hello says of the sensor."""
        hello[wire.HELLO_SENSOR] = wire.SENSOR_LSM9DS0
        hello[wire.HELLO_WHO_AM_I] = 0xD4
        hello[wire.HELLO_WHO_AM_I + 1] = 0x49 if self._has_mag else 0
        struct.pack_into("<H", hello, wire.HELLO_SAMPLE_RATE, self.rate_hz)
        struct.pack_into("<I", hello, wire.HELLO_ACC_LSB, 7178468)  # 0.732 mg
        struct.pack_into("<I", hello, wire.HELLO_GYR_LSB, 1221730)  # 70 mdps
        struct.pack_into("<I", hello, wire.HELLO_MAG_LSB, 8000)  # 0.08 mgauss

    def read(self, raw):
        """Reads a sample into a raw message; False where it is no reading."""
        data, more, i2c = self._axes, self._more, self._i2c
        flags = 0
        i2c.readfrom_mem_into(self._gyr, _STATUS_G | _AUTO, data)
        status = data[0]
        if status & _FRESH != _FRESH:
            return False
        if status & _OVERRUN:
            flags |= wire.SAMPLE_GAP
        copy_axes(data, 1, raw, wire.RAW_GYR)
        if is_beyond(raw, wire.RAW_GYR, _GYR_MAX):
            flags |= wire.SAMPLE_GYR_CLIPPED
        i2c.readfrom_mem_into(self._xm, _STATUS_A | _AUTO, data)
        self._held = 0 if data[0] & _FRESH == _FRESH else self._held + 1
        if self._held > _HELD_MAX:
            return False
        copy_axes(data, 1, raw, wire.RAW_ACC)
        if is_beyond(raw, wire.RAW_ACC, _ACC_MAX):
            flags |= wire.SAMPLE_ACC_CLIPPED
        i2c.readfrom_mem_into(self._xm, _TEMPERATURE | _AUTO, more)
        if more == _ONES and data == _ONES[:7]:
            return False
        flags |= self._take_field(more, raw)
        self._take_temperature(more, raw)
        raw[wire.RAW_SAMPLE_FLAGS] = flags
        return True

    def _take_field(self, data, raw):
        """The magnetic field, null where it is not new; returns flags of the sample."""
        place = wire.RAW_MAG
        flags = 0
        is_new = data[2] & _FRESH == _FRESH
        if data[2] == 0xFF and data[2:] == _ONES[2:]:  # of an undriven bus
            is_new = False
        self._follow_field(is_new)
        if is_new and self._has_mag:
            copy_axes(data, 3, raw, place)
            if not is_beyond(raw, place, _MAG_MAX):
                # DS figure 1: the magnetometer's z points into the package.
                z = -(raw[place + 4] | raw[place + 5] << 8)
                raw[place + 4] = z & 0xFF
                raw[place + 5] = (z >> 8) & 0xFF
                return 0
            flags = wire.SAMPLE_MAG_OVERFLOW
        for axis in range(0, 6, 2):
            raw[place + axis] = 0
            raw[place + axis + 1] = 0x80
        return flags

    def _follow_field(self, is_new):
        """Has the sensor set up again where fields end, or come again."""
        self._without += 1
        if self._has_mag and is_new:
            self._without = self._spoiled = 0
            return
        pause = _SILENT if self._has_mag else _ABSENT * (1 + self._spoiled)
        if self._without <= pause or not (self._has_mag or is_new):
            return
        if self._has_mag:
            self._spoiled = (self._spoiled << 1 | self._spoiled | 1) & 127
        else:
            self._spoiled -= 1
        self.detail = 0xD4
        raise OSError(_LOST + wire.CAUSE_MAG_SILENT)

    def _take_temperature(self, data, raw):
        """DS table 4: 12 bits, 8 counts a degC, from 25 degC."""
        counts = data[0] | (data[1] & 0x0F) << 8
        if counts >= 2048:
            counts -= 4096
        cdeg = 2500 + counts * 25 // 2
        raw[wire.RAW_TEMPERATURE] = cdeg & 0xFF
        raw[wire.RAW_TEMPERATURE + 1] = (cdeg >> 8) & 0xFF
