# SPDX-License-Identifier: MIT
"""When to log, when to sleep, and what the probe hears of clock, radio, card and
battery, over a board of the test's own."""

from __future__ import annotations

import pytest

from core.desk import lib
from core.equipment_desk import BATTERY_MV, TURN_US, Asleep, Board, recordings
from core.log_desk import SECOND, Volume
from core.probe_bench import SECOND_US

LAST_WORDS_US = 1_500_000
LAST_WORDS_US_MAX = 5_000_000
LOG_EVENTS = (lib.EVENT_LOG_STARTED, lib.EVENT_LOG_ENDED)


def recording(volume: Volume) -> Board:
    """A probe that streams, and keeps it on the card."""
    board = Board(volume.card()).until(lib.EVENT_CARD_READY)
    return board.set_streaming(True).until(lib.EVENT_LOG_STARTED)


def test_a_crystal_that_does_not_start_is_told_once() -> None:
    board = Board(is_spare=True).run(0.1)
    assert board.events_of(lib.EVENT_CLOCK_FAILED) == [
        (lib.EVENT_CLOCK_FAILED, lib.CAUSE_CRYSTAL, 0)
    ]


def test_a_crystal_that_stops_later_is_told_once_and_as_such() -> None:
    board = Board().run(0.1)
    assert not board.events_of(lib.EVENT_CLOCK_FAILED)
    board.is_spare = True
    board.run(0.1)
    assert board.events_of(lib.EVENT_CLOCK_FAILED) == [
        (lib.EVENT_CLOCK_FAILED, lib.CAUSE_CRYSTAL, 1)
    ]


@pytest.mark.parametrize(
    ("is_spare", "clock"), [(False, "CLOCK_CRYSTAL"), (True, "CLOCK_SPARE")]
)
def test_the_message_has_what_the_board_says(is_spare: bool, clock: str) -> None:
    board = Board(Volume().card(), is_spare=is_spare)
    board.power = lib.POWER_EXTERNAL | lib.POWER_CHARGING
    board.radio, board.resets = lib.RADIO_CONNECTED, 3
    board.run(1.5)
    fields = board.bench.of("equipment")[-1].fields
    assert fields["clock"] == getattr(lib, clock)
    assert fields["battery"] == BATTERY_MV
    assert fields["power"] == lib.POWER_EXTERNAL | lib.POWER_CHARGING
    assert (fields["radio"], fields["radio_resets"]) == (lib.RADIO_CONNECTED, 3)
    assert fields["card"] == lib.CARD_READY


def test_whoever_connects_hears_who_it_is_then_that_it_is_connected() -> None:
    board = Board().run(0.1)
    board.bench.messages.clear()
    board.radio_events = [lib.RN41_LINKED]
    board.turn()
    assert [message.name for message in board.bench.messages] == ["hello", "event"]
    assert board.bench.events() == [(lib.EVENT_RADIO_CONNECTED, lib.CAUSE_NONE, 0)]


@pytest.mark.parametrize("start_us", [0, 2**32 - SECOND_US])
def test_a_link_that_dropped_says_for_how_long_when_it_is_back(start_us: int) -> None:
    board = Board(start_us=start_us)
    board.radio_events = [lib.RN41_LINKED]
    board.run(0.5)
    board.radio_events = [lib.RN41_DROPPED]
    board.run(1.234)
    board.radio_events = [lib.RN41_LINKED]
    board.run(0.5)
    board.radio_events = [lib.RN41_LINKED]  # the drop before it has been told
    board.turn()
    assert board.events_of(lib.EVENT_RADIO_CONNECTED, lib.EVENT_RADIO_DROPPED) == [
        (lib.EVENT_RADIO_CONNECTED, lib.CAUSE_NONE, 0),
        (lib.EVENT_RADIO_DROPPED, lib.CAUSE_NONE, 0),
        (lib.EVENT_RADIO_CONNECTED, lib.CAUSE_NONE, 1234),
        (lib.EVENT_RADIO_CONNECTED, lib.CAUSE_NONE, 0),
    ]


def test_a_radio_that_is_given_up_is_told_with_its_cause() -> None:
    board = Board()
    board.radio_cause = lib.CAUSE_REJECTED
    board.radio_events = [lib.RN41_FAULT]
    board.turn()
    assert board.bench.events()[-1] == (lib.EVENT_RADIO_FAULT, lib.CAUSE_REJECTED, 0)


def test_a_recording_is_as_long_as_the_stream() -> None:
    volume = Volume()
    board = Board(volume.card()).until(lib.EVENT_CARD_READY).run(0.5)
    assert board.is_done
    board.set_streaming(True).until(lib.EVENT_LOG_STARTED).run(1)
    assert not board.is_done
    board.set_streaming(False).turn()
    assert not board.c.log.is_on
    assert not board.is_done  # what was put in is still being written
    board.until(lib.EVENT_LOG_ENDED)
    assert board.is_done
    assert board.events_of(*LOG_EVENTS) == [
        (lib.EVENT_LOG_STARTED, lib.CAUSE_NONE, 1),
        (lib.EVENT_LOG_ENDED, lib.CAUSE_NONE, 1),
    ]
    kept = recordings(volume)[1]
    assert kept[0].name == "hello"
    assert [message.sequence for message in kept] == [*range(len(kept))]
    assert len([message for message in kept if message.name == "raw"]) >= 200


def test_the_next_stream_is_the_next_recording() -> None:
    volume = Volume()
    board = recording(volume).set_streaming(False).until(lib.EVENT_LOG_ENDED)
    board.set_streaming(True).until(lib.EVENT_LOG_STARTED).run(0.1)
    board.set_streaming(False).until(lib.EVENT_LOG_ENDED)
    found = recordings(volume)
    assert [*found] == [1, 2]
    assert found[2][0].name == "hello"


def test_the_log_asks_for_the_next_turn_while_it_has_more_to_do() -> None:
    assert recording(Volume()).run(0.5).turns_in_a_row > 0


def test_without_a_card_nothing_is_kept() -> None:
    board = Board().set_streaming(True).run(2)
    assert board.events_of(lib.EVENT_CARD_FAULT) == [
        (lib.EVENT_CARD_FAULT, lib.CAUSE_ABSENT, 0)
    ]
    assert not board.events_of(*LOG_EVENTS)
    assert board.is_done


def test_a_card_that_comes_and_goes_during_a_stream_is_recorded_on() -> None:
    volume = Volume(1000)
    board = Board(volume.card())
    board.card.is_in = False
    board.set_streaming(True).until(lib.EVENT_CARD_FAULT)
    board.card.power_up()
    board.until(lib.EVENT_LOG_STARTED).run(0.5)
    board.card.pull()
    board.until(lib.EVENT_LOG_ENDED)
    assert not board.c.log.is_on
    assert board.is_done
    assert board.bench.c.is_streaming
    board.card.power_up()
    board.until(lib.EVENT_LOG_STARTED).run(0.3)
    board.set_streaming(False).until(lib.EVENT_LOG_ENDED)
    assert board.events_of(*LOG_EVENTS) == [
        (lib.EVENT_LOG_STARTED, lib.CAUSE_NONE, 1),
        (lib.EVENT_LOG_ENDED, lib.CAUSE_ABSENT, 1),
        (lib.EVENT_LOG_STARTED, lib.CAUSE_NONE, 2),
        (lib.EVENT_LOG_ENDED, lib.CAUSE_NONE, 2),
    ]
    assert recordings(volume)[2][0].name == "hello"


def test_a_card_that_is_full_ends_the_recording_and_not_the_stream() -> None:
    volume = Volume(40)
    board = recording(volume).until(lib.EVENT_CARD_FULL)
    assert not board.c.log.is_on
    assert board.bench.events()[-2:] == [
        (lib.EVENT_LOG_ENDED, lib.CAUSE_FULL, 1),
        (lib.EVENT_CARD_FULL, lib.CAUSE_FULL, 40),
    ]
    board.run(1)
    assert board.bench.c.is_streaming
    assert board.is_done
    assert [*recordings(volume)] == [1]


def test_a_restart_waits_for_the_end_of_the_recording() -> None:
    volume = Volume()
    board = recording(volume).run(0.3)
    board.bench.c.wants_reset = True
    assert not board.is_done
    board.until(lib.EVENT_LOG_ENDED)
    assert board.is_done
    assert board.bench.c.is_streaming
    board.run(0.5)  # no recording begins
    assert board.events_of(*LOG_EVENTS)[-1] == (lib.EVENT_LOG_ENDED, lib.CAUSE_NONE, 1)
    assert len(recordings(volume)[1]) > 60


def test_a_low_battery_ends_stream_and_log_and_the_probe_sleeps() -> None:
    volume = Volume()
    board = recording(volume).run(0.5)
    board.bench.messages.clear()
    low_us = board.tell_low()
    slept_us = board.until_asleep()
    assert board.bench.events() == [
        (lib.EVENT_BATTERY_LOW, lib.CAUSE_BATTERY, BATTERY_MV),
        (lib.EVENT_STREAM_STOPPED, lib.CAUSE_BATTERY, 0),
        (lib.EVENT_LOG_ENDED, lib.CAUSE_BATTERY, 1),
        (lib.EVENT_GOING_TO_SLEEP, lib.CAUSE_BATTERY, BATTERY_MV),
    ]
    assert LAST_WORDS_US <= slept_us - low_us < LAST_WORDS_US + 3 * TURN_US
    assert board.is_done
    assert [message.fields["event"] for message in recordings(volume)[1][-2:]] == [
        lib.EVENT_BATTERY_LOW,
        lib.EVENT_STREAM_STOPPED,
    ]


def test_nothing_that_starts_on_the_way_to_sleep_goes_on() -> None:
    board = Board().run(0.1)
    board.tell_low()
    board.run(0.5).set_streaming(True).turn()
    assert not board.bench.c.is_streaming
    assert board.bench.events()[-1] == (
        *(lib.EVENT_STREAM_STOPPED, lib.CAUSE_BATTERY, 0),
    )


def test_it_sleeps_when_the_wire_has_sent_its_last_words() -> None:
    board = Board()
    board.is_sent = False
    board.tell_low()
    board.until(lib.EVENT_GOING_TO_SLEEP).run(1)
    board.is_sent = True
    with pytest.raises(Asleep):
        board.turn()


def test_a_wire_that_is_held_does_not_keep_it_awake() -> None:
    board = Board()
    board.is_sent = False
    low_us = board.tell_low()
    late_us = board.until_asleep() - low_us
    assert LAST_WORDS_US_MAX <= late_us < LAST_WORDS_US_MAX + 2 * TURN_US
    announced_us = board.last_us(lib.EVENT_GOING_TO_SLEEP) - low_us
    assert LAST_WORDS_US <= announced_us < LAST_WORDS_US + 2 * TURN_US


def test_a_card_that_gets_stuck_is_given_up_before_it_sleeps() -> None:
    board = recording(Volume()).run(0.5)
    board.card.busy_us = lambda _: 100.0 * SECOND
    low_us = board.tell_low()
    slept_us = board.until_asleep()
    assert board.events_of(lib.EVENT_LOG_ENDED)
    assert board.last_us(lib.EVENT_LOG_ENDED) <= slept_us < low_us + LAST_WORDS_US_MAX


def test_a_card_that_needs_too_long_does_not_keep_it_awake() -> None:
    board = recording(Volume()).run(0.5)
    board.card.busy_us = lambda _: 0.9 * SECOND
    board.run(0.7)
    low_us = board.tell_low()
    late_us = board.until_asleep() - low_us
    assert LAST_WORDS_US_MAX < late_us < LAST_WORDS_US_MAX + 3 * TURN_US
    assert board.last_us(lib.EVENT_GOING_TO_SLEEP) - low_us >= LAST_WORDS_US_MAX
    assert not board.events_of(lib.EVENT_LOG_ENDED)


def test_a_charger_that_comes_in_time_keeps_it_awake_until_the_next_time() -> None:
    board = Board()
    board.is_sent = False
    board.tell_low()
    board.until(lib.EVENT_GOING_TO_SLEEP)
    board.power = lib.POWER_EXTERNAL
    board.is_sent = True
    board.set_streaming(True).run(LAST_WORDS_US_MAX / SECOND_US)
    assert board.bench.c.is_streaming
    board.power = 0
    low_us = board.tell_low()
    slept_us = board.until_asleep()
    assert LAST_WORDS_US <= slept_us - low_us < LAST_WORDS_US + 3 * TURN_US
    assert len(board.events_of(lib.EVENT_GOING_TO_SLEEP)) == 2


def test_a_stream_after_the_charger_came_ends_its_log_as_any_other() -> None:
    volume = Volume()
    board = Board(volume.card()).until(lib.EVENT_CARD_READY)
    board.tell_low()
    board.run(0.2)
    board.power = lib.POWER_EXTERNAL
    board.turn()
    board.set_streaming(True).until(lib.EVENT_LOG_STARTED).run(0.2)
    board.set_streaming(False).until(lib.EVENT_LOG_ENDED)
    assert board.bench.events()[-1] == (lib.EVENT_LOG_ENDED, lib.CAUSE_NONE, 1)
