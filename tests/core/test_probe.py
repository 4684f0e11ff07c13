# SPDX-License-Identifier: MIT
"""The whole probe, with a port and a memory of the test's own: samples, button and
command frames go in, and what it sends is read back by the C's own decoders."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core import desk
from core.desk import ffi, lib
from core.scenes import at_rest, scene, tumble
from protocol import wire

SAMPLE_US = 5000
STEP_US = 5000  # as main.c calls probe_step()
SECOND_US = 1_000_000
NAMES = {number: name for name, number in wire.IDS.items()}
OK, UNKNOWN, BAD, NOT_READY = (
    lib.RESULT_OK,
    lib.RESULT_UNKNOWN_COMMAND,
    lib.RESULT_BAD_ARGUMENT,
    lib.RESULT_NOT_READY,
)
MPU9250 = desk.identity_of(who_am_i=[0x71, 0x48], mag_adjust=[170, 180, 160])
REST = scene(at_rest(30), 200, seed=1).samples(MPU9250)


@dataclass(frozen=True)
class Message:
    name: str
    sequence: int
    time_us: int
    fields: dict[str, Any]


def callbacks(struct: str, **functions: Callable[..., Any]) -> dict[str, Any]:
    """Python functions as the function pointers that a struct's fields are."""
    kinds = {name: field.type for name, field in ffi.typeof(struct).fields}
    return {name: ffi.callback(kinds[name], made) for name, made in functions.items()}


def message_of(decoder: wire.Decoder, data: bytes) -> Message:
    found = decoder.feed(data)
    assert len(found) == 1, "a send is one whole frame"
    assert isinstance(found[0], bytes), found[0]
    name = NAMES[found[0][0]]
    result, (_, sequence, time_us), fields = wire.decode_message(name, found[0])
    assert result == "ok"
    return Message(name, sequence, time_us, fields)


class Card:
    """A log of the probe's, and all it was given to keep."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self.has_room = True
        self._decoder = wire.Decoder(lib.SCHEMA_SEED)
        self._callbacks = callbacks("struct outlet", put=self._put)
        self.c = ffi.new("struct probe_log *", {"outlet": self._callbacks})

    def _put(self, data: Any, length: int) -> bool:
        if self.has_room:
            self.messages.append(message_of(self._decoder, bytes(data[0:length])))
        return self.has_room

    def of(self, name: str) -> list[Message]:
        return [message for message in self.messages if message.name == name]


class Memory:
    """An EEPROM that is ready again two questions after a write."""

    def __init__(self) -> None:
        self.cells = bytearray(b"\xff" * 2 * lib.SETTINGS_SLOT)
        self.is_broken = False
        self._busy = 0
        self._callbacks = callbacks(
            "struct settings_storage",
            read=self._read,
            write=self._write,
            is_ready=self._is_ready,
        )
        self.c = ffi.new("struct settings_storage *", self._callbacks)

    def settle(self) -> None:
        """A write that has begun ends by itself while a probe reboots."""
        self._busy = 0

    def _read(self, _: Any, offset: int) -> int:
        assert self._busy == 0, "read while a write goes on"
        return self.cells[offset]

    def _write(self, _: Any, offset: int, value: int) -> None:
        assert self._busy == 0, "written while a write goes on"
        self._busy = 2
        if not self.is_broken:
            self.cells[offset] = value

    def _is_ready(self, _: Any) -> bool:
        self._busy = max(0, self._busy - 1)
        return self._busy == 0


class Bench:
    """A probe on a desk, its clock, and all it has sent."""

    def __init__(
        self,
        memory: Memory | None = None,
        *,
        start_us: int = 0,
        entropy: int = 1,
        unique_id: bytes | None = None,
        reset_cause: int = lib.RESET_CAUSE_POWER_ON,
        reset_address: int = 0,
        card: Card | None = None,
        equipment: dict[str, int] | None = None,
    ) -> None:
        self.memory = memory or Memory()
        self.memory.settle()
        self.now_us = start_us
        self.messages: list[Message] = []
        self.has_room = True
        self.refused = 0
        self.is_down = False
        self.samples_ready = 0
        self.supply_mv = 0
        self.samples = iter(REST)
        self._random = np.random.default_rng(entropy)
        self._decoder = wire.Decoder(lib.SCHEMA_SEED)
        self._callbacks = callbacks(
            "struct probe_port",
            describe=self._describe,
            measure=self._measure,
            entropy=self._entropy,
            unique_id=self._unique_id,
        )
        self._put = callbacks("struct outlet", put=self._send)
        self.wire = ffi.new("struct outlet *", self._put)
        port = {**self._callbacks, "wire": self.wire, "storage": self.memory.c}
        self.port = ffi.new("struct probe_port *", port)
        self.unique_id = unique_id
        self.reset_cause, self.reset_address = reset_cause, reset_address
        self.c = ffi.new("struct probe *")
        ffi.memmove(self.c, b"\xa5" * ffi.sizeof(self.c[0]), ffi.sizeof(self.c[0]))
        lib.probe_begin(self.c, self.port, self.time_us)
        if card is not None or equipment is not None:
            self._equipment = equipment
            self._described = callbacks("struct probe", equipment=self._equip)
            lib.probe_equip(
                self.c,
                ffi.NULL if card is None else card.c,
                ffi.NULL if equipment is None else self._described["equipment"],
            )

    def _send(self, data: Any, length: int) -> bool:
        if not self.has_room:
            self.refused += 1
            return False
        self.messages.append(message_of(self._decoder, bytes(data[0:length])))
        return True

    def _describe(self, hello: Any) -> None:
        hello.board = lib.BOARD_NANO
        hello.firmware = b"0.1.0+unreleased-build"[:16]
        hello.reset_cause = self.reset_cause
        hello.reset_address = self.reset_address

    def _measure(self, status: Any) -> None:
        status.samples_ready = self.samples_ready
        status.stack_free = 777
        status.supply = self.supply_mv

    def _equip(self, out: Any) -> None:
        for name, value in self._equipment.items():
            setattr(out, name, value)

    def _unique_id(self, out: Any) -> bool:
        if self.unique_id is not None:
            ffi.memmove(out, self.unique_id, 8)
        return self.unique_id is not None

    def _entropy(self) -> int:
        return int(self._random.integers(0, 1024))

    @property
    def time_us(self) -> int:
        return self.now_us % 2**32

    @property
    def state(self) -> int:
        return int(lib.probe_state(self.c))

    def of(self, name: str) -> list[Message]:
        return [message for message in self.messages if message.name == name]

    def events(self) -> list[tuple[int, int, int]]:
        return [tuple(message.fields.values()) for message in self.of("event")]

    def find_sensor(self, identity: Any = MPU9250) -> Bench:
        self._identity = identity  # the probe keeps the pointer
        lib.probe_sensor_ready(self.c, identity, self.time_us)
        return self

    def fail(self, *, is_over: bool = True) -> None:
        lib.probe_sensor_failed(
            self.c, lib.EVENT_BUS_FAULT, lib.CAUSE_NACK, 3, is_over, self.time_us
        )

    def sample(self, row: Any = None) -> None:
        """One sample, stamped with the time it is."""
        sample = ffi.new("struct sample *")
        ffi.buffer(sample)[:] = (next(self.samples) if row is None else row).tobytes()
        sample.time_us = self.time_us
        self.samples_ready += 1
        lib.probe_sample(self.c, sample)

    def step(self, elapsed_us: int = STEP_US) -> None:
        self.now_us += elapsed_us
        lib.probe_step(self.c, self.is_down, self.time_us)

    def run(self, seconds: float, *, samples: bool = True) -> Bench:
        for _ in range(round(seconds * SECOND_US / STEP_US)):
            self.step()
            if samples:
                self.sample()
        return self

    def hold(self, is_down: bool, milliseconds: int) -> None:
        self.is_down = is_down
        for _ in range(milliseconds):
            self.step(1000)

    def click(self) -> None:
        self.hold(True, 80)
        self.hold(False, 80)

    def receive(self, data: Iterable[int]) -> None:
        for byte in data:
            lib.probe_receive(self.c, byte, self.time_us)

    def command(
        self, command: int, first: int = 0, second: int = 0, token: int | None = None
    ) -> tuple[int, list[int]]:
        """Send a command; the reply's result and values."""
        self._token = getattr(self, "_token", 0) + 1
        sent = self._token if token is None else token
        self.receive(command_frame(command, sent, first, second))
        reply = self.messages[-1]
        assert reply.name == "reply"
        assert reply.fields["replied_command"] == command
        assert reply.fields["replied_token"] == sent
        return reply.fields["result"], reply.fields["value"]


def command_frame(command: int, token: int, first: int = 0, second: int = 0) -> bytes:
    fields = {"command": command, "token": token, "arguments": [first, second]}
    content = wire.encode_message("command", fields, 0, 0)
    return wire.encode_frame(lib.SCHEMA_SEED, content)


def streaming(seconds: float = 0.0) -> Bench:
    """A calibrated probe that streams poses."""
    bench = Bench().find_sensor().run(3)
    assert bench.state == lib.STATE_IDLE
    assert bench.command(lib.COMMAND_START)[0] == OK
    return bench.run(seconds)


def poses_of(samples: desk.Array, kind: int = lib.FILTER_FUSE) -> desk.Array:
    """A pose a sample of a tracker that begins with them."""
    tracker = ffi.new("struct pose_tracker *")
    assert lib.pose_begin(tracker, desk.UNCALIBRATED, MPU9250, kind)
    poses = np.zeros(len(samples), desk.dtype_of("struct message_pose"))
    results = np.zeros(len(samples), np.int32)
    desk.call(lib.loop_pose, tracker, len(samples), samples, poses, results)
    return poses


def sequences_of(bench: Bench) -> list[int]:
    return [message.sequence for message in bench.messages]


# Hello and status.


def test_the_first_message_is_a_hello_that_tells_board_and_build():
    bench = Bench(reset_cause=lib.RESET_CAUSE_BROWN_OUT, start_us=1234)
    hello = bench.messages[0]
    assert (hello.name, hello.sequence, hello.time_us) == ("hello", 0, 1234)
    fields = hello.fields
    assert fields["protocol_version"] == lib.PROTOCOL_VERSION
    assert fields["schema_fingerprint"] == lib.SCHEMA_FINGERPRINT
    assert fields["firmware"] == "0.1.0+unreleased-build"[:16]
    assert fields["board"] == lib.BOARD_NANO
    assert fields["reset_cause"] == lib.RESET_CAUSE_BROWN_OUT
    assert fields["boot_count"] == 1
    assert (fields["pose_rate"], fields["raw_rate"]) == (100, 200)
    assert (fields["sensor"], fields["sample_rate"]) == (lib.SENSOR_NONE, 0)


def test_a_hello_is_read_under_any_schema_and_a_status_is_not():
    bench = Bench()
    other = wire.Decoder(lib.SCHEMA_SEED ^ 0x1234)
    found: list[Any] = []

    def send(data: Any, length: int) -> bool:
        found.extend(other.feed(bytes(data[0:length])))
        return True

    replaced = callbacks("struct outlet", put=send)
    bench.wire.put = replaced["put"]
    bench.run(1.2, samples=False)
    assert [item if isinstance(item, str) else NAMES[item[0]] for item in found] == [
        "hello",
        "bad_crc",
    ]


def test_a_found_sensor_is_told_at_once_with_its_units():
    bench = Bench().find_sensor()
    assert [message.name for message in bench.messages] == ["hello", "event", "hello"]
    fields = bench.messages[-1].fields
    assert fields["sensor"] == lib.SENSOR_MPU9250
    assert (fields["who_am_i"], fields["mag_adjust"]) == ([0x71, 0x48], [170, 180, 160])
    assert fields["sample_rate"] == 200
    assert fields["acc_lsb"] == MPU9250.acc_lsb_nm_s2
    assert fields["gyr_lsb"] == MPU9250.gyr_lsb_nrad_s
    assert fields["mag_lsb"] == MPU9250.mag_lsb_pt


@pytest.mark.parametrize("start_us", [0, 2**32 - 4_300_000])
def test_hello_and_status_come_each_second_half_a_second_apart(start_us):
    bench = Bench(start_us=start_us).run(10, samples=False)
    statuses = bench.of("status")
    hellos = bench.of("hello")[1:]
    assert len(statuses) == len(hellos) == 10
    for second, (hello, status) in enumerate(zip(hellos, statuses, strict=True)):
        begun = start_us + second * SECOND_US
        assert hello.time_us == (begun + SECOND_US // 2) % 2**32
        assert status.time_us == (begun + SECOND_US) % 2**32
        assert status.fields["uptime"] == second + 1


def test_hello_and_status_follow_a_sample_without_a_field_where_they_can():
    # While every other sample has a field and a pose, and with them more work.
    bench = streaming(5)
    heavy = {pose.time_us for pose in bench.of("pose")}
    begun = 3 * SECOND_US
    for name in ("hello", "status"):
        times = [m.time_us for m in bench.of(name) if m.time_us > begun]
        assert len(times) == 5
        assert not {time_us - STEP_US for time_us in times} & heavy
        assert all(time_us % (SECOND_US // 2) <= STEP_US for time_us in times)


def stuck_in_work(bench: Bench) -> None:
    """From here on every sample has a field and a pose."""
    bench.command(lib.COMMAND_RATE, 0, 200)
    bench.samples = (row for row in REST if row["has_mag"])
    bench.run(4.2)


def stopped_in_work(bench: Bench) -> None:
    """The last sample of the stream is one with a field and a pose."""
    bench.run(SAMPLE_US / SECOND_US)
    if not bench.c.is_heavy:
        bench.run(SAMPLE_US / SECOND_US)
    assert bench.c.is_heavy
    bench.command(lib.COMMAND_RATE, 0, 200)
    bench.command(lib.COMMAND_STOP)
    bench.run(4.2)


def failed_in_work(bench: Bench) -> None:
    """The same, and no sample comes after it."""
    bench.run(SAMPLE_US / SECOND_US)
    if not bench.c.is_heavy:
        bench.run(SAMPLE_US / SECOND_US)
    assert bench.c.is_heavy
    bench.command(lib.COMMAND_RATE, 0, 200)
    bench.fail()
    bench.run(4.2, samples=False)


@pytest.mark.parametrize("situation", [stuck_in_work, stopped_in_work, failed_in_work])
def test_nothing_waits_for_an_easy_sample_that_never_comes(situation):
    bench = streaming(1)
    begun = bench.time_us
    situation(bench)
    for name in ("hello", "status"):
        times = [m.time_us for m in bench.of(name) if m.time_us > begun]
        assert len(times) == 4
        assert all(time_us % (SECOND_US // 2) <= 11 * STEP_US for time_us in times)
    # A write is begun every 55 ms at the latest, and a save takes 200 of them at most.
    bench.run(11, samples=False)
    again = Bench(bench.memory).of("hello")[0].fields
    assert again["pose_rate"] == 200


def test_seconds_that_nobody_stepped_through_are_made_up():
    bench = Bench().run(0.3, samples=False)
    bench.step(3_200_000)
    bench.run(1, samples=False)
    assert [m.fields["uptime"] for m in bench.of("status")] == [1, 2, 3, 4]


def test_a_status_counts_what_has_happened():
    bench = Bench()
    bench.supply_mv = 4987
    bench.find_sensor().run(0.5)
    bench.samples_ready += 2
    lib.probe_overrun(bench.c, 2, bench.time_us)
    for cycles in (40_000, 52_000, 46_001):
        lib.probe_worked(bench.c, cycles)
    bench.run(0.5)
    before = len(bench.messages) - 1
    fields = bench.of("status")[0].fields
    assert fields["state"] == lib.STATE_CALIBRATING
    # The status of a step comes before the step's sample.
    assert (fields["samples_read"], fields["samples_fused"]) == (199, 199)
    assert (fields["samples_ready"], fields["overruns"]) == (201, 2)
    assert fields["messages_sent"] == before + 1
    assert fields["messages_dropped"] == 0
    assert (fields["cycles_mean"], fields["cycles_worst"]) == (46_000, 52_000)
    assert (fields["stack_free"], fields["supply"]) == (777, 4987)
    assert (lib.EVENT_OVERRUN, lib.CAUSE_LATE, 2) in bench.events()
    # The load is of one second alone.
    bench.run(1)
    fields = bench.of("status")[1].fields
    assert (fields["cycles_mean"], fields["cycles_worst"]) == (0, 0)
    assert fields["messages_sent"] == bench.messages.index(bench.of("status")[1]) + 1


# Sequence numbers.


def test_sequence_numbers_have_no_hole_whatever_is_sent():
    bench = streaming(1)
    bench.command(lib.COMMAND_FIELDS, lib.STREAM_POSE | lib.STREAM_RAW)
    bench.run(1)
    bench.click()
    bench.fail()
    bench.find_sensor()
    bench.command(99)
    bench.run(1)
    assert sequences_of(bench) == list(range(len(bench.messages)))
    assert len(bench.messages) > 400
    assert {message.name for message in bench.messages} == {
        *("hello", "status", "event", "reply", "raw", "pose")
    }


def test_a_refused_send_leaves_exactly_one_hole_and_is_counted():
    bench = streaming(0.5)
    for stretch in (1, 3, 40):
        before = bench.refused
        bench.has_room = False
        while bench.refused < before + stretch:
            bench.run(SAMPLE_US / SECOND_US)
        bench.has_room = True
        bench.run(0.1)
    bench.run(1)
    sequences = sequences_of(bench)
    holes = [after - before - 1 for before, after in pairwise(sequences)]
    assert [hole for hole in holes if hole] == [1, 3, 40]
    status = bench.of("status")[-1]
    assert status.fields["messages_dropped"] == bench.refused == 44
    assert status.fields["messages_sent"] + bench.refused == status.sequence + 1


# States, calibration, faults.


def test_a_probe_calibrates_idles_and_streams():
    bench = Bench()
    assert bench.state == lib.STATE_CALIBRATING
    bench.find_sensor().run(2.5)
    assert bench.state == lib.STATE_CALIBRATING
    bench.run(0.06)
    assert bench.state == lib.STATE_IDLE
    assert bench.events()[-1] == (lib.EVENT_CALIBRATION_DONE, lib.CAUSE_NONE, 512)
    assert not bench.of("pose")
    bench.command(lib.COMMAND_START)
    assert bench.state == lib.STATE_STREAMING
    bench.run(1)
    assert bench.of("status")[-1].fields["state"] == lib.STATE_STREAMING
    bench.command(lib.COMMAND_STOP)
    assert bench.state == lib.STATE_IDLE


def test_a_probe_may_stream_before_it_is_calibrated_and_its_poses_say_so():
    bench = Bench().find_sensor()
    bench.command(lib.COMMAND_START)
    bench.run(3)
    flags = [
        pose.fields["pose_flags"] & lib.POSE_UNCALIBRATED for pose in bench.of("pose")
    ]
    assert all(flags[:255])
    assert not any(flags[256:])


def test_a_calibration_refused_for_motion_is_told_once_in_5_seconds():
    bench = Bench().find_sensor()
    moving = REST.copy()
    moving["gyr"][::2, 1] += 100
    bench.samples = iter(moving)
    bench.run(12)
    refusals = [
        message
        for message in bench.of("event")
        if message.fields["event"] == lib.EVENT_CALIBRATION_REFUSED
    ]
    assert all(refusal.fields["cause"] == lib.CAUSE_MOTION for refusal in refusals)
    # The span in counts: of the motion, and a little noise.
    assert all(90 < refusal.fields["detail"] < 115 for refusal in refusals)
    times = [refusal.time_us for refusal in refusals]
    assert len(times) == 3
    assert all(5_000_000 <= b - a <= 5_020_000 for a, b in pairwise(times))
    assert bench.state == lib.STATE_CALIBRATING
    bench.samples = iter(REST)
    bench.run(2.6)
    assert bench.state == lib.STATE_IDLE


def test_a_fault_ends_the_stream_until_the_sensor_is_back():
    bench = streaming(1)
    bench.fail()
    assert bench.events()[-1] == (lib.EVENT_BUS_FAULT, lib.CAUSE_NACK, 3)
    assert bench.state == lib.STATE_FAULT
    bench.run(1.1, samples=False)
    fields = bench.of("status")[-1].fields
    assert (fields["state"], fields["bus_faults"], fields["bus_recoveries"]) == (
        lib.STATE_FAULT,
        1,
        0,
    )
    bench.find_sensor()
    assert bench.events()[-1] == (lib.EVENT_BUS_RECOVERED, lib.CAUSE_NONE, 1)
    assert bench.messages[-1].name == "hello"
    assert bench.state == lib.STATE_STREAMING
    poses = len(bench.of("pose"))
    bench.run(1)
    assert len(bench.of("pose")) == poses + 100
    assert bench.of("status")[-1].fields["bus_recoveries"] == 1


def test_a_sample_lost_on_the_bus_is_told_and_nothing_else():
    bench = streaming(1)
    bench.fail(is_over=False)
    assert bench.state == lib.STATE_STREAMING
    assert bench.events()[-1] == (lib.EVENT_BUS_FAULT, lib.CAUSE_NACK, 3)
    bench.run(1)
    fields = bench.of("status")[-1].fields
    assert (fields["bus_faults"], fields["bus_recoveries"]) == (1, 0)


def test_a_sensor_that_is_not_found_at_first_is_a_fault_and_a_recovery():
    bench = Bench()
    bench.fail()
    assert bench.state == lib.STATE_FAULT
    bench.run(1, samples=False)
    bench.find_sensor()
    assert bench.events()[-1] == (lib.EVENT_BUS_RECOVERED, lib.CAUSE_NONE, 1)
    bench.run(3)
    assert bench.state == lib.STATE_IDLE


def test_a_calibration_outlives_a_fault():
    bench = streaming(0)
    bench.fail()
    bench.find_sensor()
    bench.command(lib.COMMAND_STOP)
    assert bench.state == lib.STATE_IDLE


# The button.

BOUNCES = {
    "clean": [],
    "one": [1],
    "many": [1, 1, 2, 1, 3, 2, 5, 1, 1, 4],
    "long": [20, 30, 40, 45],
    "hundreds": [1] * 201,
}


def bounce(bench: Bench, is_down: bool, spells_ms: list[int]) -> None:
    """Changes to a level through spells that begin with it and alternate."""
    level = is_down
    for spell in spells_ms:
        bench.hold(level, spell)
        level = not level
    bench.hold(is_down, 120)


@pytest.mark.parametrize("pressing", BOUNCES.values(), ids=BOUNCES)
@pytest.mark.parametrize("releasing", BOUNCES.values(), ids=BOUNCES)
def test_a_click_toggles_the_stream_once_however_it_bounces(pressing, releasing):
    bench = Bench().find_sensor().run(3)
    told = len(bench.events())
    for event in (lib.EVENT_STREAM_STARTED, lib.EVENT_STREAM_STOPPED):
        bounce(bench, True, pressing)
        bounce(bench, False, releasing)
        assert bench.events()[told:] == [
            (lib.EVENT_BUTTON_PRESSED, lib.CAUSE_BUTTON, 0),
            (lib.EVENT_BUTTON_RELEASED, lib.CAUSE_BUTTON, 0),
            (event, lib.CAUSE_BUTTON, 0),
        ]
        told += 3
    assert bench.state == lib.STATE_IDLE


def test_a_button_that_is_only_touched_does_nothing():
    bench = Bench().find_sensor().run(3)
    told = len(bench.events())
    for _ in range(20):
        bench.hold(True, 49)
        bench.hold(False, 60)
    assert len(bench.events()) == told


def test_button_and_commands_stop_what_the_other_started():
    bench = Bench().find_sensor().run(3)
    bench.click()
    assert bench.command(lib.COMMAND_STOP) == (OK, [0, 0])
    bench.command(lib.COMMAND_START)
    bench.click()
    streams = [
        (event, cause)
        for event, cause, _ in bench.events()
        if event in (lib.EVENT_STREAM_STARTED, lib.EVENT_STREAM_STOPPED)
    ]
    assert streams == [
        (lib.EVENT_STREAM_STARTED, lib.CAUSE_BUTTON),
        (lib.EVENT_STREAM_STOPPED, lib.CAUSE_COMMAND),
        (lib.EVENT_STREAM_STARTED, lib.CAUSE_COMMAND),
        (lib.EVENT_STREAM_STOPPED, lib.CAUSE_BUTTON),
    ]


# Commands.


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
    said, now_us = len(bench.messages), bench.time_us
    assert bench.command(lib.COMMAND_TIME, 3, 4) == (OK, [3, 4])
    assert len(bench.messages) == said + 1
    assert bench.messages[-1].time_us == now_us


@pytest.mark.parametrize("command", [0, 10, 99, 255])
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


# The stream.


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


# Settings.


def test_rates_and_fields_outlive_a_reboot_and_boots_are_counted():
    memory = Memory()
    bench = Bench(memory).run(3, samples=False)
    identity = bench.of("hello")[0].fields["probe_id"]
    bench.command(lib.COMMAND_RATE, 0, 33)
    bench.command(lib.COMMAND_RATE, 1, 44)
    bench.command(lib.COMMAND_FIELDS, lib.STREAM_RAW)
    bench.run(4, samples=False)
    for boots in (2, 3, 4):
        bench = Bench(memory, entropy=boots)
        fields = bench.of("hello")[0].fields
        assert (fields["pose_rate"], fields["raw_rate"]) == (33, 44)
        assert fields["boot_count"] == boots
        assert fields["probe_id"] == identity
        bench.find_sensor()
        bench.command(lib.COMMAND_START)
        bench.run(4)
        assert len(bench.of("raw")) == 4 * 44
        assert not bench.of("pose")


def test_the_first_boot_alone_tells_that_the_defaults_were_taken():
    memory = Memory()
    restored = (lib.EVENT_SETTINGS_RESTORED, lib.CAUSE_BOOT, lib.SETTINGS_NONE)
    assert Bench(memory).run(4, samples=False).events() == [restored]
    assert Bench(memory).run(4, samples=False).events() == []


def test_a_memory_that_keeps_nothing_is_told_and_the_probe_works_on():
    memory = Memory()
    memory.is_broken = True
    bench = Bench(memory).find_sensor().run(4)
    events = [event for event, *_ in bench.events()]
    assert events.count(lib.EVENT_SETTINGS_FAILED) == 1
    assert bench.state == lib.STATE_IDLE
    assert bench.command(lib.COMMAND_RATE, 0, 20) == (OK, [0, 20])
    bench.run(4)
    events = [event for event, *_ in bench.events()]
    assert events.count(lib.EVENT_SETTINGS_FAILED) == 2


def test_an_id_is_made_of_chance_where_the_silicon_has_none():
    made = {bytes(Bench(entropy=chance).c.settings.probe_id) for chance in range(50)}
    assert len(made) == 50


def test_an_id_is_not_all_zeros_even_where_chance_makes_it_so():
    # Sixteen readings a word: fifteen zeros, then the one that makes its CRC zero.
    readings = [0] * 60
    for word in range(1, 5):
        crc = wire.crc(word, b"\0" * 30)
        readings.append(
            next(r for r in range(2**16) if not wire.crc(crc, r.to_bytes(2, "little")))
        )

    class Unlucky(Bench):
        def _entropy(self) -> int:
            return readings.pop(0)

    assert any(Unlucky().c.settings.probe_id)
    assert not readings


def test_an_id_of_the_silicon_is_taken_as_it_is_and_kept():
    memory = Memory()
    bench = Bench(memory, unique_id=b"\x01\x23\x45\x67\x89\xab\xcd\xef")
    assert bytes(bench.c.settings.probe_id).hex() == "0123456789abcdef"
    bench.run(4, samples=False)
    again = Bench(memory)
    assert bytes(again.c.settings.probe_id).hex() == "0123456789abcdef"


# The light.


def light(bench: Bench) -> list[tuple[bool, int]]:
    """Levels and how many milliseconds each stands, over 2 s from a whole 2 s on."""
    runs: list[tuple[bool, int]] = []
    for millisecond in range(2000):
        level = bool(lib.probe_led(bench.c, 10_000_000 + 1000 * millisecond))
        if runs and runs[-1][0] == level:
            runs[-1] = (level, runs[-1][1] + 1)
        else:
            runs.append((level, 1))
    return runs


def test_the_light_shows_each_state():
    bench = Bench()
    assert light(bench) == [(True, 100), (False, 100)] * 10
    bench.find_sensor().run(3)
    assert light(bench) == [(True, 50), (False, 1950)]
    bench.command(lib.COMMAND_START)
    assert light(bench) == [(True, 2000)]
    bench.fail()
    twice = [(True, 80), (False, 120), (True, 80), (False, 720)]
    assert light(bench) == twice * 2
    bench.find_sensor()
    assert light(bench) == [(True, 2000)]


# What a board has beside its sensor, and the log that it keeps.


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
    told = bench.of("equipment")
    assert [message.time_us // SECOND_US for message in told] == [0, 1, 2, 3, 4, 5]
    assert all(250_000 <= message.time_us % SECOND_US < 320_000 for message in told)
    fields = told[0].fields
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
    told = bench.of("equipment")[-1].fields
    assert told["messages_unlogged"] == hole
    assert told["messages_logged"] == card.of("equipment")[-1].sequence - hole
    assert len(bench.of("pose")) == sent + 400  # the wire has not noticed


def test_a_host_that_comes_gets_a_hello():
    bench = Bench(equipment={})
    lib.probe_say_hello(bench.c, bench.time_us)
    assert [m.name for m in bench.messages].count("hello") == 2


def test_what_a_board_tells_is_an_event():
    bench, card = logging(0.1)
    lib.probe_tell(bench.c, lib.EVENT_CARD_FAULT, lib.CAUSE_WORN, 4711, bench.time_us)
    told = (lib.EVENT_CARD_FAULT, lib.CAUSE_WORN, 4711)
    assert bench.events()[-1] == told
    assert tuple(card.of("event")[-1].fields.values()) == told


def test_a_board_can_stop_the_stream_and_says_why():
    bench = streaming(0.5)
    lib.probe_set_streaming(bench.c, False, lib.CAUSE_BATTERY, bench.time_us)
    lib.probe_set_streaming(bench.c, False, lib.CAUSE_BATTERY, bench.time_us)
    assert bench.events()[-1] == (lib.EVENT_STREAM_STOPPED, lib.CAUSE_BATTERY, 0)
    assert bench.events()[-2][0] == lib.EVENT_STREAM_STARTED
    poses = len(bench.of("pose"))
    bench.run(0.5)
    assert len(bench.of("pose")) == poses
