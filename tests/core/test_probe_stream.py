# SPDX-License-Identifier: MIT
"""Raw and pose on the wire and on the card, and what else a board may have."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from core.desk import lib
from core.probe_bench import (
    MPU9250,
    OK,
    REST,
    SAMPLE_US,
    SECOND_US,
    STEP_US,
    Bench,
    Card,
    poses_of,
    streaming,
)
from core.scenes import scene, tumble

# The stream.


@pytest.mark.sampled(2)
@pytest.mark.parametrize("stream", [0, 1], ids=["pose", "raw"])
def test_every_rate_is_met_and_evenly_spaced(stream):
    bench = Bench().find_sensor()
    bench.run(0.01)
    bench.command(lib.COMMAND_FIELDS, [lib.STREAM_POSE, lib.STREAM_RAW][stream])
    bench.command(lib.COMMAND_START)
    name = ("pose", "raw")[stream]
    row = REST[:1]
    for rate_hz in range(1, 201):
        bench.command(lib.COMMAND_RATE, stream, rate_hz)
        bench.messages.clear()
        # At least three of them, and whole seconds, so that the count is exact.
        seconds = max(1, -(-3 // rate_hz))
        for _ in range(200 * seconds):
            bench.now_us += SAMPLE_US
            bench.sample(row)
        times = [message.time_us for message in bench.of(name)]
        assert len(times) == rate_hz * seconds
        steps = {(b - a) / SAMPLE_US for a, b in pairwise(times)}
        assert steps <= {200 // rate_hz, -(-200 // rate_hz)}


def test_the_instants_of_a_rate_do_not_depend_on_when_the_stream_was_started():
    times = []
    for pause in (0, 1, 2, 3):
        bench = Bench().find_sensor().run(1 + pause * SAMPLE_US / SECOND_US)
        bench.command(lib.COMMAND_START)
        bench.run(0.5)
        times.append({pose.time_us % (2 * SAMPLE_US) for pose in bench.of("pose")})
    assert times == [times[0]] * 4
    assert len(times[0]) == 1


def test_a_raw_message_holds_the_sample_as_read():
    bench = streaming()
    bench.command(lib.COMMAND_FIELDS, lib.STREAM_RAW)
    bench.messages.clear()
    row = np.zeros((), REST.dtype)
    row["acc"], row["gyr"], row["mag"] = (1, -2, 3), (-32768, 5, 32767), (7, 8, -9)
    row["temperature_cdeg"] = 2512
    flags = {
        "mag_overflow": lib.SAMPLE_MAG_OVERFLOW,
        "acc_clipped": lib.SAMPLE_ACC_CLIPPED,
        "gyr_clipped": lib.SAMPLE_GYR_CLIPPED,
        "has_gap": lib.SAMPLE_GAP,
    }
    null = -(2**15)
    for name, flag in ((None, 0), *flags.items()):
        for has_mag in (True, False):
            changed = row.copy()
            changed["has_mag"] = has_mag
            if name:
                changed[name] = True
            bench.sample(changed)
            message = bench.messages[-1]
            assert (message.name, message.time_us) == ("raw", bench.time_us)
            assert message.fields == {
                "acc": [1, -2, 3],
                "gyr": [-32768, 5, 32767],
                "mag": [7, 8, -9] if has_mag else [null] * 3,
                "temperature": 2512,
                "sample_flags": flag,
            }


def test_the_streamed_poses_are_those_of_a_tracker_fed_with_the_same_samples():
    samples = scene(tumble(12, 200, 6), 200, seed=3).samples(MPU9250)
    bench = Bench().find_sensor()
    bench.command(lib.COMMAND_RATE, 0, 200)
    bench.command(lib.COMMAND_START)
    bench.samples = iter(samples)
    bench.run(12)
    samples["time_us"] = STEP_US * (1 + np.arange(len(samples)))
    poses = poses_of(samples)
    sent = bench.of("pose")
    assert [pose.time_us for pose in sent] == samples["time_us"].tolist()
    for name in ("q", "tilt_sigma", "heading_sigma", "pose_flags"):
        assert [pose.fields[name] for pose in sent] == poses[name].tolist()


# A board's other equipment, and the log that it keeps.


def logging(
    seconds: float = 0.0, *, pose_hz: int = 50, **equipment: int
) -> tuple[Bench, Card]:
    """A calibrated probe that streams some of its poses and logs."""
    card = Card()
    bench = Bench(card=card, equipment=equipment).find_sensor().run(3)
    assert bench.command(lib.COMMAND_RATE, 0, pose_hz)[0] == OK
    assert bench.command(lib.COMMAND_START)[0] == OK
    lib.probe_log(bench.c, True, bench.time_us)
    return bench.run(seconds), card


def test_a_reset_is_told_with_its_address():
    (hello,) = Bench(reset_address=0x080021E8).of("hello")
    assert hello.fields["reset_address"] == 0x080021E8


def test_equipment_is_told_every_second_apart_from_hello_and_status():
    bench = Bench(equipment={"clock": lib.CLOCK_SPARE, "card_block": 7})
    bench.find_sensor().run(5.3)
    messages = bench.of("equipment")
    assert [message.time_us // SECOND_US for message in messages] == [0, 1, 2, 3, 4, 5]
    assert all(250_000 <= message.time_us % SECOND_US < 320_000 for message in messages)
    fields = messages[0].fields
    assert (fields["clock"], fields["card_block"]) == (lib.CLOCK_SPARE, 7)
    assert fields["battery"] == 0xFFFF  # its null


def test_a_board_without_equipment_tells_none():
    assert not Bench().find_sensor().run(3).of("equipment")


def test_nothing_is_kept_before_it_is_asked_for_and_after_it_ends():
    card = Card()
    bench = Bench(card=card, equipment={}).find_sensor().run(3)
    bench.command(lib.COMMAND_START)
    bench.run(1)
    assert not card.messages
    lib.probe_log(bench.c, True, bench.time_us)
    bench.run(1)
    lib.probe_log(bench.c, False, bench.time_us)
    count = len(card.messages)
    bench.run(1)
    assert len(card.messages) == count > 400


def test_a_log_begins_with_a_hello_and_counts_its_messages_by_itself():
    bench, card = logging(2)
    assert card.messages[0].name == "hello"
    assert card.messages[0].fields == bench.of("hello")[-1].fields
    assert [m.sequence for m in card.messages] == list(range(len(card.messages)))
    lib.probe_log(bench.c, True, bench.time_us)
    bench.run(0.1)
    assert [m.sequence for m in card.messages].count(0) == 2


def test_a_log_has_raw_and_pose_of_each_sample_whatever_the_wire_gets():
    bench, card = logging(4)
    begun = card.messages[0].time_us
    times = list(range(begun + SAMPLE_US, bench.time_us + 1, SAMPLE_US))
    assert [m.time_us for m in card.of("raw")] == times
    assert [m.time_us for m in card.of("pose")] == times
    assert not bench.of("raw")
    kept = {m.time_us: m.fields for m in card.of("pose")}
    sent = [m for m in bench.of("pose") if m.time_us > begun]
    assert len(sent) == 4 * 50
    assert all(m.fields == kept[m.time_us] for m in sent)


def test_a_log_has_the_events_and_the_messages_of_each_second():
    bench, card = logging(2.5)
    bench.command(lib.COMMAND_TARE, 0)
    bench.fail(is_over=False)
    assert [m.fields for m in card.of("event")] == [
        m.fields for m in bench.of("event")[-2:]
    ]
    for name in ("status", "equipment"):
        begun = card.messages[0].time_us
        sent = [m for m in bench.of(name) if m.time_us > begun]
        assert [m.fields for m in card.of(name)] == [m.fields for m in sent]
        assert len(sent) >= 2


def test_a_gap_is_in_one_pose_of_the_log_and_in_one_of_the_wire():
    bench, card = logging(1)
    row = next(bench.samples).copy()
    row["has_gap"] = True
    for _ in range(3):  # a quarter of the poses is sent
        bench.step()
        bench.sample(row)
        row["has_gap"] = False
    bench.run(1)
    for messages in (card.of("pose"), bench.of("pose")):
        assert sum(m.fields["pose_flags"] & lib.POSE_GAP != 0 for m in messages) == 1


def test_a_log_without_room_shows_by_its_numbers_and_its_count():
    bench, card = logging(1, pose_hz=200)
    sent = len(bench.of("pose"))
    card.has_room = False
    bench.run(0.5)
    card.has_room = True
    bench.run(1.5)
    numbers = [m.sequence for m in card.messages]
    (hole,) = [
        after - before - 1 for before, after in pairwise(numbers) if after > before + 1
    ]
    assert hole >= 200
    fields = bench.of("equipment")[-1].fields
    assert fields["messages_unlogged"] == hole
    assert fields["messages_logged"] == card.of("equipment")[-1].sequence - hole
    assert len(bench.of("pose")) == sent + 400  # the wire has not noticed


def test_a_host_that_comes_gets_a_hello():
    bench = Bench(equipment={})
    lib.probe_say_hello(bench.c, bench.time_us)
    assert [m.name for m in bench.messages].count("hello") == 2


def test_what_a_board_tells_is_an_event():
    bench, card = logging(0.1)
    lib.probe_tell(bench.c, lib.EVENT_CARD_FAULT, lib.CAUSE_WORN, 4711, bench.time_us)
    event = (lib.EVENT_CARD_FAULT, lib.CAUSE_WORN, 4711)
    assert bench.events()[-1] == event
    assert tuple(card.of("event")[-1].fields.values()) == event


def test_a_board_can_stop_the_stream_and_says_why():
    bench = streaming(0.5)
    lib.probe_set_streaming(bench.c, False, lib.CAUSE_BATTERY, bench.time_us)
    lib.probe_set_streaming(bench.c, False, lib.CAUSE_BATTERY, bench.time_us)
    assert bench.events()[-1] == (lib.EVENT_STREAM_STOPPED, lib.CAUSE_BATTERY, 0)
    assert bench.events()[-2][0] == lib.EVENT_STREAM_STARTED
    poses = len(bench.of("pose"))
    bench.run(0.5)
    assert len(bench.of("pose")) == poses
