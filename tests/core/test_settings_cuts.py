# SPDX-License-Identifier: MIT
"""Settings where power goes, or a byte is spoilt."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.settings_desk import (
    BANK,
    BANKS,
    LEFT_BEHIND,
    PLACES,
    Memory,
    PowerCutError,
    Probe,
    lib,
    saved,
)

pytestmark = pytest.mark.sampled(2)


@pytest.mark.parametrize("left", LEFT_BEHIND, ids=str)
@pytest.mark.parametrize("saves", [0, 1, 2, 3])
def test_a_cut_at_any_byte_leaves_the_old_settings_or_the_changed_ones(left, saves):
    memory, old = saved(*range(1, saves + 1))
    before = bytes(memory.bytes)
    probe = Probe(Memory(before))
    probe.change(77)
    probe.save()
    count = len(probe.memory.writes)
    assert count >= 10
    for cut_at in range(1, count + 1):
        memory = Memory(before)
        memory.cut_at, memory.left = cut_at, LEFT_BEHIND[left]
        probe = Probe(memory)
        changed = probe.change(77)
        with pytest.raises(PowerCutError):
            probe.save()
        after = Probe(Memory(bytes(memory.bytes)))
        if after.loaded == lib.SETTINGS_NONE:
            assert saves == 0, f"both slots are lost by a cut at write {cut_at}"
            continue
        assert after.image in (old, changed), f"a mixture by a cut at write {cut_at}"
        # And from there on all is as ever.
        last = after.change(99)
        assert after.save() == lib.MEMORY_OK
        assert Probe(after.memory).image == last


@given(
    cuts=st.lists(
        st.tuples(st.integers(1, 2 * BANK), st.integers(0, 255)), min_size=1, max_size=8
    )
)
def test_cut_after_cut_nothing_is_lost_that_was_saved(cuts):
    memory, last = saved(1)
    for number, (cut_at, garbage) in enumerate(cuts, 2):
        memory = Memory(bytes(memory.bytes))
        memory.cut_at = cut_at
        memory.left = (0, 0, garbage)
        probe = Probe(memory)
        assert probe.loaded == lib.SETTINGS_OK
        assert probe.image == last
        changed = probe.change(number)
        try:
            assert probe.save() == lib.MEMORY_OK
            last = changed
        except PowerCutError:
            after = Probe(Memory(bytes(memory.bytes)))
            assert after.loaded == lib.SETTINGS_OK
            assert after.image in (last, changed)
            last = after.image


@pytest.mark.parametrize("saves", [2, 3])
@pytest.mark.parametrize("flip", [0x01, 0x80, 0xFF])
def test_one_spoilt_byte_leaves_one_good_bank(saves, flip):
    memory, newest = saved(*range(1, saves + 1))
    older = saved(*range(1, saves))[1]
    # The first save of a new memory goes to the second bank.
    newest_bank = saves % 2
    used = lib.BANK_HEADER + 25
    for offset in PLACES:
        spoilt = Memory(bytes(memory.bytes))
        spoilt.bytes[offset] ^= flip
        probe = Probe(spoilt)
        assert probe.loaded == lib.SETTINGS_OK, f"byte {offset}"
        bank, at = divmod(offset - BANKS, BANK)
        is_in_newest = bank == newest_bank and at < used
        assert probe.image == (older if is_in_newest else newest), f"byte {offset}"


def test_all_values_of_each_byte_of_a_header_leave_one_good_bank():
    memory, newest = saved(1, 2)
    older = saved(1)[1]
    for bank in range(2):
        for at in range(lib.BANK_HEADER):
            for value in range(256):
                spoilt = Memory(bytes(memory.bytes))
                spoilt.bytes[BANKS + bank * BANK + at] = value
                assert Probe(spoilt).image in (older, newest)


@given(st.binary(min_size=len(PLACES), max_size=len(PLACES)))
def test_noise_gives_the_defaults(content):
    memory = Memory()
    memory.bytes[PLACES.start : PLACES.stop] = content
    assert Probe(memory).loaded == lib.SETTINGS_NONE
