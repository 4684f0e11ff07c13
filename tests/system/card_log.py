# SPDX-License-Identifier: MIT
"""A card for the virtual F405, the log that its image writes there, and the comparison
of each sample with what went over the wire."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from imud.card.disk import opened
from imud.card.probe_log import find_log
from imud.cli import main
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message, decode
from system.virtual import Run, send

RATE_HZ = 380
PRESS_US = 3_000_000  # it is calibrated by then
STREAMS_US = PRESS_US + 250_000  # and debounced; the log begins there
CLICK = ("--press", f"{PRESS_US}:{PRESS_US + 100_000}")
LOST_US = 500_000  # before a cut, at most


def all_on_the_wire() -> tuple[object, ...]:
    """Options that have raw and pose of every sample sent, so as to compare."""
    orders = (send("fields", 3, token=6), send("rate", 1, RATE_HZ, token=7))
    orders = (*orders, send("rate", 0, RATE_HZ, token=8))
    return tuple(
        word
        for number, order in enumerate(orders)
        for word in ("--send", f"{1_600_000 + 20_000 * number}:{order}")
    )


def prepare(path: Path, size: str = "40M", log_size: str | None = None) -> Path:
    limit = ("--log-size", log_size) if log_size else ()
    assert main(["card", "prepare", str(path), "--size", size, "--yes", *limit]) == 0
    return path


@dataclass(frozen=True)
class Recorded:
    """A recording, as imud reads it from a card's image."""

    number: int
    is_ended: bool
    bad: int
    contents: list[bytes]

    @cached_property
    def messages(self) -> list[Message]:
        decoded = [decode(content) for content in self.contents]
        assert all(isinstance(message, Message) for message in decoded)
        return [message for message in decoded if isinstance(message, Message)]

    @cached_property
    def samples(self) -> dict[tuple[str, int], bytes]:
        """Raw and pose by kind and time: all but id and sequence number."""
        return samples(self.messages, self.contents)

    def named(self, name: str) -> list[Message]:
        return [message for message in self.messages if message.name == name]


def samples(
    messages: list[Message], contents: list[bytes]
) -> dict[tuple[str, int], bytes]:
    return {
        (message.name, message.time_us): content[5:]
        for message, content in zip(messages, contents, strict=True)
        if message.name in ("raw", "pose")
    }


def recordings(path: Path) -> list[Recorded]:
    with opened(path) as disk:
        log = find_log(disk)
        found = []
        for recording in log.recordings():
            decoder = FrameDecoder()
            contents = [c for data in log.frames(recording) for c in decoder.feed(data)]
            found.append(
                Recorded(recording.number, recording.is_ended, recording.bad, contents)
            )
        return found


def events(messages: list[Message]) -> list[tuple[Any, Any]]:
    return [
        (message.fields["event"], message.fields["cause"])
        for message in messages
        if message.name == "event"
    ]


def assert_it_is_the_wires(recorded: Recorded, done: Run) -> None:
    """Every sample from the first to the last of the recording, bit by bit."""
    wire = samples(done.messages, done.contents)
    log = recorded.samples
    begun, ended = min(t for _, t in log), max(t for _, t in log)
    expected = {key: data for key, data in wire.items() if begun <= key[1] <= ended}
    assert log == expected


def equipment(done: Run) -> dict[str, Any]:
    return dict(done.named("equipment")[-1].fields)
