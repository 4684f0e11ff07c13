# SPDX-License-Identifier: MIT
"""Recordings on a card: the file is found, what is put in comes back."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.fake_card import ACCEPTED, BAD_CRC, BLOCK
from core.fake_spi import Wire
from core.log_desk import (
    FRAME,
    RATE_HZ,
    RING,
    SECOND,
    Log,
    Volume,
    ffi,
    frames_of,
    lib,
    made_frame,
    opened,
    read,
    sealed,
    words,
)
from length import examples

pytestmark = pytest.mark.sampled(3)


@pytest.mark.parametrize("is_sdhc", [True, False])
@pytest.mark.parametrize("kind", [0x0B, 0x0C])
@pytest.mark.parametrize("entry", range(4))
@pytest.mark.parametrize("others", [0, 40, 100])
def test_the_prepared_file_is_found(is_sdhc, kind, entry, others):
    volume = Volume(kind=kind, entry=entry, others=others)
    log = Log(volume.card(is_sdhc=is_sdhc)).until("ready")
    assert log.changes == [("card_ready", "none", 1)]
    assert (log.status.card_block, log.status.card_blocks) == (1, volume.blocks)
    assert log.status.recording == 0
    assert log.status.card_faults == 0


@pytest.mark.parametrize("cluster", [1, 8, 128])
@pytest.mark.parametrize("blocks", [2, 3, 257, 1025])
def test_the_file_is_of_any_size(cluster, blocks):
    log = Log(Volume(blocks, cluster=cluster).card()).until("ready")
    assert log.status.card_blocks == blocks


def test_what_is_put_in_comes_back():
    volume = Volume()
    log = opened(volume).log(SECOND).close()
    blocks = read(volume)[1]
    assert frames_of(blocks) == log.kept
    assert log.dropped == 0
    assert [number for number, _, _ in blocks] == [*range(1, len(blocks) + 1)]
    assert [flags for _, flags, _ in blocks] == [1, *[0] * (len(blocks) - 2), 2]
    assert log.changes == [
        ("card_ready", "none", 1),
        ("log_started", "none", 1),
        ("log_ended", "command", 1),
    ]
    assert log.state == "ready"
    assert log.status.card_block == len(blocks) + 1
    assert {block for block, _ in log.card.runs} <= {
        volume.file + number for number in range(1, volume.blocks)
    }


@pytest.mark.parametrize("ring", [2048, 2049, 4099, RING])
@pytest.mark.parametrize("length", [2, 17, 118, 125, 255])
def test_frames_of_any_length_stay_whole_in_any_ring(ring, length):
    volume = Volume(800)
    log = Log(volume.card(), ring=ring).until("ready").open()
    for _ in range(700):
        log.number += 1
        if length > 9:
            log.keep(made_frame(log.number, length))
        else:
            log.keep(b"x" * (length - 1) + b"\0")
        log.step(length * 20.0)
    log.close()
    assert frames_of(read(volume)[1]) == log.kept
    assert log.put


def test_a_recording_without_a_frame_is_a_block():
    volume = Volume()
    opened(volume).close()
    assert read(volume) == {1: [(1, 3, bytes(496))]}


def test_recordings_are_numbered_on_in_one_run_and_over_restarts():
    volume = Volume()
    for number in (1, 3, 5):
        log = opened(volume).log(50_000).close()
        log.open().log(50_000).close()
        assert log.status.recording == number + 1
    found = read(volume)
    assert [*found] == [1, 2, 3, 4, 5, 6]
    for blocks in found.values():
        assert blocks[0][1] & 1
        assert blocks[-1][1] & 2


def test_the_number_of_a_recording_is_never_zero():
    volume = Volume()
    volume.content[volume.file + 1] = volume.good(1, 65535)
    opened(volume).close()
    assert [*read(volume)] == [65535, 1]


def test_a_frame_is_on_the_card_after_a_tenth_of_a_second():
    volume = Volume()
    log = opened(volume)
    log.keep(made_frame(1))
    log.run(99_000)
    assert not log.card.runs
    log.run(10_000)
    assert frames_of(read(volume)[1]) == log.kept


def test_nothing_is_taken_without_a_recording():
    log = Log(Volume().card())
    assert not log.keep(made_frame(1))
    log.until("ready")
    assert not log.keep(made_frame(1))
    log.open()
    assert not lib.logbook_open(log.book)
    assert log.keep(made_frame(1))
    lib.logbook_close(log.book, lib.CAUSE_COMMAND)
    assert not log.keep(made_frame(2))


@pytest.mark.parametrize("last", [1, 2, 7, 8, 9, 100, 397, 398])
@pytest.mark.parametrize("gap", range(9))
def test_the_end_is_found_behind_gaps_of_up_to_eight(last, gap):
    volume = Volume()
    for number in range(1, last + 1):
        volume.content[volume.file + number] = volume.good(number, 7)
    for number in range(max(last - gap, 1), last):
        volume.content[volume.file + number] = bytes(BLOCK)
    log = Log(volume.card()).until("ready")
    assert log.status.card_block == last + 1
    assert log.status.recording == 7


@settings(max_examples=examples(60))
@given(st.data())
def test_the_end_is_found_whatever_is_worn(data):
    volume = Volume(200)
    last = data.draw(st.integers(0, 198))
    bad, number = set(), 1
    while number < last:
        number += data.draw(st.integers(1, 60))
        run = data.draw(st.integers(1, 8))
        bad |= {*range(number, min(number + run, last))}
        number += run
    card = volume.card()
    for number in range(1, last + 1):
        block = bytearray(volume.good(number, number // 50 + 1))
        if number in bad:
            how = data.draw(st.integers(0, 3))
            if how == 0:
                card.unreadable.add(volume.file + number)
            elif how == 1:
                block = bytearray(volume.good(number + 1))
            elif how == 2:
                block[data.draw(st.integers(0, 511))] ^= 0x40
            else:
                block[:] = sealed(words(volume.card_id ^ 1, number, 1))
        volume.content[volume.file + number] = bytes(block)
    log = Log(card).until("ready")
    assert log.status.card_block == last + 1
    assert log.status.recording == (last // 50 + 1 if last else 0)


def test_changes_that_nobody_takes_make_room_for_later_ones():
    log = Log(Volume().card()).until("ready")
    for _ in range(10):
        log.open()
        lib.logbook_close(log.book, lib.CAUSE_COMMAND)
        while not lib.logbook_is_idle(log.book):
            lib.logbook_step(log.book, log.wire.time)
            log.wire.sleep()
    log.changes.clear()
    log.step()
    assert len(log.changes) == lib.LOGBOOK_CHANGES
    assert log.changes[-1] == ("log_ended", "command", 10)


def test_time_may_wrap_amid_a_recording():
    volume = Volume()
    wire = Wire(ffi, volume.card())
    wire.now_us = 2.0**32 - 700_000
    log = Log(wire.card, wire=wire).until("ready").open().log(2 * SECOND).close()
    assert frames_of(read(volume)[1]) == log.kept


def test_of_changes_that_nobody_takes_the_latest_are_kept_in_their_order():
    book = ffi.new("struct logbook *")
    most = lib.LOGBOOK_CHANGES
    for number in range(most + 2):
        lib.logbook_tell(book, lib.EVENT_CARD_FAULT, lib.CAUSE_WORN, number)
    change = ffi.new("struct logbook_change *")
    taken = []
    while lib.logbook_take_change(book, change):
        taken.append(change.detail)
    assert taken == [*range(2, most + 2)]


# At the higher rate the last block is not the first of its run.
@pytest.mark.parametrize("rate_hz", [RATE_HZ, 3000])
def test_a_full_file_ends_the_recording_with_a_whole_frame(rate_hz):
    volume = Volume(60)
    log = opened(volume).log(SECOND, rate_hz)
    assert log.state == "full"
    assert log.changes[-2:] == [("log_ended", "full", 1), ("card_full", "full", 60)]
    blocks = read(volume)[1]
    assert len(blocks) == 59
    assert blocks[-1][1] == 2
    found = frames_of(blocks)
    assert found == log.kept[: len(found)]
    # Frames continue from one block to the next, but for the last block.
    ends = [content.rstrip(b"\0").split(b"\0")[-1] for _, _, content in blocks]
    assert len(ends[-1]) == FRAME - 1
    assert {len(end) for end in ends[:-1]} != {FRAME - 1}
    assert not log.keep(made_frame(1))
    log.run(3 * SECOND)
    assert log.state == "full"
    again = Log(log.card).until("full")
    assert again.changes == [("card_full", "full", 60)]
    assert not lib.logbook_open(again.book)
    assert again.status.recording == 1


def test_a_recording_has_three_restarts_of_the_card_before_its_first_block():
    volume = Volume()
    log = opened(volume)
    # The first try is that of a run of blocks; then there are three for each restart.
    log.card.refuse = lambda block, tried: (
        BAD_CRC if block - volume.file == 1 and tried <= 10 else ACCEPTED
    )
    log.log(SECOND).close()
    faults = [change for change in log.changes if change[0] == "card_fault"]
    assert [cause for _, cause, _ in faults] == ["rejected"] * 3
    assert frames_of(read(volume)[1]) == log.kept
