# SPDX-License-Identifier: MIT
"""Runs in MicroPython: the plain probe hears frames, in hex, and prints what it sends.

micropython obey.py FRAME...
"""

import sys

from probe.plain import Probe


class Wire:
    def __init__(self, data):
        self.data = data
        self.at = 0
        self.sent = b""

    def any(self):
        return len(self.data) - self.at

    def readinto(self, one):
        one[0] = self.data[self.at]
        self.at += 1

    def write(self, data, at, length):
        self.sent += bytes(data[at : at + length])
        return length


def unhex(text):
    return bytes(int(text[at : at + 2], 16) for at in range(0, len(text), 2))


def main(frames):
    probe = Probe(None, id=b"obey", firmware="obey")
    wire = Wire(b"".join(map(unhex, frames)))
    probe.receive(wire)
    probe.send(wire)
    print("".join(f"{byte:02x}" for byte in wire.sent))


main(sys.argv[1:])
