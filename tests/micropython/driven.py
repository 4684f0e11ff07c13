# SPDX-License-Identifier: MIT
"""Runs in MicroPython: a probe with a modelled chip, which is held in one motion after
the other.

    micropython driven.py FAKES PACKAGE KIND VARIANT BUS FRAMES [COMMAND-IN-HEX ...]

VARIANT is `module` or `plain`, BUS is `i2c` or `spi`. From 3 s on another motion is
held every 100 ms.
"""

import sys
from time import ticks_us

import chips

import host

FIRST_US = 3_000_000
EACH_US = 100_000
MOTIONS = 20
TURN_US = 25  # the MPU-9250's pulse takes 50
PRESS_US = 200_000, 300_000


def motion(number):
    """Three times three numbers within the ranges of both chips."""
    state = number + 1
    found = []
    for limit in (30.0, 100.0, 150.0):  # rad/s, m/s2, uT
        axes = []
        for _ in range(3):
            state = (state * 1103 + 12345) & 0xFFFF
            axes.append(limit * (state / 32768 - 1))
        found.append(axes)
    return found


class Module:
    def __init__(self, kind, chip, bus, commands):
        import imuprobe

        self.probe = imuprobe.Probe(None, id=b"driven", firmware="driven", time_us=0)
        kinds = {"mpu9250": imuprobe.MPU9250, "lsm9ds0": imuprobe.LSM9DS0}
        self.probe.attach(kinds[kind], bus, chip)
        for command in commands:
            pairs = (command[at : at + 2] for at in range(0, len(command), 2))
            self.probe.receive(bytes(int(pair, 16) for pair in pairs))
        self.out = bytearray(4096)

    def sent(self):
        return bytes(self.out[: self.probe.take(self.out)])


class Plain:
    def __init__(self, kind, chip, bus):
        from probe.plain import Probe
        from wire import Wire

        if kind == "mpu9250":
            from probe.driver_mpu9250 import Driver
        else:
            from probe.driver_lsm9ds0 import Driver
        self.probe = Probe(None, id=b"driven", firmware="driven")
        self.probe.attach(Driver(), bus, chip)
        self.wire = Wire()

    def sent(self):
        self.probe.send(self.wire)
        frames, self.wire.frames = self.wire.frames, []
        return b"".join(frames)


def bus_of(name, chip, kind):
    if name == "i2c":
        return chip
    from fake_spi import FakeSPI
    from probe.spi import SPIBus

    spi = FakeSPI(chip, kind)
    return SPIBus(spi, spi.selects)


def main(fakes, package, kind, variant, wire, frames, *commands):
    sys.path.append(fakes)
    sys.path.append(package)
    chip = chips.Chip(kind)
    bus = bus_of(wire, chip, kind)
    is_module = variant == "module"
    made = Module(kind, chip, bus, commands) if is_module else Plain(kind, chip, bus)
    probe = made.probe
    was_high = False
    held = 0
    sent = []
    while held <= MOTIONS:
        now_us = ticks_us()
        if now_us >= FIRST_US + held * EACH_US:
            chip.hold(*motion(held))
            held += 1
        is_high = chip.value()
        if is_high and not was_high:
            probe.edge(None)
        was_high = is_high
        worked = probe.acquire()
        probe.step(PRESS_US[0] <= now_us < PRESS_US[1])
        sent.append(made.sent())
        if not worked:
            chips.wait(TURN_US)
    assert chip.complaint() is None, chip.complaint()
    host.write(frames, b"".join(sent))


main(*sys.argv[1:])
