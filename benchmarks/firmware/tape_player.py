# SPDX-License-Identifier: MIT
"""Runs in MicroPython: plays a tape to the module's Probe.

A sample is its time, u32 microseconds, and the eleven values of sample(). Among them
stand command frames, as 0xFFFFFFFF, their time, their length and their bytes, and what
sensor() is told, as 0xFFFFFFFE and seven numbers.
"""

import struct
from array import array

COMMAND = 0xFFFFFFFF
SENSOR = 0xFFFFFFFE


def play(probe, data, send):
    """Calls send() with what the probe sends."""
    out = bytearray(4096)
    values = array("h", bytes(22))
    at = 0
    while at < len(data):
        (time_us,) = struct.unpack_from("<I", data, at)
        at += 4
        if time_us == COMMAND:
            time_us, length = struct.unpack_from("<II", data, at)
            at += 8
            probe.receive(bytes(data[at : at + length]), time_us)
            at += length
        elif time_us == SENSOR:
            about = struct.unpack_from("<7I", data, at)
            at += 28
            time_us = about[-1]
            probe.sensor(*about)
        else:
            for i in range(11):
                values[i] = struct.unpack_from("<h", data, at + 2 * i)[0]
            at += 22
            probe.sample(values, time_us)
        probe.step(False, time_us)
        length = probe.take(out)
        if length:
            send(bytes(out[:length]))
