# SPDX-License-Identifier: MIT
"""Reads a log from any of its times on, also one that is still written or damaged."""

from __future__ import annotations

import struct
from bisect import bisect_left
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.opcode import Opcode

from imud.errors import FileError
from imud.log.parts import Damage, RecordGroup, channels_of, parts_of, records_of
from imud.log.reader import Logged, LogHead, Reader, legible, opened

# Some 20 GB of ours.
SPANS_MAX = 200_000

_TIMES = struct.Struct("<QQ")  # of the first and last message, at a chunk's begin


class Span(NamedTuple):
    """A chunk: its offset, when its first and last message were received, and the
    channels of its messages, where it has an index.
    """

    at: int
    first_ns: int
    last_ns: int
    channels: set[int]


class SeekableLog:
    """A log by its chunks. FileError if it can't be read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.spans: list[Span] = []
        with opened(path) as file, legible(path):
            self._size = path.stat().st_size
            for at, kind, body in records_of(file, self._size):
                if len(self.spans) > SPANS_MAX:
                    raise FileError(f"{path} has more parts than any log of imud")
                if kind == Opcode.CHUNK:
                    file.seek(body)
                    times = file.read(_TIMES.size)
                    if len(times) == _TIMES.size:
                        first_ns, last_ns = _TIMES.unpack(times)
                        self.spans.append(Span(at, first_ns, last_ns, set()))
                elif kind == Opcode.MESSAGE_INDEX and self.spans:
                    file.seek(body)
                    self.spans[-1].channels.add(int.from_bytes(file.read(2), "little"))
        known = channels_of(path)
        self._reader = Reader(known)
        # Without a summary, channels are known up to where it was read.
        self._known_to = self._size if known else 0

    @property
    def times_ns(self) -> tuple[int, int]:
        """UTC of its first and last message; 0, 0 if it has none."""
        if not self.spans:
            return 0, 0
        first_ns = min(each.first_ns for each in self.spans)
        return first_ns, max(each.last_ns for each in self.spans)

    def of(self, topic: str) -> Iterator[Logged]:
        """The messages of a topic, of which few chunks have any."""
        with opened(self._path) as file, legible(self._path):
            for span in self.spans:
                topics = {self._reader.topic_of(each) for each in span.channels}
                if topics and not topics & {topic, None}:
                    continue
                part = next(parts_of(file, self._size, span.at), None)
                if isinstance(part, RecordGroup):
                    for found in self._reader.read(part):
                        if isinstance(found, Logged) and found.topic == topic:
                            yield found

    def read(self, from_ns: int = 0) -> Iterator[LogHead | Logged | Damage]:
        """All messages of the chunks from that UTC on, to the end that it has then."""
        place = bisect_left(self.spans, from_ns, key=lambda span: span.last_ns)
        begin = self.spans[place].at if from_ns and place < len(self.spans) else 0
        if from_ns and place == len(self.spans):
            begin = self._size
        start = min(begin, self._known_to)
        with opened(self._path) as file, legible(self._path):
            for part in parts_of(file, self._path.stat().st_size, start):
                if isinstance(part, Damage):
                    if part.at >= begin:
                        yield part
                    continue
                found = self._reader.read(part)
                self._known_to = max(self._known_to, part.end)
                if part.end <= begin:
                    for _ in found:  # for its channels
                        pass
                else:
                    yield from found
