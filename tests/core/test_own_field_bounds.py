# SPDX-License-Identifier: MIT
"""The probe's own field has three axes, and no memory next to them is written."""

from __future__ import annotations

from core.desk import ffi, lib
from core.test_own_field import begun, known, turned


def test_a_filter_takes_three_axes_of_its_own_field_and_nothing_beside_them():
    probe = begun()
    before = bytes(ffi.buffer(probe.c))
    lib.fuse_use_own(probe.c, known())
    whole = bytearray(ffi.buffer(probe.c))
    base = int(ffi.cast("uintptr_t", probe.c))
    for field, size in (
        (probe.c.state.field_ut + 3, 12),
        (ffi.addressof(probe.c.settings, "own_variance"), 2),
    ):
        at = int(ffi.cast("uintptr_t", field)) - base
        assert whole[at : at + size] != before[at : at + size]
        whole[at : at + size] = before[at : at + size]
    assert bytes(whole) == before
    # What is read has three axes, too: nothing lies behind it.
    turned_about = begun()
    turned_about.feel(turned(40))
    room = ffi.new("struct own_field[2]")
    lib.fuse_read_own(turned_about.c, room)
    assert bytes(ffi.buffer(room + 1, ffi.sizeof(room[1]))) == bytes(
        ffi.sizeof(room[1])
    )
