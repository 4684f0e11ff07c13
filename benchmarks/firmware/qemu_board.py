# SPDX-License-Identifier: MIT
"""Runs in MicroPython on a board of qemu, which has neither files nor a clock, behind
lines that say where in memory its files are: a file system with the module, and a
counter of instructions as the clock. Another program follows.
"""
# ruff: noqa: F821 - the names that those lines give it

import io
import sys
from binascii import hexlify

import uctypes
import vfs

import micropython

FILE = 0x8000
LINE = 512


class File(io.IOBase):
    def __init__(self):
        self.at = 0

    def ioctl(self, _request, _argument):
        return 0

    def readinto(self, data):
        count = min(len(data), len(MPY) - self.at)
        data[:count] = MPY[self.at : self.at + count]
        self.at += count
        return count


class Files:
    """A file system with imuprobe.mpy alone."""

    def mount(self, _is_read_only, _is_made):
        pass

    def stat(self, path):
        if not path.endswith("imuprobe.mpy"):
            raise OSError(2)
        return (FILE, 0, 0, 0, 0, 0, 0, 0, 0, 0)

    def open(self, _path, _mode):
        return File()


class Time:
    @micropython.viper
    def ticks_us() -> int:
        return int(ptr32(int(TICKS))[0]) * int(SIGN) & 0x3FFFFFFF


def send(data):
    for begin in range(0, len(data), LINE):
        print("SENT", hexlify(data[begin : begin + LINE]).decode())


MPY, TAPE = (uctypes.bytearray_at(*place) for place in (MPY_AT, TAPE_AT))
vfs.mount(Files(), "/files")
sys.path.append("/files")
sys.modules["time"] = Time
