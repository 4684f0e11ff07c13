# SPDX-License-Identifier: MIT
"""Params of a probe: told, changed by commands, in force in its poses and its ways."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from core import desk
from core.desk import ffi, lib
from core.params_desk import FULL, GYR, MAG, SMALL, digest, options, sensor, signed
from core.probe_bench import (
    BAD,
    MPU9250,
    OK,
    REST,
    Bench,
    Card,
    Memory,
    sequences_of,
    streaming,
)
from core.scenes import at_rest, scene, tumble

ACC = sensor(lib.PARAMS_ACC, 8_000_000, 16384 - 300)
BUSY = lib.RESULT_BUSY


def go(bench: Bench, seconds: float) -> Bench:
    """Time passes, with samples if there is a sensor."""
    return bench.run(seconds, samples=bench.c.identity != ffi.NULL)


def stage(bench: Bench, records: bytes) -> None:
    for at in range(0, len(records), 4):
        word = records[at : at + 4].ljust(4, b"\0")
        value = int.from_bytes(word, "little", signed=True)
        for _ in range(100):
            result, _ = bench.command(lib.COMMAND_PARAMS_WRITE, at, value)
            if result != BUSY:
                break
            go(bench, 0.01)
        assert result == OK
    go(bench, 0.1)


def apply(bench: Bench, records: bytes, more: int = 0) -> tuple[int, list[int]]:
    """`more` is added to the length."""
    for _ in range(500):
        result, value = bench.command(
            lib.COMMAND_PARAMS_APPLY, len(records) + more, signed(digest(records))
        )
        if result != BUSY:
            return result, value
        go(bench, 0.01)
    raise AssertionError("busy without end")


def change(bench: Bench, records: bytes, more: int = 0) -> None:
    stage(bench, records)
    assert apply(bench, records, more)[0] == OK


def sets_in(messages: list) -> dict[int, bytes]:
    """The sets that were told whole, by their digests."""
    parts: dict[int, dict[int, bytes]] = {}
    lengths = {}
    for message in messages:
        fields = message.fields
        lengths[fields["set_digest"]] = fields["set_length"]
        parts.setdefault(fields["set_digest"], {})[fields["part_offset"]] = bytes(
            fields["part"]
        )
    whole = {}
    for key, found in parts.items():
        records = b"".join(found[at] for at in sorted(found))[: lengths[key]]
        if len(records) == lengths[key]:
            whole[key] = records
    return whole


def test_a_new_probe_tells_at_boot_that_it_has_none():
    bench = Bench().run(0.6, samples=False)
    assert bench.of("hello")[0].fields["params_digest"] == 0
    (params,) = bench.of("params")
    assert bytes(params.fields.pop("part")) == bytes(lib.PARAMS_PART)
    assert params.fields == {"set_digest": 0, "set_length": 0, "part_offset": 0}


def test_a_change_is_told_whole_before_its_event_and_in_the_hello_after_it():
    bench = streaming(0.5)
    stage(bench, FULL)
    start = len(bench.messages)
    assert apply(bench, FULL)[0] == OK
    new = [message for message in bench.messages[start:] if message.name != "pose"]
    names = [message.name for message in new]
    events = [message for message in new if message.name == "event"]
    first = new.index(events[0])
    before = [message for message in new[:first] if message.name == "params"]
    assert sets_in(before)[digest(FULL)] == FULL
    assert [tuple(event.fields.values()) for event in events] == [
        (lib.EVENT_PARAMS_CHANGED, lib.CAUSE_COMMAND, signed(digest(FULL))),
        (lib.EVENT_RESTARTED, lib.CAUSE_COMMAND, lib.FILTER_FUSE),
    ]
    hello = new[names.index("hello", first)]
    assert hello.fields["params_digest"] == digest(FULL)
    assert sequences_of(bench) == list(range(len(bench.messages)))


def test_params_survive_a_boot_and_are_told_again():
    bench = Bench()
    change(bench, FULL)
    after = Bench(bench.memory).find_sensor().run(1)
    assert after.of("hello")[0].fields["params_digest"] == digest(FULL)
    assert sets_in(after.of("params")) == {digest(FULL): FULL}
    assert after.c.params.calibration.acc.bias[0] == 12345
    assert lib.EVENT_PARAMS_LOST not in [event for event, _, _ in after.events()]


def test_all_parts_come_in_time_to_who_only_listens():
    bench = Bench()
    change(bench, FULL)
    go(bench, 1)
    start = len(bench.messages)
    seconds = len(FULL) // lib.PARAMS_PART + 1
    bench.run(seconds, samples=False)
    heard = bench.messages[start:]
    parts = [message for message in heard if message.name == "params"]
    assert sets_in(parts)[digest(FULL)] == FULL
    assert len(parts) == seconds  # one a hello


def test_all_parts_come_on_request():
    bench = Bench()
    change(bench, FULL)
    go(bench, 2)
    start = len(bench.messages)
    assert bench.command(lib.COMMAND_PARAMS_TELL)[0] == OK
    bench.run(0.2, samples=False)
    parts = [m for m in bench.messages[start:] if m.name == "params"]
    assert sets_in(parts)[digest(FULL)] == FULL


def test_a_card_begins_with_all_parts():
    card = Card()
    bench = Bench(card=card)
    change(bench, FULL)
    go(bench, 1)
    lib.probe_log(bench.c, True, bench.time_us)
    bench.run(0.3, samples=False)
    assert card.messages[0].name == "hello"
    assert sets_in(card.of("params")) == {digest(FULL): FULL}


def test_without_a_change_of_calibration_the_filter_goes_on():
    bench = streaming(1)
    change(bench, SMALL)
    names = [event for event, _, _ in bench.events()]
    assert lib.EVENT_PARAMS_CHANGED in names
    assert lib.EVENT_RESTARTED not in names
    flags = bench.run(0.1).of("pose")[-1].fields["pose_flags"]
    assert not flags & lib.POSE_UNCALIBRATED
    change(bench, SMALL + MAG)
    bench.run(0.1)
    assert bench.of("pose")[-1].fields["pose_flags"] & lib.POSE_UNCALIBRATED
    assert bench.of("pose")[-1].fields["pose_flags"] & lib.POSE_STARTING


def turned() -> Bench:
    """A probe that streams poses, still, far from the attitude that it began in."""
    way = tumble(12, 200, seed=4)
    felt = scene(np.concatenate([way, at_rest(30, 200, way[-1])]), 200, seed=1)
    bench = Bench().find_sensor()
    bench.samples = iter(felt.samples(MPU9250))
    assert bench.command(lib.COMMAND_START)[0] == OK
    assert bench.command(lib.COMMAND_RATE, 0, 200)[0] == OK
    return bench.run(15)


def changed_by(bench: Bench, more: int) -> tuple[list[tuple], float, int]:
    """The events of a change of calibration, each with the name of the next message in
    front; the turn that the change makes, degrees; and the flags of the poses after it.
    """
    stage(bench, ACC + GYR + MAG)
    start = len(bench.messages)
    assert apply(bench, ACC + GYR + MAG, more)[0] == OK
    bench.run(0.05)
    new = bench.messages[start:]
    events = [at for at, message in enumerate(new) if message.name == "event"]
    poses = [
        [message.fields for message in part if message.name == "pose"]
        for part in (new[: events[0]], new[events[0] :])
    ]
    last, first = (np.array(part["q"]) for part in (poses[0][-1], poses[1][0]))
    flags = np.bitwise_or.reduce([pose["pose_flags"] for pose in poses[1]])
    reported = [(new[at + 1].name, *new[at].fields.values()) for at in events]
    return reported, float(desk.apart_deg(last, first)), int(flags)


def test_a_filter_goes_on_with_another_calibration_of_the_same_axes():
    bench = turned()
    digest_of = signed(digest(ACC + GYR + MAG))
    reported, turn_deg, flags = changed_by(bench, lib.PARAMS_GOES_ON)
    assert reported == [
        ("hello", lib.EVENT_PARAMS_CHANGED, lib.CAUSE_COMMAND, digest_of)
    ]
    assert bench.of("hello")[-1].fields["params_digest"] == digest(ACC + GYR + MAG)
    assert bench.c.params.calibration.acc.bias[0] == 8_000_000
    assert turn_deg < 1
    assert not flags & (lib.POSE_STARTING | lib.POSE_UNCALIBRATED)


def test_a_change_without_256_beside_its_length_begins_anew():
    reported, turn_deg, flags = changed_by(turned(), 0)
    assert [names[:2] for names in reported] == [
        ("event", lib.EVENT_PARAMS_CHANGED),
        ("hello", lib.EVENT_RESTARTED),
    ]
    assert turn_deg > 20
    assert flags & lib.POSE_STARTING
    assert flags & lib.POSE_UNCALIBRATED


def test_a_filter_that_went_on_begins_anew_with_the_next_change():
    bench = turned()
    change(bench, ACC, lib.PARAMS_GOES_ON)
    change(bench, ACC + GYR)
    assert [event for event, _, _ in bench.events()][-1] == lib.EVENT_RESTARTED


def test_poses_are_those_of_the_calibration_in_force():
    records = ACC + GYR + MAG
    bench = Bench()
    change(bench, records)
    bench = Bench(bench.memory).find_sensor()
    bench.command(lib.COMMAND_START)
    bench.command(lib.COMMAND_RATE, 0, 200)
    bench.run(4)
    calibration = ffi.addressof(bench.c.params.calibration)
    tracker = ffi.new("struct pose_tracker *")
    assert lib.pose_begin(tracker, calibration, MPU9250, lib.FILTER_FUSE)
    count = len(bench.of("pose"))
    expected = []
    for number, row in enumerate(REST[:count]):
        sample = ffi.new("struct sample *")
        ffi.buffer(sample)[:] = row.tobytes()
        sample.time_us = bench.of("pose")[number].time_us
        lib.pose_step(tracker, sample)
        pose = ffi.new("struct message_pose *")
        lib.pose_read(tracker, pose)
        expected.append(list(pose.q))
    assert [message.fields["q"] for message in bench.of("pose")] == expected


@pytest.mark.parametrize("where", ["boot", "sensor", "stream"])
def test_a_refused_change_says_why_and_disturbs_nothing(where):
    bench = Bench() if where == "boot" else Bench().find_sensor()
    if where == "stream":
        bench = streaming(0.5)
    wrong = ACC + options(7, 7)
    stage(bench, wrong)
    events = bench.events()
    result, value = apply(bench, wrong)
    assert result == lib.RESULT_REFUSED
    assert value == [lib.PARAMS_OPTIONS, lib.PARAMS_OUT_OF_RANGE]
    assert bench.events() == events
    go(bench, 1)
    assert bench.of("hello")[-1].fields["params_digest"] == 0
    assert bench.command(lib.COMMAND_PARAMS_WRITE, 2, 0)[0] == BAD


def test_lost_params_are_told_at_boot():
    bench = Bench()
    change(bench, FULL)
    content = bench.c.store.bank.content[lib.BANK_CURRENT]
    bench.memory.cells[content + 30] ^= 1
    after = Bench(bench.memory)
    assert (lib.EVENT_PARAMS_LOST, lib.CAUSE_WORN, 0) in after.events()
    assert after.of("hello")[0].fields["params_digest"] == 0


def test_a_memory_that_fails_is_told_in_the_reply():
    memory = Memory()
    bench = Bench(memory)
    go(bench, 1)
    memory.is_broken = True
    assert bench.command(lib.COMMAND_PARAMS_WRITE, 0, 0x12345678)[0] == OK
    go(bench, 1)
    assert bench.command(lib.COMMAND_PARAMS_WRITE, 4, 0)[0] == lib.RESULT_FAILED


def test_a_change_and_a_save_share_the_memory():
    bench = streaming()
    stage(bench, FULL)
    for hz in range(10, 60):
        assert bench.command(lib.COMMAND_RATE, 0, hz)[0] == OK
        if hz == 20:
            bench.command(lib.COMMAND_PARAMS_APPLY, len(FULL), signed(digest(FULL)))
        bench.run(0.02)
    bench.run(2)
    after = Bench(bench.memory)
    assert after.of("hello")[0].fields["pose_rate"] == 59
    assert after.of("hello")[0].fields["params_digest"] == digest(FULL)


# Options.


@pytest.mark.parametrize("reference", [0, 1, 2])
def test_the_start_of_a_stream_sets_the_reference_that_is_asked_for(reference):
    bench = Bench().find_sensor().run(5)
    change(bench, options(0, reference))
    bench.run(0.1)
    before = len(bench.events())
    bench.click()
    events = [event for event, _, _ in bench.events()[before:]]
    assert (lib.EVENT_TARED in events) == (reference != lib.REFERENCE_NONE)
    bench.run(0.1)
    pose = bench.of("pose")[-1].fields
    assert bool(pose["pose_flags"] & lib.POSE_TARED) == (reference != 0)
    if reference == lib.REFERENCE_FULL:
        assert pose["q"][0] > 0.9999 * 2**30


def test_a_reference_waits_for_the_first_sample():
    bench = Bench()
    change(bench, options(0, 1))
    bench.command(lib.COMMAND_START)
    assert lib.EVENT_TARED not in [event for event, _, _ in bench.events()]


def test_a_press_that_measures_nothing_is_told_and_shown_and_is_no_click():
    bench = Bench().find_sensor()
    change(bench, options(lib.BUTTON_DOES_STROKE, 0))
    for _ in range(3):  # while it calibrates, and nothing streams
        bench.is_down = True
        bench.run(0.7)
        bench.is_down = False
        bench.run(0.1)
    ends = [told.fields["end"] for told in bench.of("stroke")]
    assert ends == [lib.STROKE_END_NO_REST] * 3
    assert lib.EVENT_STREAM_STARTED not in [event for event, _, _ in bench.events()]
    light = [lib.probe_led(bench.c, ms * 1000) for ms in range(1000)]
    assert sum(a != b for a, b in itertools.pairwise(light)) in (19, 20)
    bench.run(2)
    light = [lib.probe_led(bench.c, ms * 1000) for ms in range(1000)]
    assert sum(a != b for a, b in itertools.pairwise(light)) < 12


def test_a_button_that_only_tells_leaves_the_stream_alone():
    bench = Bench().find_sensor().run(3)
    change(bench, options(lib.BUTTON_DOES_TELL, 0))
    before = len(bench.events())
    bench.click()
    assert [event for event, _, _ in bench.events()[before:]] == [
        lib.EVENT_BUTTON_PRESSED,
        lib.EVENT_BUTTON_RELEASED,
    ]
    assert bench.state == lib.STATE_IDLE
