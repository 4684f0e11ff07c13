# SPDX-License-Identifier: MIT
"""Recordings on a card: the prepared file is found or refused, what was put in comes
back whole and in order, and whatever befalls the card costs no more than it must."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.fake_card import ACCEPTED, BAD_CRC, BLOCK, WRITE_ERROR, Wire
from core.log_desk import (
    LOST_US_MAX,
    RING,
    SECOND,
    Log,
    Volume,
    ffi,
    frames_of,
    lib,
    loss,
    made_frame,
    opened,
    read,
    sealed,
    words,
)
from length import choose


@pytest.mark.parametrize("is_sdhc", [True, False])
@pytest.mark.parametrize("kind", [0x0B, 0x0C])
@pytest.mark.parametrize("entry", range(4))
@pytest.mark.parametrize("others", [0, 40, 100])
def test_the_prepared_file_is_found(is_sdhc, kind, entry, others):
    volume = Volume(kind=kind, entry=entry, others=others)
    log = Log(volume.card(is_sdhc=is_sdhc)).until("ready")
    assert log.changes == [("card_ready", "none", 1)]
    assert (log.told.card_block, log.told.card_blocks) == (1, volume.blocks)
    assert log.told.recording == 0
    assert log.told.card_faults == 0


@pytest.mark.parametrize("cluster", [1, 8, 128])
@pytest.mark.parametrize("blocks", [2, 3, 257, 1025])
def test_the_file_is_of_any_size(cluster, blocks):
    log = Log(Volume(blocks, cluster=cluster).card()).until("ready")
    assert log.told.card_blocks == blocks


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
    assert log.told.card_block == len(blocks) + 1
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
        assert log.told.recording == number + 1
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
    assert log.told.card_block == last + 1
    assert log.told.recording == 7


@settings(max_examples=60)
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
    assert log.told.card_block == last + 1
    assert log.told.recording == (last // 50 + 1 if last else 0)


def unprepared(volume: Volume) -> None:
    card = volume.card()
    log = Log(card).until("unprepared")
    assert log.changes == [("card_fault", "unprepared", 0)]
    assert not lib.logbook_open(log.book)
    log.run(2 * SECOND)
    assert log.changes == [("card_fault", "unprepared", 0)]
    assert not card.runs


@pytest.mark.parametrize(
    ("at", "value"),
    [
        (510, 0),
        (511, 0),
        (450, 0x07),
        (454, 0),  # start: in the table itself
        (457, 0xFF),  # beyond the card
        (461, 0xFF),  # longer than the card
    ],
)
def test_a_partition_table_that_makes_no_sense_is_refused(at, value):
    volume = Volume()
    table = bytearray(volume.content[0])
    table[at] = value
    volume.content[0] = bytes(table)
    unprepared(volume)


@pytest.mark.parametrize(
    ("at", "value"),
    [
        *((510, 0), (511, 0), (11, 1), (12, 4), (13, 0), (13, 3), (13, 255)),
        *((14, 0), (15, 0xFF), (16, 0), (16, 3), (17, 1), (19, 1), (22, 1)),
        *((32, 0), (35, 1), (36, 0), (39, 1), (40, 0x80), (42, 1)),
        *((44, 0), (44, 1), (46, 1), (47, 0x10)),
    ],
)
def test_a_volume_that_makes_no_sense_is_refused(at, value):
    volume = Volume()
    boot = bytearray(volume.content[volume.start])
    boot[at] = value
    volume.content[volume.start] = bytes(boot)
    unprepared(volume)


@pytest.mark.parametrize(
    ("at", "value"),
    [
        *((0, ord("Q")), (0, 0xE5), (0, 0), (11, 0x10), (11, 0x08), (11, 0x0F)),
        *((20, 1), (21, 1), (26, 0), (26, 1), (26, 2), (26, 4), (27, 1)),
        *((28, 1), (29, 0), (30, 9), (31, 0xFF)),
    ],
)
def test_an_entry_that_makes_no_sense_is_refused(at, value):
    volume = Volume()
    block = bytearray(volume.content[volume.block_of(2)])
    block[3 * 32 + at] = value
    volume.content[volume.block_of(2)] = bytes(block)
    unprepared(volume)


@pytest.mark.parametrize("link", [0, 3, 0x0FFFFFF7, 0x0FFFFFFF])
@pytest.mark.parametrize("at", [0, 1, 124, 125, 126, 198, 199])
def test_a_file_in_pieces_is_refused(at, link):
    volume = Volume()
    if at == 199 and link == 0x0FFFFFFF:
        link = 1  # its end is to be there
    volume.links[volume.first + at] = link
    volume.write_links()
    unprepared(volume)


def test_the_upper_bits_of_a_link_mean_nothing():
    volume = Volume()
    volume.links = [link | 0xA0000000 for link in volume.links]
    volume.write_links()
    Log(volume.card()).until("ready")


@pytest.mark.parametrize("link", [0, 1, 2, 0x0FFFFFF7, 0x0FFFFFFF])
def test_a_root_folder_that_leads_nowhere_is_refused(link):
    volume = Volume(others=40)
    volume.links[2] = link  # of 2: to itself, for ever
    volume.write_links()
    unprepared(volume)


@pytest.mark.parametrize(
    "changed",
    [
        *({"version": 2}, {"size": 1024}, {"card_id": 0}, {"lba": 1}),
        *({"blocks": 399}, {"blocks": 401}, {"rest": 1}),
    ],
)
def test_a_head_that_is_not_of_this_file_is_refused(changed):
    volume = Volume()
    volume.content[volume.file] = volume.head(**changed)
    unprepared(volume)
    volume.content[volume.file] = bytes(BLOCK)
    unprepared(volume)


@pytest.mark.long
@settings(max_examples=choose(everyday=40, long=200))
@given(st.data())
def test_rubbish_never_lets_it_write_beyond_the_file(data):
    volume = Volume(300, cluster=data.draw(st.sampled_from([1, 4])), others=20)
    parts = (0, volume.start, volume.start + 4, volume.block_of(2), volume.file)
    places = (
        [*range(440, 512)],
        [*range(64)],
        [*range(512)],
        [*range(512)],
        [*range(40)],
    )
    for _ in range(data.draw(st.integers(1, 4))):
        which = data.draw(st.integers(0, 4))
        block = bytearray(volume.content[parts[which]])
        block[data.draw(st.sampled_from(places[which]))] = data.draw(
            st.integers(0, 255)
        )
        volume.content[parts[which]] = bytes(block)
    card = volume.card()
    before = dict(card.content)
    log = Log(card)
    while log.state == "starting":
        log.step()
        assert log.now_us < 10 * SECOND
    if log.state == "ready":
        log.open().log(300_000).close()
    inside = range(volume.file + 1, volume.file + volume.blocks)
    changed = {at for at in card.content if card.content[at] != before.get(at)}
    assert changed <= {*inside}


@pytest.mark.parametrize("sane", range(3))
@pytest.mark.parametrize("seed", range(20))
def test_a_card_of_noise_is_refused(seed, sane):
    noise = random.Random(seed)  # noqa: S311, no secret
    volume = Volume(20)
    kept = [0, volume.start][:sane]
    card = volume.card()
    for at in range(card.size):
        if at not in kept:
            card.content[at] = noise.randbytes(BLOCK)
    log = Log(card)
    while log.state == "starting":
        log.step()
    assert log.state == "unprepared"


def test_an_empty_socket_is_told_once_and_looked_at_each_second():
    volume = Volume()
    card = volume.card()
    card.is_in = False
    log = Log(card).until("absent")
    log.run(5 * SECOND)
    assert log.changes == [("card_fault", "absent", 0)]
    card.power_up()
    log.until("ready", 1.3 * SECOND)
    assert log.changes[1:] == [("card_ready", "none", 1)]


def test_a_card_pulled_while_nothing_is_written_is_missed_and_found_again():
    volume = Volume()
    log = Log(volume.card()).until("ready")
    log.card.pull()
    log.until("absent", 1.2 * SECOND)
    log.card.power_up()
    log.until("ready", 1.3 * SECOND)
    assert [change[:2] for change in log.changes] == [
        ("card_ready", "none"),
        ("card_fault", "absent"),
        ("card_ready", "none"),
    ]


@pytest.mark.long
@pytest.mark.parametrize("seed", range(choose(everyday=10, long=40)))
def test_a_pull_at_any_exchange_ends_a_recording_and_another_begins(seed):
    volume = Volume(1000)
    log = opened(volume)
    log.card.random.seed(seed)
    at = log.wire.exchanges + 1 + seed * 7
    pulled_us = []

    def look(number: int) -> None:
        if number == at:
            log.card.pull()
            pulled_us.append(log.now_us)

    log.wire.on_exchange = look
    while log.state == "logging":
        log.log(20_000)
    assert log.state == "absent"
    assert lib.logbook_is_idle(log.book)
    kept = [frame for frame in log.put if frame[0] <= pulled_us[0]]
    assert loss(volume, kept, 1, pulled_us[0]) < LOST_US_MAX
    log.run(3 * SECOND)
    log.card.power_up()
    log.until("ready").open()
    log.put.clear()
    log.log(300_000).close()
    assert ("log_ended", "absent", 1) in log.changes
    assert log.changes[-2][0] == "log_started"
    assert frames_of(read(volume)[log.changes[-2][2]]) == log.kept


@pytest.mark.long
@pytest.mark.parametrize("is_slow", [False, True])
@pytest.mark.parametrize("seed", range(choose(everyday=10, long=50)))
def test_a_cut_at_any_moment_loses_half_a_second_at_most(seed, is_slow):
    chance = random.Random(seed)  # noqa: S311, no secret
    volume = Volume(1000)
    card = volume.card()
    card.random.seed(seed)
    if is_slow:  # now and then as long as a card may be
        card.busy_us = lambda _: 250_000.0 if chance.random() < 0.004 else 100.0
    log = Log(card).until("ready").open()
    log.log(chance.uniform(1_000, 2_000_000))
    for _ in range(chance.randrange(12)):
        log.step()
    card.cut()
    assert loss(volume, log.put, 1, log.now_us) < LOST_US_MAX
    # The next start goes on behind it, and hides none of it.
    before = read(volume).get(1, [])
    again = Log(card).until("ready").open().log(200_000).close()
    found = read(volume)
    number = 2 if before else 1
    assert frames_of(found[number]) == again.kept
    if before:
        assert found[1] == before


def test_a_slow_card_rides_on_the_ring():
    volume = Volume(2000)
    log = opened(volume)
    slow = {volume.file + number for number in range(40, 2000, 150)}
    log.card.busy_us = lambda block: 250_000.0 if block in slow else 100.0
    log.log(5 * SECOND).close()
    assert log.dropped == 0
    assert frames_of(read(volume)[1]) == log.kept
    late = [change for change in log.changes if change[1] == "late"]
    assert 1 <= len(late) <= 5
    assert all(change[0] == "card_fault" for change in late)
    assert 250 <= log.told.card_busy <= 251


def test_a_card_too_slow_for_it_drops_whole_frames():
    volume = Volume(2000)
    log = opened(volume)
    log.card.busy_us = lambda _: 30_000.0
    log.log(5 * SECOND)
    log.card.busy_us = lambda _: 100.0
    log.log(SECOND).close()
    assert log.dropped > 100
    assert frames_of(read(volume)[1]) == log.kept


@pytest.mark.parametrize("answer", [WRITE_ERROR, BAD_CRC])
@pytest.mark.parametrize("tries", [1, 2, 3])
def test_a_block_that_takes_on_a_later_try_loses_nothing(answer, tries):
    volume = Volume()
    log = opened(volume)
    log.card.refuse = lambda block, tried: (
        answer if block == volume.file + 13 and tried <= tries else ACCEPTED
    )
    log.log(SECOND).close()
    assert frames_of(read(volume)[1]) == log.kept
    assert log.told.card_faults == tries
    assert len(read(volume)[1]) == log.told.card_block - 1
    assert [change[0] for change in log.changes] == [
        *("card_ready", "log_started", "log_ended")
    ]


@pytest.mark.parametrize("worn", [{1}, {13}, {13, 14}, {5, 20, 35}, {*range(13, 21)}])
def test_worn_blocks_are_left_out_and_told(worn):
    volume = Volume()
    log = opened(volume)
    log.card.refuse = lambda block, _: (
        WRITE_ERROR if block - volume.file in worn else ACCEPTED
    )
    log.log(SECOND).close()
    blocks = read(volume)[1]
    assert frames_of(blocks) == log.kept
    assert not worn & {number for number, _, _ in blocks}
    assert [change[2] for change in log.changes if change[1] == "worn"] == sorted(worn)
    assert log.dropped == 0
    assert blocks[0][1] == 1
    assert Log(log.card).until("ready").told.card_block == log.told.card_block


def test_what_the_status_tells_after_a_run_is_written_again():
    volume = Volume()
    log = opened(volume)
    log.log(300_000)
    log.card.status.extend([0x04])
    log.log(300_000).close()
    assert frames_of(read(volume)[1]) == log.kept
    assert log.told.card_faults == 1


def test_too_many_worn_blocks_end_the_recording_until_a_later_look():
    volume = Volume()
    log = opened(volume)
    log.card.refuse = lambda block, _: (
        WRITE_ERROR if block - volume.file >= 13 else ACCEPTED
    )
    log.log(SECOND)
    assert log.state == "failed"
    assert log.changes[-2:] == [("log_ended", "worn", 1), ("card_fault", "worn", 22)]
    assert len([change for change in log.changes if change[1] == "worn"]) == 9 + 2
    log.card.refuse = lambda *_: ACCEPTED
    log.run(9 * SECOND)
    assert log.state == "failed"
    log.until("ready", 2 * SECOND).open().log(200_000).close()
    assert frames_of(read(volume)[2]) == log.kept[-len(frames_of(read(volume)[2])) :]


@pytest.mark.parametrize("last", [59, 58])
def test_a_file_whose_last_block_is_worn_is_full_without_it(last):
    volume = Volume(60)
    log = opened(volume)
    log.card.refuse = lambda block, _: (
        WRITE_ERROR if block - volume.file >= last else ACCEPTED
    )
    log.log(SECOND)
    assert log.state == "full"
    assert log.changes[-2:] == [("log_ended", "full", 1), ("card_full", "full", 60)]
    found = frames_of(read(volume)[1])
    assert found == log.kept[: len(found)]
    assert read(volume)[1][-1][0] == last - 1


def test_a_line_that_garbles_a_block_for_long_has_the_card_identified_again():
    volume = Volume()
    log = opened(volume)
    log.card.refuse = lambda block, tried: (
        BAD_CRC if block - volume.file == 13 and tried <= 5 else ACCEPTED
    )
    log.log(SECOND).close()
    assert [change[:2] for change in log.changes if change[0] == "card_fault"] == [
        ("card_fault", "rejected")
    ]
    assert frames_of(read(volume)[1]) == log.kept


def test_a_volume_that_cannot_be_read_is_a_worn_card():
    card = Volume().card()
    card.unreadable = {0}
    log = Log(card).until("failed")
    assert log.changes == [("card_fault", "worn", 0)]
    card.unreadable = set()
    log.until("ready", 12 * SECOND)


def test_a_card_that_does_not_start_is_looked_at_again():
    card = Volume().card()
    card.starting = 10**9
    log = Log(card).until("failed")
    assert log.changes == [("card_fault", "timeout", 0)]
    card.starting = 3
    log.until("ready", 12 * SECOND)


def test_a_card_that_is_found_reset_amid_a_quiet_recording_goes_on_with_it():
    volume = Volume()
    log = opened(volume).log(200_000)
    log.run(SECOND / 2)
    log.card.is_ready = False
    log.run(2 * SECOND)
    assert log.changes[-1][:2] == ("card_fault", "rejected")
    log.log(200_000).close()
    assert frames_of(read(volume)[1]) == log.kept


def test_a_card_that_is_reset_by_itself_goes_on_with_the_recording():
    volume = Volume()
    log = opened(volume).log(400_000)
    log.card.cut()
    log.log(400_000)
    log.card.is_ready = False
    log.log(400_000).close()
    assert frames_of(read(volume)[1]) == log.kept
    assert log.dropped == 0
    assert [change[0] for change in log.changes].count("card_fault") == 2


def test_a_second_of_busy_is_survived_on_the_ring():
    volume = Volume()
    log = opened(volume)
    log.card.busy_us = lambda block: (
        1_100_000.0 if block == volume.file + 9 and log.card.tried[block] == 1 else 100
    )
    log.log(3 * SECOND).close()
    assert [change[:2] for change in log.changes if change[0] == "card_fault"] == [
        ("card_fault", "timeout")
    ]
    assert log.dropped == 0
    assert frames_of(read(volume)[1]) == log.kept


def test_a_card_that_is_busy_for_ever_fails_and_is_looked_at_again():
    volume = Volume()
    log = opened(volume)
    log.card.busy_us = lambda _: 100 * SECOND
    log.log(12 * SECOND, rate_hz=50)
    assert log.state == "failed"
    assert log.changes[-1][:2] == ("card_fault", "timeout")
    assert log.changes[-2] == ("log_ended", "timeout", 1)
    log.card.power_up()
    log.card.busy_us = lambda _: 100.0
    log.until("ready", 15 * SECOND).open().log(100_000).close()


def test_another_card_in_its_place_is_begun_anew():
    volume, other = Volume(), Volume(300, card_id=77)
    other.content[other.file + 1] = other.good(1, 8)
    log = opened(volume).log(300_000)
    log.card.content = other.content
    log.card.power_up()
    while log.state == "logging":
        log.log(10_000)
    log.until("ready").open()
    log.put.clear()
    log.log(100_000).close()
    assert ("log_ended", "absent", 1) in log.changes
    assert [*read(other)] == [8, 9]
    assert frames_of(read(other)[9]) == log.kept
    assert [*read(volume)] == [1]


def test_a_full_file_ends_the_recording_with_a_whole_frame():
    volume = Volume(60)
    log = opened(volume).log(SECOND)
    assert log.state == "full"
    assert log.changes[-2:] == [("log_ended", "full", 1), ("card_full", "full", 60)]
    blocks = read(volume)[1]
    assert len(blocks) == 59
    assert blocks[-1][1] == 2
    found = frames_of(blocks)
    assert found == log.kept[: len(found)]
    assert blocks[-1][2].rstrip(b"\0").endswith(b".")
    assert not log.keep(made_frame(1))
    log.run(3 * SECOND)
    assert log.state == "full"
    again = Log(log.card).until("full")
    assert again.changes == [("card_full", "full", 60)]
    assert not lib.logbook_open(again.book)
    assert again.told.recording == 1


def test_a_read_only_card_is_refused():
    card = Volume().card()
    card.csd = card.csd[:14] + b"\x10" + card.csd[15:]
    log = Log(card).until("failed")
    assert log.changes == [("card_fault", "rejected", 0)]


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


@pytest.mark.parametrize("at", range(0, 400, 23))
def test_a_cut_at_any_exchange_of_the_search_is_harmless(at):
    volume = Volume(100)
    for number in range(1, 30):
        volume.content[volume.file + number] = volume.good(number)
    before = dict(volume.content)
    log = Log(volume.card())
    log.wire.on_exchange = lambda n: log.card.cut() if n == at else None
    log.until("ready", 15 * SECOND)
    assert log.told.card_block == 30
    assert volume.content == before
