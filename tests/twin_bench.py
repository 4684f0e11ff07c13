# SPDX-License-Identifier: MIT
"""The firmware's own C as a probe, and its messages for a twin."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from hypothesis import strategies as st

from core import desk
from core.desk import lib
from core.probe_bench import MPU9250, Bench, Memory, command_frame
from core.scenes import scene, tumble
from imud.stages.twin import Twin
from imud.stages.twin_outcomes import TwinDiffers, TwinOutcome
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message, decode, encode
from imud.wire.params import digest_of, words_of
from sessions import received

PERIOD_US = 5000
SAMPLES = scene(tumble(8, 200, seed=4), 200, seed=4).samples(MPU9250)
POSE, BOTH = lib.STREAM_POSE, lib.STREAM_POSE | lib.STREAM_RAW


class Life(Bench):
    """A probe whose time goes by in samples, and the contents of all it says."""

    def __init__(self, memory: Memory | None = None) -> None:
        self.contents: list[bytes] = []
        self.at = 0
        self.token = 0
        super().__init__(memory)

    def _send(self, data: Any, length: int) -> bool:
        self.contents += FrameDecoder().feed(bytes(data[0:length]))
        return True

    def wake(self) -> Life:
        self.find_sensor()
        return self

    def live(self, count: int, **flags: bool) -> Life:
        for _ in range(count):
            row = SAMPLES[self.at % len(SAMPLES)].copy()
            for name, is_so in flags.items():
                row[name] = is_so
            self.at += 1
            self.now_us += PERIOD_US
            self.sample(row)
            lib.probe_step(self.c, False, self.time_us)
        return self

    def miss(self, count: int) -> Life:
        """Samples that the probe is too late for; the next one says so."""
        self.now_us += count * PERIOD_US
        lib.probe_overrun(self.c, count, self.time_us)
        return self.live(1, has_gap=True)

    def faint(self, count: int) -> Life:
        """The bus fails and the sensor is set up again."""
        self.fail()
        self.now_us += count * PERIOD_US
        self.find_sensor()
        return self.live(1, has_gap=True)

    def order(self, command: int, first: int = 0, second: int = 0) -> Life:
        self.token += 1
        self.receive(command_frame(command, self.token, first, second))
        return self

    def load(self, records: bytes, *, goes_on: bool = False) -> Life:
        """Puts these params in force by commands, while samples continue; so does the
        filter, if it is told so.
        """
        for at, word in words_of(records):
            self._insist(lib.COMMAND_PARAMS_WRITE, at, word)
        digest = digest_of(records)
        digest -= (digest >> 31) << 32
        length = len(records) + (lib.PARAMS_GOES_ON if goes_on else 0)
        self._insist(lib.COMMAND_PARAMS_APPLY, length, digest)
        return self

    def _insist(self, command: int, first: int, second: int) -> None:
        """Sends a command until the probe is no longer busy."""
        for _ in range(1000):
            self.order(command, first, second)
            result = message_of(self.contents[-1]).fields["result"]
            if result != "busy":
                break
            self.live(1)
        assert result == "ok"


def followed(memory: Memory | None = None, *, raw_hz: int = 200) -> Life:
    """A probe that streams both from its boot."""
    life = Life(memory).order(lib.COMMAND_FIELDS, BOTH)
    return life.order(lib.COMMAND_RATE, 1, raw_hz).order(lib.COMMAND_START).wake()


def run_twin(contents: Iterable[bytes]) -> tuple[Twin, list[TwinOutcome]]:
    """A twin's outcomes for the events of a session."""
    twin = Twin()
    outcomes = [
        outcome
        for event in received(contents)
        if (outcome := twin.on_message(event.message, event.content, event.params))
        is not None
    ]
    return twin, outcomes


def named(contents: list[bytes], name: str) -> list[int]:
    """Where messages of that name, or events, are."""
    found = []
    for at, content in enumerate(contents):
        message = decode(content)
        assert isinstance(message, Message)
        if name in (message.name, message.fields.get("event")):
            found.append(at)
    return found


def changed(content: bytes, **fields: Any) -> bytes:
    message = decode(content)
    return encode(
        message.name,
        dict(message.fields) | fields,
        message.sequence,
        message.time_us,
    )


def without(contents: list[bytes], *gone: int) -> list[bytes]:
    return [content for at, content in enumerate(contents) if at not in gone]


def message_of(content: bytes) -> Message:
    message = decode(content)
    assert isinstance(message, Message)
    return message


def assert_no_difference(contents: Iterable[bytes]) -> None:
    twin, outcomes = run_twin(contents)
    assert not any(isinstance(outcome, TwinDiffers) for outcome in outcomes)
    assert twin.differed == 0


@st.composite
def losses(draw: st.DrawFn, count: int) -> desk.Array:
    """Which of so many messages come: some are lost at random, others in a row."""
    share = draw(st.sampled_from([0.002, 0.01, 0.05, 0.3]))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kept: desk.Array = random.random(count) >= share
    begun = draw(st.integers(0, count))
    kept[begun : begun + draw(st.integers(0, 8))] = False
    return kept
