# SPDX-License-Identifier: MIT
"""Runs in MicroPython: gives the samples of a file to the module's Probe and writes
what it sends to another file.

    micropython feed.py SAMPLES FRAMES MEMORY
"""

import sys

from imuprobe import Probe
from tape_player import play

import host


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


def main(samples, frames, memory):
    probe = Probe(Storage(memory), id=b"host", firmware="test", time_us=0)
    sent = []
    play(probe, host.read(samples), sent.append)
    host.write(frames, b"".join(sent))


main(*sys.argv[1:])
