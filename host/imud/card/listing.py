# SPDX-License-Identifier: MIT
"""`imud card list`: what a card holds, without decoding more than headers."""

from __future__ import annotations

import struct
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from imud.card import disk
from imud.card.probe_log import CONTENT, CardLog, CardRecording, find_log
from imud.probes.boot import difference_32
from imud.probes.first_hello import NOBODY
from imud.progress import Progress
from imud.wire import schema
from imud.wire.frame import HELLO_ID, FrameDecoder
from imud.wire.messages import Message, decode

_HEADER = struct.Struct(schema.HEADER)
_ID = {message.name: message.id for message in schema.MESSAGES}
_TOLD = {HELLO_ID, _ID["equipment"], _ID["event"]}  # read whole


@dataclass(slots=True)
class Survey:
    """The contents of a recording, from the headers of its messages."""

    probe: str = NOBODY
    messages: Counter[int] = field(default_factory=Counter)  # by their id
    last_sequence: int = -1
    duration_us: int = 0
    counted: int = 0  # the file's next block, as the probe said last
    worn: set[int] = field(default_factory=set)  # blocks that it left out

    @property
    def samples(self) -> int:
        """Raw messages, one a sample; poses where no raw was logged."""
        return self.messages[_ID["raw"]] or self.messages[_ID["pose"]]

    @property
    def lost(self) -> int:
        """Gaps in the sequence numbers; a recording's first is 0."""
        return self.last_sequence + 1 - self.messages.total()


def survey(log: CardLog, recording: CardRecording, progress: Progress) -> Survey:
    """Reads a recording's headers; moves `progress` by its bytes."""
    found = Survey()
    decoder = FrameDecoder()
    before_us: int | None = None
    for data in log.frames(recording):
        for content in decoder.feed(data):
            if len(content) < _HEADER.size:
                continue
            kind, sequence, time_us = _HEADER.unpack_from(content)
            if sequence <= found.last_sequence:  # a block that was written twice
                continue
            found.messages[kind] += 1
            found.last_sequence = sequence
            if before_us is not None:
                found.duration_us += difference_32(time_us, before_us)
            before_us = time_us
            if kind in _TOLD and isinstance(message := decode(content), Message):
                _take(message, found)
        progress.advance(len(data))
    return found


def _take(message: Message, found: Survey) -> None:
    fields: Any = message.fields
    if message.name == "hello" and found.probe == NOBODY:
        found.probe = fields["probe_id"].hex()
    elif message.name == "equipment":
        found.counted = fields["card_block"] or 0
    elif message.name == "event" and fields["cause"] == "worn":
        found.worn.add(fields["detail"])


def missing(recording: CardRecording, found: Survey) -> int:
    """Blocks that the probe counted as kept and that are not on the card."""
    first = recording.runs[0].start
    kept = sum(
        len(range(run.start, min(run.stop, found.counted))) for run in recording.runs
    )
    return max(0, found.counted - first - kept - len(found.worn))


def show(path: Path) -> int:
    """`imud card list`: prints a line for each recording; returns 0."""
    with disk.opened(path) as card:
        log = find_log(card)
        recordings = log.recordings()
        sys.stdout.write(summary(log, recordings))
        rows = [("recording", "probe", "duration", "samples", "lost", "bad", "end")]
        warnings = ""
        progress = bar(recordings)
        for recording in recordings:
            found = survey(log, recording, progress)
            sent = found.last_sequence + 1
            rows.append(
                (
                    f"{recording.number}",
                    found.probe,
                    duration(found.duration_us),
                    f"{found.samples}",
                    f"{found.lost} of {sent}",
                    plural(recording.bad, "block"),
                    end(recording),
                )
            )
            if lacks := missing(recording, found):
                warnings += (
                    f"recording {recording.number}: the probe counted "
                    f"{plural(lacks, 'block')} more than the card kept; it may be a "
                    "counterfeit: use another card\n"
                )
        progress.end()
    if recordings:
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for row in rows:
            cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            sys.stdout.write("  ".join(cells).rstrip() + "\n")
    sys.stdout.write(warnings)
    return 0


def bar(recordings: list[CardRecording]) -> Progress:
    """A progress bar over the bytes of these recordings."""
    return Progress("reading", sum(each.blocks for each in recordings) * CONTENT)


def summary(log: CardLog, recordings: list[CardRecording]) -> str:
    """One line about a card and how much of it is written."""
    written = sum(each.blocks for each in recordings)
    bad = sum(each.bad for each in recordings)
    return (
        f"card {log.card_id:08x}: {plural(len(recordings), 'recording')}, "
        f"{written} of {log.blocks - 1} blocks written, {bad} torn or worn\n"
    )


def end(recording: CardRecording) -> str:
    """How a recording ended, in words."""
    begin = "" if recording.is_begun else "its first block is lost, "
    return begin + ("ended cleanly" if recording.is_ended else "cut off")


def duration(duration_us: int) -> str:
    """H:MM:SS.s"""
    minutes, rest_us = divmod(duration_us, 60_000_000)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest_us / 1e6:04.1f}"


def plural(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
