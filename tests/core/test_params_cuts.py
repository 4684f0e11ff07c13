# SPDX-License-Identifier: MIT
"""Params when power fails, a byte is spoilt, or a probe restarts during a change."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params_desk import (
    ACC,
    BANK,
    BASE,
    FULL,
    GYR,
    SMALL,
    Cells,
    PowerCutError,
    Store,
    again,
    digest,
    lib,
    stored,
    values_of,
)
from core.settings_desk import LEFT_BEHIND

pytestmark = pytest.mark.sampled(2)

NONE = Store().image
OK, DAMAGED = lib.RESULT_OK, lib.RESULT_DAMAGED


@pytest.mark.sampled(6)
@pytest.mark.parametrize("left", LEFT_BEHIND, ids=str)
@pytest.mark.parametrize("before", [(), (SMALL,), (SMALL, ACC + GYR)], ids=len)
def test_a_cut_at_any_write_leaves_the_old_params_or_the_changed_ones(left, before):
    start = bytes(stored(*before).bytes)
    old = Store(Cells(start)).image
    new = values_of(FULL)
    plain = Store(Cells(start))
    assert plain.change(FULL) == OK
    count = len(plain.memory.writes)
    assert count > len(FULL) // 2
    for cut_at in range(1, count + 1):
        memory = Cells(start)
        memory.cut_at, memory.left = cut_at, LEFT_BEHIND[left]
        store = Store(memory)
        with pytest.raises(PowerCutError):
            store.change(FULL)
        after = again(memory)
        assert after.image in ((old, new) if cut_at == count else (old,))
        # And from there on all is as ever.
        assert after.change(FULL) == OK
        assert again(after.memory).image == new


def test_a_reset_at_any_step_leaves_the_old_params_or_the_changed_ones():
    start = bytes(stored(SMALL).bytes)
    old, new = values_of(SMALL), values_of(FULL)
    taken = 0
    is_over = False
    while not is_over:
        store = Store(Cells(start))
        left = taken
        is_over = True
        for at in range(0, len(FULL), 4):
            store.write(at, FULL[at : at + 4])
            while left > 0 and store.step() != lib.PARAMS_IDLE:
                left -= 1
            if left <= 0:
                is_over = False
                break
        else:
            store.ask(len(FULL), digest(FULL))
            while left > 0 and store.step() != lib.PARAMS_IDLE:
                left -= 1
            is_over = left > 0
        after = again(store.memory)
        assert after.image in (old, new)
        assert after.is_whole
        assert after.change(FULL) == OK
        taken += 7


@pytest.mark.parametrize("flip", [0x01, 0x80, 0xFF])
def test_one_spoilt_byte_of_what_is_staged_is_damage(flip):
    start = stored(SMALL)
    old = Store(start).image
    for at in range(len(FULL)):
        wrong = bytearray(FULL)
        wrong[at] ^= flip
        store = again(start)
        store.stage(bytes(wrong))
        assert store.apply(len(FULL), digest(FULL))[0] == DAMAGED
        assert store.image == old
        assert again(store.memory).image == old


def test_one_spoilt_byte_in_memory_is_told_and_leaves_the_params_before():
    memory = stored(SMALL, FULL)
    small, full = values_of(SMALL), values_of(FULL)
    newest = Store(memory).bank
    used = lib.BANK_HEADER + len(FULL)
    for offset in range(BASE, BASE + 2 * BANK):
        spoilt = Cells(bytes(memory.bytes))
        spoilt.bytes[offset] ^= 0x10
        store = Store(spoilt)
        bank, at = divmod(offset - BASE, BANK)
        is_in_newest = bank == newest and at < used
        assert store.image == (small if is_in_newest else full), f"byte {offset}"
        if is_in_newest and at >= 2:  # without a mark it was never there
            assert not store.is_whole


@given(st.binary(min_size=2 * BANK, max_size=2 * BANK))
def test_noise_in_memory_is_no_params(content):
    memory = Cells()
    memory.bytes[BASE : BASE + 2 * BANK] = content
    assert Store(memory).image == NONE
