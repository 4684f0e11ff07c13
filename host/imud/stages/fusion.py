# SPDX-License-Identifier: MIT
"""Fusion on the host: poses and strokes for a probe that sends only raw samples,
computed with the same C as a probe runs. Where the configuration has `fuse_on_host` for
it.

A probe that sends poses itself, or not every sample, is asked once for all its raw
samples instead. Poses that it sends nevertheless are published as frames alone. A
sample after a loss gets the flag `gap`, as the probe would set it.

A Nano has no room for strokes: it gets those of another board here. What its button
does is its own affair but for `tell`, by which it does nothing else: then strokes last
as long as it is held, unless its table of gestures has another use for that.

Samples of other rates than the C's are brought to one of those (`resampled`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import msgspec

from imud import _core
from imud.config.settings import BUTTON, Config
from imud.params.learned import filter_can_continue
from imud.params.value import Params
from imud.probes.session import ProbeFound, Received
from imud.stages import COMPUTED, InjectMessage, LogLine, SendCommands, StageResult
from imud.stages.floats import is_in_floats
from imud.stages.resampled import Resampler
from imud.wire import schema
from imud.wire.messages import Message, place_of
from imud.wire.raws import Rows

FAILED = "can't compute its poses"
FAILURE = f"{FAILED}: its raw samples are not available"

# Poses a second of a probe that sends none itself.
POSE_HZ = 100

_BOARD = place_of("hello", "board")
_FILTER = place_of("hello", "filter")
_RATE = place_of("hello", "sample_rate")
_FLAGS = place_of("raw", "sample_flags")


@lru_cache(maxsize=64)  # asked with every sample
def with_strokes(records: bytes) -> bytes:
    """The params of a Nano whose strokes are computed here."""
    params = Params.decode(records)
    options = msgspec.structs.asdict(params.options)
    if options["button_does"] != "tell":
        return records
    return params.replaced("options", options | {"button_does": "stroke"}).encode()


class FusionStage:
    """The filter of one probe, or none where the configuration has it off."""

    name = "fusion"

    def __init__(self, config: Config) -> None:
        self.configure(config)
        self._poses = 0
        self._forget()

    def _forget(self) -> None:
        self._hello: Message | None = None  # the last one that knows a sensor
        self._content = b""  # the same, with a filter and strokes
        self._is_nano = False
        self._rate_hz = 0  # of its raw samples
        self._resampler: Resampler | None = None
        self._replay: _core.Replay | None = None
        self.replaced: frozenset[str] = frozenset()
        self._own_us: int | None = None  # of its own last pose that was published
        self._records: bytes | None = None  # of the params that it works with
        self._phase = 0  # of the poses among the samples
        self._has_asked = False

    def configure(self, config: Config) -> None:
        wanted = (each for each, of in config.probes.items() if of.fuse_on_host)
        self._wanted = frozenset(wanted)  # ids of probes
        # And of those whose button, held, does something else than a stroke.
        self._other = {
            each
            for each, of in config.probes.items()
            if (of.button or BUTTON)[2] != "stroke"
        }

    def on_probe_found(self, found: ProbeFound) -> None:  # noqa: ARG002 - any boot ends it
        self._forget()

    def on_message(self, received: Received) -> Iterable[StageResult]:
        if received.probe_id in self._wanted:
            return self._fuse(received)
        if self._hello is not None:
            self._forget()
        return ()

    def _fuse(self, received: Received) -> Iterator[StageResult]:
        message = received.message
        if message.name == "hello" and message.fields["sample_rate"]:
            yield from self._on_hello(message, received.content)
        elif message.name == "pose":
            if not self.replaced:
                self._own_us = message.time_us
            yield from self._ask()
        elif message.name == "event":
            self._on_event(message)
        elif message.name == "raw" and received.params is not None:
            yield from self._on_raw(received, received.params)

    def _on_hello(self, hello: Message, content: bytes) -> Iterator[StageResult]:
        own = bytearray(content)
        if hello.fields["filter"] == "none" or is_in_floats(hello):
            own[_FILTER] = bytes([schema.Filter.FUSE])
        self._is_nano = hello.fields["board"] == "nano"
        if self._is_nano:
            own[_BOARD] = bytes([schema.Board.F405])
        rate_hz = _rate_of(hello)
        if rate_hz != self._rate_hz:
            self._rate_hz, self._replay = rate_hz, None
            try:
                self._resampler = Resampler(rate_hz)
            except ValueError as error:
                self._resampler = None
                yield LogLine("failed", f"{FAILED}: {error}", is_warning=True)
        if self._resampler is not None:
            own[_RATE] = self._resampler.rate_hz.to_bytes(2, "little")
        self._hello, self._content = hello, bytes(own)
        if hello.fields["raw_rate"] != hello.fields["sample_rate"]:
            yield from self._ask()

    def _ask(self) -> Iterator[SendCommands]:
        """For all raw samples and nothing else, once."""
        if self._has_asked or self._hello is None:
            return
        self._has_asked = True
        rate = {"stream": "raw", "hz": str(self._hello.fields["sample_rate"])}
        yield SendCommands((("rate", rate), ("fields", {"streams": "raw"})), FAILURE)

    def _on_event(self, message: Message) -> None:
        detail = message.fields["detail"]
        if self._replay is None or not isinstance(detail, int):
            return
        if message.fields["event"] == "tared":
            self._replay.origin(detail)
        elif message.fields["event"] in ("button_pressed", "button_released"):
            self._replay.hold(message.fields["event"] == "button_pressed")
        elif message.fields["event"] == "restarted":
            self._replay.restart(detail or int(schema.Filter.FUSE))

    def _on_raw(self, received: Received, records: bytes) -> Iterator[StageResult]:
        hello, resampler = self._hello, self._resampler
        if hello is None or resampler is None:
            return
        if self._is_nano and received.probe_id not in self._other:
            records = with_strokes(records)
        if self._replay is None:
            try:
                self._replay = _core.Replay(self._content, records)
            except (
                ValueError
            ) as error:  # scales, or a sensor, that the C has no room for
                self._resampler = None
                yield LogLine("failed", f"{FAILED}: {error}", is_warning=True)
                return
            self.replaced = COMPUTED
            yield LogLine(
                "began", "its poses are computed on the host, from its raw samples"
            )
        elif records != self._records and self._replay.params(records):
            if filter_can_continue(self._records, records):
                self._replay.go_on()
            else:
                self._replay = _core.Replay(self._content, records)
        self._records = records
        content = received.content
        if received.stamp.missing:
            own = bytearray(content)
            own[_FLAGS.start] |= int(schema.SampleFlags.GAP)
            content = bytes(own)
        message = received.message
        is_behind_gap = received.stamp.missing > 0
        taken = resampler.add(message, content, is_behind_gap=is_behind_gap)
        for each in taken:
            self._replay.step(each)
        if not taken:
            return
        stroke = self._replay.stroke(message.sequence, message.time_us)
        if stroke is not None:
            yield InjectMessage(stroke)
        if self._is_due(hello, resampler) and message.time_us != self._own_us:
            self._poses += 1
            pose = self._replay.pose(message.sequence, message.time_us)
            yield InjectMessage(pose)

    @property
    def takes_runs(self) -> bool:
        """Whether the samples of the probe are fused as they are."""
        plain = self._resampler is not None and self._resampler.is_plain
        return plain and self._replay is not None

    def on_run(
        self, contents: Sequence[bytes], rows: Rows
    ) -> Iterator[tuple[int, bytes]]:
        """on_message() for raw messages behind one, where none is missing and only
        poses are between. The place of a message, and what is computed with it.
        Only where `takes_runs`.
        """
        hello, resampler, replay = self._hello, self._resampler, self._replay
        if hello is None or resampler is None or replay is None:
            return
        sequences, times_us = rows["sequence"].tolist(), rows["time_us"].tolist()
        for at, content in enumerate(contents):
            sequence, time_us = sequences[at], times_us[at]
            replay.step(content)
            if (stroke := replay.stroke(sequence, time_us)) is not None:
                yield at, stroke
            if self._is_due(hello, resampler) and time_us != self._own_us:
                self._poses += 1
                yield at, replay.pose(sequence, time_us)

    def _is_due(self, hello: Message, resampler: Resampler) -> bool:
        """True `pose_rate` times a second, evenly, as core/probe/probe.c has it."""
        rate_hz = hello.fields["pose_rate"] or POSE_HZ
        of_hz = min(self._rate_hz, resampler.rate_hz)
        if not isinstance(rate_hz, int):
            return False
        self._phase += min(rate_hz, of_hz)
        is_due = self._phase >= of_hz
        self._phase -= of_hz if is_due else 0
        return is_due

    def status(self) -> dict[str, Any]:
        return {"is_on_host": self._replay is not None, "poses": self._poses}

    def closing_line(self) -> str:
        return f"{self._poses} poses computed on the host" if self._poses else ""


def _rate_of(hello: Message) -> int:
    """Raw samples a second that it sends, or would if it was asked."""
    raw_hz, rate_hz = hello.fields["raw_rate"], hello.fields["sample_rate"]
    if not isinstance(raw_hz, int) or not isinstance(rate_hz, int):
        return 0
    return min(raw_hz, rate_hz) or rate_hz
