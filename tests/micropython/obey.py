# SPDX-License-Identifier: MIT
"""Runs in MicroPython: the plain probe hears frames, in hex, so many bytes at a time,
and prints what it sends.

    micropython obey.py BYTES FRAME...
"""

import sys

from probe.plain import Probe


class Wire:
    def __init__(self, data):
        self.data = data
        self.at = self.end = 0
        self.sent = b""

    def any(self):
        return self.end - self.at

    def readinto(self, one):
        one[0] = self.data[self.at]
        self.at += 1

    def write(self, data, at, length):
        self.sent += bytes(data[at : at + length])
        return length


def unhex(text):
    return bytes(int(text[at : at + 2], 16) for at in range(0, len(text), 2))


def main(size, *frames):
    probe = Probe(None, id=b"obey", firmware="obey")
    wire = Wire(b"".join(map(unhex, frames)))
    while wire.end < len(wire.data):
        wire.end = min(wire.end + int(size), len(wire.data))
        probe.receive(wire)
    probe.send(wire)
    print("".join(f"{byte:02x}" for byte in wire.sent))


main(*sys.argv[1:])
