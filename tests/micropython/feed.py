# SPDX-License-Identifier: MIT
"""Runs in MicroPython: gives the samples of a file to the module's Probe and writes
what it sends to another file.

    micropython feed.py SAMPLES FRAMES MEMORY

A sample is its time, u32 microseconds, and the eleven values of sample(). Among them
stand command frames, as 0xFFFFFFFF, their time, their length and their bytes, and what
sensor() is told, as 0xFFFFFFFE and seven numbers.
"""

import struct
import sys
from array import array

from imuprobe import Probe

import host

STEP_US = 5000
COMMAND = 0xFFFFFFFF
SENSOR = 0xFFFFFFFE


class Storage:
    """A file of the machine that runs this."""

    def __init__(self, path):
        self.path = path

    def load(self, cells):
        try:
            cells[:] = host.read(self.path)
        except OSError:
            pass

    def save(self, cells):
        host.write(self.path, cells)


def play(probe, data, sent):
    """Plays the samples and commands; appends what is sent."""
    out = bytearray(4096)
    values = array("h", bytes(22))
    at = 0
    while at < len(data):
        (time_us,) = struct.unpack_from("<I", data, at)
        at += 4
        if time_us == COMMAND:
            time_us, length = struct.unpack_from("<II", data, at)
            at += 8
            probe.receive(data[at : at + length], time_us)
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
        sent.append(bytes(out[: probe.take(out)]))


def main(samples, frames, memory):
    probe = Probe(Storage(memory), id=b"host", firmware="test", time_us=0)
    sent = []
    play(probe, host.read(samples), sent)
    host.write(frames, b"".join(sent))


main(*sys.argv[1:])
