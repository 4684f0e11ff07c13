# SPDX-License-Identifier: MIT
"""Runs in MicroPython: the module as a native .mpy, with a clock and a bus of our own.

    micropython seam.py

Its clock wraps as that of a board with 32 bits. Prints what came of each.
"""

import sys

PERIOD = 1 << 30
STEP_US = 5000


class Clock:
    """The module `time`. `at_us` has more bits than what it tells."""

    at_us = PERIOD // 4
    between = None  # an interrupt that comes after the clock was read

    def ticks_us():
        told = Clock.at_us % PERIOD
        interrupt, Clock.between = Clock.between, None
        if interrupt is not None:
            Clock.at_us += 40
            interrupt(None)
        return told


sys.modules["time"] = Clock
import imuprobe  # noqa: E402 - which takes its clock from there


class OwnError(OSError):
    pass


class Bus:
    """An MPU-9250's name, and zeros; or it raises `error`."""

    error = None

    def readfrom_mem_into(self, _address, register, data):
        if self.error is not None:
            raise self.error
        for n in range(len(data)):
            data[n] = 0x71 if register == 0x75 else 0

    def writeto_mem(self, _address, _register, _data):
        if self.error is not None:
            raise self.error


def sent(probe):
    out = bytearray(8192)
    return bytes(out[: probe.take(out)]).hex()


def tell_times(probe):
    """Events told shortly before each quarter of a period, of which every fourth is a
    wrap, while an edge comes behind it.
    """
    for quarter in range(2, 40):
        Clock.at_us = quarter * (PERIOD // 4) - 20
        Clock.between = probe.edge
        probe.tell(1, 0, quarter)
    return sent(probe)


def raised(probe, error):
    """The exceptions of a second with a bus that raises, and what the probe sends."""
    Bus.error = error
    names = set()
    for _ in range(200):
        Clock.at_us += STEP_US
        try:
            probe.acquire()
        except Exception as found:  # noqa: BLE001 - its name is what is asked for
            names.add(type(found).__name__)
        probe.step(False)
    return "{} {}".format(",".join(sorted(names)), sent(probe))


def refused(work):
    try:
        work()
    except Exception as found:  # noqa: BLE001
        return f"{type(found).__name__}: {found}"


probe = imuprobe.Probe(None, id=b"seam", firmware="seam", room=8192)
print(tell_times(probe))
probe.attach(imuprobe.MPU9250, Bus(), None)
for error in (OSError(5), OSError(), OwnError(110), OSError(116), KeyError("own")):
    print(raised(probe, error))
print(refused(lambda: imuprobe.Probe(None, id=b"x")))
print(refused(lambda: probe.sample(b"12")))
print(refused(lambda: probe.attach(99, Bus(), None)))
print("DONE")
