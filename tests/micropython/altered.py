# SPDX-License-Identifier: MIT
"""Runs in MicroPython: the probe without the module, with a modelled chip that answers
otherwise than it should, for a time.

    micropython altered.py FAKES PACKAGE KIND FRAMES SECONDS [WHAT=VALUE ...]

`from_us` and `until_us` say when. `force`: m/s2 at rest. A register by its number in
hexadecimal: reads that value; `mag`: the AK8963 is `absent` or `hung`, or a
magnetometer does not measure (`silent`); `bus`: all bytes `ff`; `ready`: data-ready is
`off`.
"""

import sys
from time import ticks_us

import chips

import host

TURN_US = 25  # the MPU-9250's pulse takes 50
STEP_US = 5000
PRESS_US = 1_000_000, 1_100_000
BURST, ST1, INERTIAL = 0x3B, 14, 14
MST_STATUS, NACK = 0x36, 0x10
XM_BURST, STATUS_M = 0x85, 2


class Altered:
    """An I2C with such a chip. `written`: what was written to each register."""

    def __init__(self, chip, about):
        self._chip = chip
        self._from_us = int(about.pop("from_us", 0))
        self._until_us = int(about.pop("until_us", 1 << 30))
        self._mag = about.pop("mag", "")
        self._bus = about.pop("bus", "")
        self._ready = about.pop("ready", "")
        self._registers = {int(name, 16): int(about[name], 16) for name in about}
        self.written = []

    def _is_on(self):
        return self._from_us <= ticks_us() < self._until_us

    def value(self):
        return 0 if self._ready and self._is_on() else self._chip.value()

    def writeto_mem(self, address, register, data):
        for n in range(len(data)):
            self.written.append((register + n, data[n], ticks_us()))
        self._chip.writeto_mem(address, register, data)

    def readfrom_mem(self, address, register, length):
        data = bytearray(length)
        self.readfrom_mem_into(address, register, data)
        return data

    def readfrom_mem_into(self, address, register, data):
        self._chip.readfrom_mem_into(address, register, data)
        if not self._is_on():
            return
        for n in range(len(data)):
            place = (register & 0x7F) + n
            data[n] = self._registers.get(place, data[n])
        if register == MST_STATUS and self._mag in ("absent", "hung"):
            data[0] = NACK if self._mag == "absent" else 0
        if register == BURST and len(data) > INERTIAL and self._mag:
            data[ST1] = 0
        if register == XM_BURST and self._mag:
            data[STATUS_M] = 0
        for n in range(len(data) if self._bus else 0):
            data[n] = int(self._bus, 16)


def main(fakes, package, kind, frames, seconds, *words):
    sys.path.append(fakes)
    sys.path.append(package)
    from probe.plain import Probe
    from wire import Wire

    if kind == "mpu9250":
        from probe.driver_mpu9250 import Driver
    else:
        from probe.driver_lsm9ds0 import Driver
    about = dict(word.split("=") for word in words)
    chip = chips.Chip(kind)
    chip.hold((0, 0, 0), (0, 0, float(about.pop("force", "9.81"))), (20, 0, -40))
    altered = Altered(chip, about)
    probe = Probe(None, id=b"altered", firmware="altered")
    probe.attach(Driver(), altered, altered)
    wire = Wire()
    was_high = False
    stepped_us = 0
    while (now_us := ticks_us()) < int(seconds) * 1_000_000:
        is_high = altered.value()
        if is_high and not was_high:
            probe.edge(None)
        was_high = is_high
        worked = probe.acquire()
        if now_us - stepped_us >= STEP_US:
            stepped_us = now_us
            probe.step(PRESS_US[0] <= now_us < PRESS_US[1])
            probe.send(wire)
        if not worked:
            chips.wait(TURN_US)
    assert chip.complaint() is None, chip.complaint()
    host.write(frames, b"".join(wire.frames))
    for register, value, t_us in altered.written:
        print(register, value, t_us)  # noqa: T201 - it has no sys.stdout


main(*sys.argv[1:])
