# SPDX-License-Identifier: MIT
"""Settings that a probe without the C module keeps without power, and how its id is
made."""

import struct

from micropython import const

_CELLS = const(1024)  # bytes of a storage
_PLACE = const(896)  # among them: what the C firmware leaves free
_FORM = "<HHHH"  # boots, raw rate, pose rate, their check
_CHECK = const(0x5AA5)
_RATE_MAX = const(1000)
_POSE_RATE = const(100)


def id_of(data):
    """FNV-1a of 64 bits, as the C folds the id of a chip."""
    value = 0xCBF29CE484222325
    for byte in data:
        value = ((value ^ byte) * 0x100000001B3) & 0xFFFFFFFFFFFFFFFF
    return bytes((value >> (8 * i)) & 0xFF for i in range(8))


def is_rate(hz):
    return 1 <= hz <= _RATE_MAX


class Settings:
    """`boots` counts this one. `rate`: raw messages a second, at most; `pose_rate`:
    poses.
    """

    def __init__(self, storage):
        self._storage = storage
        self._cells = bytearray(b"\xff" * _CELLS)
        if storage is not None:
            storage.load(self._cells)
        boots, rate, poses, check = struct.unpack_from(_FORM, self._cells, _PLACE)
        is_good = check == boots ^ rate ^ poses ^ _CHECK
        is_good = is_good and is_rate(rate) and is_rate(poses)
        if not is_good:
            boots, rate, poses = 0, _RATE_MAX, _POSE_RATE
        self.boots = (boots + 1) & 0xFFFF
        self.rate = rate
        self.pose_rate = poses

    def save(self):
        """False where they are not kept."""
        values = self.boots, self.rate, self.pose_rate
        check = self.boots ^ self.rate ^ self.pose_rate ^ _CHECK
        struct.pack_into(_FORM, self._cells, _PLACE, *values, check)
        if self._storage is not None:
            try:
                self._storage.save(self._cells)
            except OSError:
                return False
        return True
