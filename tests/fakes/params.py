# SPDX-License-Identifier: MIT
"""The params store of a probe made of Python, as firmware/core/params/store.h says."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

ROOM = 248
PART = 28
GOES_ON = 256

Answer = tuple[str, tuple[int, int]]


def parts_of(records: bytes) -> Iterator[dict[str, object]]:
    """The fields of each message that tells a part of these records."""
    for at in range(0, max(len(records), 1), PART):
        yield {
            "set_digest": zlib.crc32(records),
            "set_length": len(records),
            "part_offset": at,
            "part": records[at : at + PART].ljust(PART, b"\0"),
        }


class FakeParams:
    """Two banks: one in force, and a spare one that is written."""

    def __init__(self) -> None:
        self.records = b""
        self.busy = 0  # so often it is busy after each step
        self.forgets = 0  # number of words that it accepts but does not store
        self.is_worn = False  # its memory keeps nothing
        self.refusal: tuple[int, int] | None = None
        self.tells: list[dict[str, object]] = []  # parts that are to be told
        self.has_changed = False  # since this was last looked at
        self.knows_going_on = True  # as firmware does since there is the flag
        self.goes_on = False  # the filter, with what was asked for last
        self._spare = bytearray(b"\xff" * ROOM)
        self._wait = 0
        self._asked: tuple[int, int] | None = None
        self._result: Answer | None = None  # of what was asked

    @property
    def digest(self) -> int:
        return zlib.crc32(self.records)

    def restart(self) -> None:
        self._wait, self._asked, self._result = 0, None, None

    def obey(self, command: str, first: int, second: int) -> Answer:
        if command == "params_tell":
            self.tells += parts_of(self.records)
            return "ok", (first, second)
        is_fit = first % 4 == 0 and 0 <= first <= ROOM - 4
        if command == "params_apply":
            self.goes_on = self.knows_going_on and first >= GOES_ON
            first -= GOES_ON if self.goes_on else 0
            is_fit = 0 <= first <= ROOM
        if not is_fit:
            return "bad_argument", (first, second)
        if self._wait > 0:
            self._wait -= 1
            return "busy", (first, second)
        if command == "params_write":
            return self._write(first, second)
        return self._apply(first, second)

    def _write(self, at: int, word: int) -> Answer:
        self._result, self._wait = None, self.busy
        if self.is_worn:
            return "failed", (at, word)
        if self.forgets:
            self.forgets -= 1
        else:
            self._spare[at : at + 4] = word.to_bytes(4, "little", signed=True)
        return "ok", (at, word)

    def _apply(self, length: int, digest: int) -> Answer:
        if self._result is not None and self._asked == (length, digest):
            result, self._result = self._result, None
            return result
        if (length, digest & 0xFFFFFFFF) == (len(self.records), self.digest):
            return "ok", (length, digest)
        self._asked, self._wait = (length, digest), self.busy
        records = bytes(self._spare[:length])
        self.tells += parts_of(records)
        if zlib.crc32(records) != digest & 0xFFFFFFFF:
            self._result = "damaged", (length, digest)
        elif self.refusal is not None:
            self._result = "refused", self.refusal
        else:
            self.records, self.has_changed = records, True
        return "busy", (length, digest)
