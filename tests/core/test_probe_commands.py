# SPDX-License-Identifier: MIT
"""Commands of a host: what they do, what they are answered, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core import desk
from core.desk import lib
from core.probe_bench import (
    BAD,
    MPU9250,
    NOT_READY,
    OK,
    STEP_US,
    UNKNOWN,
    Bench,
    command_frame,
    poses_of,
    streaming,
)
from core.scenes import scene, tumble
from protocol import wire


def test_starting_twice_tells_one_event_and_two_replies():
    bench = Bench().find_sensor()
    for _ in range(2):
        assert bench.command(lib.COMMAND_START) == (OK, [0, 0])
    assert len(bench.of("reply")) == 2
    started = [
        event for event, *_ in bench.events() if event == lib.EVENT_STREAM_STARTED
    ]
    assert len(started) == 1


def test_a_rate_is_set_replied_and_told_in_the_next_hello():
    bench = streaming()
    assert bench.command(lib.COMMAND_RATE, 0, 50) == (OK, [0, 50])
    assert bench.command(lib.COMMAND_RATE, 1, 20) == (OK, [1, 20])
    bench.command(lib.COMMAND_HELLO)
    fields = bench.of("hello")[-1].fields
    assert (fields["pose_rate"], fields["raw_rate"]) == (50, 20)


@pytest.mark.parametrize(
    ("stream", "rate_hz"),
    [
        *[(stream, rate) for stream in (0, 1) for rate in (0, -1, 201, 2**31 - 1)],
        *[(stream, -(2**31)) for stream in (0, 1)],
        *[(stream, 100) for stream in (-1, 2, 2**31 - 1, -(2**31))],
        (0, 65636),  # 100 in 16 bits
    ],
)
def test_a_rate_that_is_none_is_refused_and_leaves_the_one_in_force(stream, rate_hz):
    bench = Bench().find_sensor()
    result, value = bench.command(lib.COMMAND_RATE, stream, rate_hz)
    assert result == BAD
    assert value == [stream, 200 if stream == 1 else 100]
    bench.command(lib.COMMAND_HELLO)
    fields = bench.of("hello")[-1].fields
    assert (fields["pose_rate"], fields["raw_rate"]) == (100, 200)


@pytest.mark.parametrize("rate_hz", [1, 200])
def test_the_ends_of_the_rates_are_taken(rate_hz):
    bench = Bench().find_sensor()
    assert bench.command(lib.COMMAND_RATE, 0, rate_hz) == (OK, [0, rate_hz])


def test_no_rate_above_the_sensors_own_is_taken():
    bench = Bench().find_sensor(desk.identity_of(rate_hz=120))
    assert bench.command(lib.COMMAND_RATE, 0, 120) == (OK, [0, 120])
    assert bench.command(lib.COMMAND_RATE, 0, 121) == (BAD, [0, 120])


@pytest.mark.parametrize("fields", [0, 4, -1, 2**31 - 1, -(2**31), 257])
def test_fields_that_are_none_are_refused_and_leave_those_in_force(fields):
    bench = Bench()
    assert bench.command(lib.COMMAND_FIELDS, fields) == (BAD, [lib.STREAM_POSE, 0])


@pytest.mark.parametrize(
    ("fields", "names"),
    [
        (lib.STREAM_POSE, {"pose"}),
        (lib.STREAM_RAW, {"raw"}),
        (lib.STREAM_POSE | lib.STREAM_RAW, {"pose", "raw"}),
    ],
)
def test_what_is_streamed_is_what_was_asked_for(fields, names):
    bench = streaming()
    assert bench.command(lib.COMMAND_FIELDS, fields) == (OK, [fields, 0])
    begun = len(bench.messages)
    bench.run(0.4)
    assert {m.name for m in bench.messages[begun:]} - {"hello", "status"} == names


def test_a_hello_comes_on_request():
    bench = Bench()
    assert bench.command(lib.COMMAND_HELLO) == (OK, [0, 0])
    assert [message.name for message in bench.messages[-2:]] == ["hello", "reply"]


def test_a_tare_makes_the_next_pose_the_identity_and_its_undoing_takes_it_back():
    bench = streaming()
    bench.samples = iter(scene(tumble(20, 200, 3), 200).samples(MPU9250))
    bench.run(10)
    for value, is_tared in ((0, True), (1, True), (2, False)):
        assert bench.command(lib.COMMAND_TARE, value) == (OK, [value, 0])
        assert bench.events()[-1] == (lib.EVENT_TARED, lib.CAUSE_COMMAND, value)
        bench.run(0.01)
        pose = bench.of("pose")[-1].fields
        assert bool(pose["pose_flags"] & lib.POSE_TARED) == is_tared
        if value == 0:
            q = np.array(pose["q"], float)
            assert desk.apart_deg(q, np.array([1.0, 0, 0, 0])) < 10


def test_a_tare_needs_a_sample_and_an_origin_that_exists():
    bench = Bench()
    assert bench.command(lib.COMMAND_TARE, 0)[0] == NOT_READY
    bench.find_sensor()
    assert bench.command(lib.COMMAND_TARE, 0)[0] == NOT_READY
    bench.run(0.1)
    for value in (-1, 3, 2**31 - 1, -(2**31)):
        assert bench.command(lib.COMMAND_TARE, value)[0] == BAD
    assert bench.command(lib.COMMAND_TARE, 0)[0] == OK
    assert [event for event, *_ in bench.events()].count(lib.EVENT_TARED) == 1


def test_a_restart_begins_calibration_filter_and_origin_anew_with_the_next_sample():
    bench = streaming(2)
    assert bench.command(lib.COMMAND_TARE, 0)[0] == OK
    assert bench.command(lib.COMMAND_RATE, 0, 200)[0] == OK
    assert bench.command(lib.COMMAND_RESTART) == (OK, [lib.FILTER_FUSE, 0])
    restarted = (lib.EVENT_RESTARTED, lib.CAUSE_COMMAND, lib.FILTER_FUSE)
    assert bench.events()[-1] == restarted
    told, sent = len(bench.events()), len(bench.of("pose"))
    samples = scene(tumble(8, 200, 6), 200, seed=3).samples(MPU9250)
    bench.samples = iter(samples)
    begun_us = bench.time_us
    bench.run(8)
    assert bench.events()[told:] == [
        (lib.EVENT_CALIBRATION_DONE, lib.CAUSE_NONE, lib.CALIBRATOR_SAMPLES)
    ]
    # As a probe that has only just been switched on.
    samples["time_us"] = begun_us + STEP_US * (1 + np.arange(len(samples)))
    poses = poses_of(samples)
    for name in ("q", "tilt_sigma", "heading_sigma", "pose_flags"):
        found = [pose.fields[name] for pose in bench.of("pose")[sent:]]
        assert found == poses[name].tolist()
    first = bench.of("pose")[sent].fields["pose_flags"]
    assert first & lib.POSE_STARTING
    assert first & lib.POSE_UNCALIBRATED
    assert not first & lib.POSE_TARED


@pytest.mark.parametrize("kind", range(lib.FILTER_FUSE, lib.FILTER_DCM_PI + 1))
def test_a_restart_may_choose_another_filter_which_stays(kind):
    bench = streaming(0.1)
    bench.command(lib.COMMAND_RATE, 0, 200)
    samples = scene(tumble(5, 200, 6), 200, seed=3).samples(MPU9250)
    # The second time it is the same that is not named.
    for wanted in (kind, 0):
        assert bench.command(lib.COMMAND_RESTART, wanted) == (OK, [kind, 0])
        assert bench.events()[-1] == (lib.EVENT_RESTARTED, lib.CAUSE_COMMAND, kind)
        sent = len(bench.of("pose"))
        samples["time_us"] = bench.time_us + STEP_US * (1 + np.arange(len(samples)))
        bench.samples = iter(samples)
        bench.run(5)
        found = [pose.fields["q"] for pose in bench.of("pose")[sent:]]
        assert found == poses_of(samples, kind)["q"].tolist()
        assert bench.of("hello")[-1].fields["filter"] == kind
    refused = bench.command(lib.COMMAND_RESTART, 6)
    assert refused == (BAD, [kind, 0])


def test_a_restart_makes_an_idle_probe_calibrate_again():
    bench = Bench().find_sensor().run(3)
    assert bench.state == lib.STATE_IDLE
    bench.command(lib.COMMAND_RESTART)
    assert bench.state == lib.STATE_CALIBRATING
    bench.run(3)
    assert bench.state == lib.STATE_IDLE


def test_a_restart_needs_a_sensor_and_a_filter_that_exists():
    bench = Bench()
    assert bench.of("hello")[0].fields["filter"] == lib.FILTER_FUSE
    assert bench.command(lib.COMMAND_RESTART) == (NOT_READY, [lib.FILTER_FUSE, 0])
    bench.find_sensor().run(3)
    for wanted in (-1, 6, 257, 2**31 - 1, -(2**31)):
        refused = bench.command(lib.COMMAND_RESTART, wanted)
        assert refused == (BAD, [lib.FILTER_FUSE, 0])
    assert bench.state == lib.STATE_IDLE
    assert lib.EVENT_RESTARTED not in [event for event, *_ in bench.events()]


def test_a_reset_is_replied_to_before_it_is_wanted_of_the_board():
    bench = Bench()
    assert not bench.c.wants_reset
    assert bench.command(lib.COMMAND_RESET) == (OK, [0, 0])
    assert bench.c.wants_reset


def test_the_time_has_nothing_but_its_reply_stamped_when_it_was_heard():
    bench = Bench().run(3.0, samples=False)
    count, now_us = len(bench.messages), bench.time_us
    assert bench.command(lib.COMMAND_TIME, 3, 4) == (OK, [3, 4])
    assert len(bench.messages) == count + 1
    assert bench.messages[-1].time_us == now_us


@pytest.mark.parametrize("command", [0, 13, 99, 255])
def test_a_command_that_nobody_knows_is_refused(command):
    assert Bench().command(command, 3, 4) == (UNKNOWN, [3, 4])


def test_a_command_that_comes_again_is_answered_and_not_carried_out_again():
    bench = streaming()
    first = bench.command(lib.COMMAND_STOP, token=500)
    bench.click()
    assert bench.state == lib.STATE_STREAMING
    assert bench.command(lib.COMMAND_STOP, token=500) == first
    assert bench.state == lib.STATE_STREAMING
    hellos = len(bench.of("hello"))
    for _ in range(3):
        bench.command(lib.COMMAND_HELLO, token=501)
    assert len(bench.of("hello")) == hellos + 1
    assert bench.command(lib.COMMAND_RATE, 0, 77, token=502) == (OK, [0, 77])
    assert bench.command(lib.COMMAND_RATE, 0, 77, token=502) == (OK, [0, 77])
    assert bench.command(lib.COMMAND_RATE, 0, 999, token=503) == (BAD, [0, 77])
    assert bench.command(lib.COMMAND_RATE, 0, 999, token=503) == (BAD, [0, 77])
    bench.run(1)
    # The start, and the nine above.
    assert bench.of("status")[-1].fields["commands_received"] == 10


def test_a_token_of_zero_marks_no_repetition():
    bench = Bench()
    for _ in range(3):
        bench.command(lib.COMMAND_HELLO, token=0)
    assert len(bench.of("hello")) == 1 + 3


def test_a_corrupt_command_is_counted_and_neither_carried_out_nor_answered():
    bench = Bench().find_sensor()
    good = command_frame(lib.COMMAND_START, 1)
    flips = [(at, bit) for at in range(len(good) - 1) for bit in range(8)]
    for at, bit in flips:
        bad = bytearray(good)
        bad[at] ^= 1 << bit
        bench.receive(bad)
    assert bench.state == lib.STATE_CALIBRATING
    assert not bench.of("reply")
    bench.run(1)
    fields = bench.of("status")[0].fields
    assert fields["commands_received"] == 0
    # A byte that becomes a zero cuts the frame in two.
    assert fields["commands_bad"] >= len(flips)
    assert bench.command(lib.COMMAND_START) == (OK, [0, 0])


def test_a_good_frame_that_is_no_command_is_counted_as_bad():
    bench = Bench()
    event = {"event": 1, "cause": 1, "detail": 0}
    content = wire.encode_message("event", event, 0, 0)
    short = wire.encode_message(
        "command", {"command": 1, "token": 2, "arguments": [0, 0]}, 0, 0
    )[:-1]
    for skewed in (content, short):
        bench.receive(wire.encode_frame(lib.SCHEMA_SEED, skewed))
    bench.receive(wire.encode_frame(lib.SCHEMA_SEED ^ 1, content))
    bench.run(1, samples=False)
    assert bench.of("status")[0].fields["commands_bad"] == 3
    assert not bench.of("reply")


@given(st.binary(max_size=400))
def test_noise_on_the_line_is_never_obeyed(noise):
    bench = Bench()
    sent = len(bench.messages)
    bench.receive(noise + b"\0")
    assert len(bench.messages) == sent
    assert bench.command(lib.COMMAND_HELLO)[0] == OK
