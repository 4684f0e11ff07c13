# SPDX-License-Identifier: MIT
"""Runs in MicroPython: writes the file system of a Pico's flash.

    micropython flash.py IMAGE [FILE NAME]...

The rp2 port has LittleFS in the upper 1408 KB of it.
"""

import os
import sys

import host

BLOCK = 4096
BLOCKS = 352
FLASH = 2 << 20


class Disk:
    def __init__(self):
        self.data = bytearray(b"\xff" * (BLOCK * BLOCKS))

    def readblocks(self, number, data, offset=0):
        begin = number * BLOCK + offset
        data[:] = self.data[begin : begin + len(data)]

    def writeblocks(self, number, data, offset=0):
        begin = number * BLOCK + offset
        self.data[begin : begin + len(data)] = data

    def ioctl(self, request, _):
        return {4: BLOCKS, 5: BLOCK}.get(request, 0)


def main(image, *files):
    disk = Disk()
    os.VfsLfs2.mkfs(disk, progsize=256)
    os.mount(os.VfsLfs2(disk, progsize=256), "/flash")
    os.mkdir("/flash/probe")
    for at in range(0, len(files), 2):
        host_file, name = files[at : at + 2]
        with open("/flash/" + name, "wb") as file:
            file.write(host.read(host_file))
    os.umount("/flash")
    host.write(image, b"\xff" * (FLASH - len(disk.data)) + disk.data)


main(*sys.argv[1:])
