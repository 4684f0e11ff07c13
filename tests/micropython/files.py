# SPDX-License-Identifier: MIT
"""Runs in MicroPython: settings and logs on its own file systems, in memory.

    micropython files.py FOLDER-OF-THE-PACKAGE littlefs|fat

Prints how many cuts of power the save of settings had.
"""

import os
import sys

sys.path.append(sys.argv[1])

from log import FileLog
from storage import FileStorage

BLOCK = 512
BLOCKS = 256
OLD, NEW = b"o" * 1024, b"n" * 1024
FULL = 18  # event


class Disk:
    """Blocks in memory; the power is cut before write number `cut`."""

    def __init__(self):
        self.data = bytearray(BLOCK * BLOCKS)
        self.left = None

    def readblocks(self, number, data, offset=0):
        begin = number * BLOCK + offset
        data[:] = self.data[begin : begin + len(data)]

    def writeblocks(self, number, data, offset=0):
        if self.left is not None:
            if not self.left:
                raise OSError(5)
            self.left -= 1
        begin = number * BLOCK + offset
        self.data[begin : begin + len(data)] = data

    def ioctl(self, request, _):
        return {4: BLOCKS, 5: BLOCK}.get(request, 0)


def mounted(disk, system):
    """Mounts at /ram what is on the disk."""
    os.mount(system(disk), "/ram")


def loaded():
    cells = bytearray(1024)
    FileStorage("/ram/settings").load(cells)
    return bytes(cells)


def cut_everywhere(disk, system):
    """Number of writes of a save, each of which was the first that failed."""
    mounted(disk, system)
    FileStorage("/ram/settings").save(OLD)
    os.umount("/ram")
    before = bytes(disk.data)
    cut = 0
    while True:
        disk.data[:] = before
        disk.left = cut
        mounted(disk, system)
        try:
            FileStorage("/ram/settings").save(NEW)
            is_whole = True
        except OSError:
            is_whole = False
        disk.left = 0
        os.umount("/ram")
        disk.left = None
        mounted(disk, system)
        found = loaded()
        os.umount("/ram")
        assert found in (OLD, NEW), (cut, found[:4])
        if is_whole:
            assert found == NEW
            return cut
        cut += 1


class Probe:
    def __init__(self):
        self.events = []

    def tell(self, event, _cause, detail):
        self.events.append((event, detail))


def log_until_full(disk, system):
    """The log grows to the size of the disk; then settings stay as they are."""
    mounted(disk, system)
    probe = Probe()
    log = FileLog("/ram")
    log.open(probe)
    piece = bytes(range(256)) * 4
    for _ in range(BLOCKS):
        log.write(piece, 0, len(piece))
        log.step(probe)
    assert probe.events == [(19, 1), (FULL, 0)], probe.events
    assert os.stat("/ram/imu-0001.bin")[6] > BLOCK * BLOCKS // 2
    with open("/ram/imu-0001.bin", "rb") as file:
        assert file.read(1024) == piece
    try:
        FileStorage("/ram/settings").save(OLD)
        raise AssertionError("it had room")
    except OSError:
        assert loaded() == NEW
    os.umount("/ram")


def main(name):
    system = {"littlefs": os.VfsLfs2, "fat": os.VfsFat}[name]
    disk = Disk()
    system.mkfs(disk)
    print(cut_everywhere(disk, system))
    log_until_full(disk, system)


main(sys.argv[2])
