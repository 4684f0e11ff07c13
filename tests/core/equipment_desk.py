# SPDX-License-Identifier: MIT
"""A probe with its equipment on a desk: a card with the prepared file, and clock, radio
and battery that say what a test tells them to."""

from __future__ import annotations

from typing import Any

from core.desk import ffi, lib
from core.fake_card import FakeCard
from core.fake_spi import Wire
from core.log_desk import RING, Volume, frames_of, read
from core.probe_bench import (
    SAMPLE_US,
    SECOND_US,
    Bench,
    Message,
    callbacks,
    message_of,
)
from protocol import wire

TURN_US = 1000  # the main loop's longest sleep here
BATTERY_MV = 3700
TURNS_MAX = 20  # of the main loop without a sleep


def absent() -> FakeCard:
    card = FakeCard()
    card.is_in = False
    return card


class Asleep(Exception):
    """The board sleeps: what runs next is a start."""


class Board:
    """The port's callbacks, and the main loop of its probe."""

    def __init__(
        self, card: FakeCard | None = None, *, is_spare: bool = False, start_us: int = 0
    ) -> None:
        self.is_spare = is_spare
        self.battery_mv = BATTERY_MV
        self.power = 0
        self.radio = lib.RADIO_CABLE
        self.resets = 0
        self.radio_cause = lib.CAUSE_NONE
        self.radio_events: list[int] = []  # to come, one a turn
        self.is_getting_low = False
        self.is_sent = True
        self.sleeps: list[int] = []  # when it was put to sleep
        self.turns_in_a_row = 0
        self.bench = Bench(start_us=start_us).find_sensor()
        self.card = card or absent()
        self.card.now_us = start_us
        self.wire = Wire(ffi, self.card)
        self.ring = ffi.new("uint8_t[]", RING)
        self.book = ffi.new("struct logbook *")
        lib.logbook_init(self.book, self.wire.device, self.ring, RING)
        self.c = ffi.new("struct equipment *")
        ffi.memmove(self.c, b"\xa5" * ffi.sizeof(self.c[0]), ffi.sizeof(self.c[0]))
        self._kept = self._callbacks()
        self._port = ffi.new("struct equipment_port *", self._kept)
        lib.equipment_begin(self.c, self._port, self.bench.c, self.book)
        self._stepped_us = self.bench.now_us

    def _callbacks(self) -> dict[str, Any]:
        return callbacks(
            "struct equipment_port",
            keep=lambda frame, length: lib.logbook_put(self.book, frame, length),
            describe=lambda out: lib.equipment_describe(self.c, out),
            clock_is_spare=lambda: self.is_spare,
            battery_mv=lambda: self.battery_mv,
            power_flags=lambda: self.power,
            radio_state=lambda: self.radio,
            radio_resets=lambda: self.resets,
            power_step=self._power_step,
            radio_step=self._radio_step,
            radio_cause=lambda: self.radio_cause,
            send_is_idle=lambda: self.is_sent,
            sleep=lambda: self.sleeps.append(self.bench.now_us),
        )

    def _power_step(self, now_us: int) -> bool:
        assert now_us == self.bench.time_us
        is_low, self.is_getting_low = self.is_getting_low, False
        self.power |= lib.POWER_LOW if is_low else 0
        return is_low

    def _radio_step(self, now_us: int) -> int:
        assert now_us == self.bench.time_us
        return self.radio_events.pop(0) if self.radio_events else int(lib.RN41_NOTHING)

    def turn(self) -> None:
        """One turn of the main loop, and the sleep at its end."""
        if self.bench.now_us - self._stepped_us >= SAMPLE_US:
            self._stepped_us += SAMPLE_US
            self.bench.step(0)
            self.bench.sample()
        in_a_row = 0
        while lib.equipment_step(self.c, self.bench.time_us) and not self.sleeps:
            in_a_row += 1
            assert in_a_row < TURNS_MAX, "it never lets go"
        self.turns_in_a_row = max(self.turns_in_a_row, in_a_row)
        if self.sleeps:
            raise Asleep
        self.wire.sleep(TURN_US)
        self.bench.now_us = int(self.wire.now_us)

    def run(self, seconds: float) -> Board:
        end_us = self.bench.now_us + seconds * SECOND_US
        while self.bench.now_us < end_us:
            self.turn()
        return self

    def until(self, event: int, seconds: float = 5) -> Board:
        """Turn until an event is told, which is new."""
        seen = len(self.bench.of("event"))
        end_us = self.bench.now_us + seconds * SECOND_US
        while event not in [each[0] for each in self.bench.events()[seen:]]:
            assert self.bench.now_us < end_us, "it is not told"
            self.turn()
        return self

    def until_asleep(self, seconds: float = 10) -> int:
        """The microsecond at which it sleeps."""
        try:
            self.run(seconds)
        except Asleep:
            return self.sleeps[0]
        raise AssertionError("it is awake")

    def tell_low(self) -> int:
        """The battery becomes low, and the probe has said so: the microsecond."""
        self.is_getting_low = True
        self.until(lib.EVENT_BATTERY_LOW)
        return self.last_us(lib.EVENT_BATTERY_LOW)

    def last_us(self, event: int) -> int:
        """When an event was last told."""
        events = self.bench.of("event")
        return max(m.time_us for m in events if m.fields["event"] == event)

    def set_streaming(self, is_streaming: bool) -> Board:
        lib.probe_set_streaming(
            self.bench.c, is_streaming, lib.CAUSE_COMMAND, self.bench.time_us
        )
        return self

    @property
    def is_done(self) -> bool:
        return bool(lib.equipment_is_done(self.c))

    def events_of(self, *events: int) -> list[tuple[int, int, int]]:
        """Those of the events, in their order."""
        return [event for event in self.bench.events() if event[0] in events]


def recordings(volume: Volume) -> dict[int, list[Message]]:
    """The messages of each recording on the card."""
    decoder = wire.Decoder(lib.SCHEMA_SEED)
    return {
        number: [message_of(decoder, frame + b"\0") for frame in frames_of(blocks)]
        for number, blocks in read(volume).items()
    }
