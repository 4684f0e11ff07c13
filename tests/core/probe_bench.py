# SPDX-License-Identifier: MIT
"""A probe on a desk: samples, button and command frames go in, and what it sends is
read back by the C's own decoders. Its port, memory and card are of the tests' own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from core import desk
from core.desk import ffi, lib
from core.scenes import at_rest, scene
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
        self.cells = bytearray(b"\xff" * lib.MEMORY_SIZE)
        self.is_broken = False
        self._busy = 0
        self._callbacks = callbacks(
            "struct memory",
            read=self._read,
            write=self._write,
            is_ready=self._is_ready,
        )
        self.c = ffi.new("struct memory *", self._callbacks)

    def settle(self) -> None:
        """A write that has begun completes while a probe reboots."""
        self._busy = 0

    def _read(self, _: Any, offset: int) -> int:
        assert self._busy == 0, "read during a write"
        return self.cells[offset]

    def _write(self, _: Any, offset: int, value: int) -> None:
        assert self._busy == 0, "written during a write"
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
        port = {**self._callbacks, "wire": self.wire, "memory": self.memory.c}
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
        hello.board = lib.BOARD_F405
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
            lib.commands_receive(self.c, byte, self.time_us)

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
    assert lib.pose_begin(tracker, desk.UNKNOWN, MPU9250, kind)
    poses = np.zeros(len(samples), desk.dtype_of("struct message_pose"))
    results = np.zeros(len(samples), np.int32)
    desk.call(lib.loop_pose, tracker, len(samples), samples, poses, results)
    return poses


def sequences_of(bench: Bench) -> list[int]:
    return [message.sequence for message in bench.messages]
