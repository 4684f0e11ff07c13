# SPDX-License-Identifier: MIT
"""Recordings on cards that are pulled, cut, slow, worn, full or reset."""

from __future__ import annotations

import random

import pytest

from core.fake_card import ACCEPTED, BAD_CRC, WRITE_ERROR, ZEROS
from core.log_desk import (
    LOST_US_MAX,
    SECOND,
    Log,
    Volume,
    frames_of,
    lib,
    loss,
    opened,
    read,
)
from length import choose

pytestmark = pytest.mark.sampled(2)


def test_an_empty_socket_is_told_once_and_looked_at_each_second():
    volume = Volume()
    card = volume.card()
    card.is_in = False
    log = Log(card).until("absent")
    log.run(5 * SECOND)
    assert log.changes == [("card_fault", "absent", 0)]
    card.power_up()
    log.until("starting", 1.1 * SECOND).until("ready", SECOND / 2)
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
@pytest.mark.parametrize("seed", range(choose(everyday=4, long=40)))
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
@pytest.mark.parametrize("seed", range(choose(everyday=4, long=50)))
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
    # The next start continues behind it, and hides none of it.
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
    assert 250 <= log.status.card_busy <= 251


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
    assert log.status.card_faults == tries
    assert len(read(volume)[1]) == log.status.card_block - 1
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
    assert Log(log.card).until("ready").status.card_block == log.status.card_block


def test_what_the_status_tells_after_a_run_is_written_again():
    volume = Volume()
    log = opened(volume)
    log.log(300_000)
    log.card.status.extend([0x04])
    log.log(300_000).close()
    assert frames_of(read(volume)[1]) == log.kept
    assert log.status.card_faults == 1


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


def test_a_read_only_card_is_refused():
    card = Volume().card()
    card.csd = card.csd[:14] + b"\x10" + card.csd[15:]
    log = Log(card).until("failed")
    assert log.changes == [("card_fault", "rejected", 0)]


@pytest.mark.parametrize("at", range(0, 400, 23))
def test_a_cut_at_any_exchange_of_the_search_is_harmless(at):
    volume = Volume(100)
    for number in range(1, 30):
        volume.content[volume.file + number] = volume.good(number)
    before = dict(volume.content)
    log = Log(volume.card())
    log.wire.on_exchange = lambda n: log.card.cut() if n == at else None
    log.until("ready", 15 * SECOND)
    assert log.status.card_block == 30
    assert volume.content == before


class Counterfeit(dict[int, bytes]):
    """The memory of a card that says yes to all; it works up to block `end`."""

    def __init__(self, kind: str, end: int, content: dict[int, bytes]) -> None:
        super().__init__(content)
        self.kind, self.end = kind, end
        self.latest = (-1, ZEROS)

    def update(self, blocks: list[tuple[int, bytes]]) -> None:  # type: ignore[override]
        for block, data in blocks:
            if block < self.end:
                self[block] = data
            elif self.kind == "wraps":
                self[block % self.end] = data
            elif self.kind == "has one more":
                self.latest = block, data
            elif self.kind == "spoils bits":
                self[block] = bytes([data[0], data[1] ^ 4, *data[2:]])
            elif self.kind == "old":
                self.setdefault(block, data)

    def get(self, block: int, default: bytes = ZEROS) -> bytes:  # type: ignore[override]
        if block >= self.end and self.kind == "wraps":
            return super().get(block % self.end, default)
        if self.kind == "has one more" and block == self.latest[0]:
            return self.latest[1]
        return super().get(block, default)


@pytest.mark.parametrize("start", [1, 100])
@pytest.mark.parametrize(
    "kind", ["keeps nothing", "has one more", "spoils bits", "old", "wraps"]
)
def test_a_counterfeit_is_told_within_two_seconds_and_keeps_what_was_good(kind, start):
    volume = Volume(1000)
    log = opened(volume)
    end = volume.file + start
    for block in range(end, end + 300):  # of another life of this card
        volume.content[block] = volume.good(block - volume.file, 9)
    log.card.content = memory = Counterfeit(kind, end, volume.content)
    while log.status.card_block < start:
        log.log(10_000)
        assert log.state == "logging"
    crossed_us = log.now_us
    while log.state == "logging":
        log.log(10_000)
        assert log.now_us < crossed_us + 1.3 * SECOND
    assert log.state == "failed"
    assert ("log_ended", "worn", 1) in log.changes
    assert log.changes[-1][:2] == ("card_fault", "worn")
    volume.content = dict(memory)
    kept = frames_of(read(volume).get(1, [])[: start - 1])
    assert kept == log.kept[: len(kept)]
    assert len(kept) >= sum(at < crossed_us - LOST_US_MAX for at, _ in log.put)
