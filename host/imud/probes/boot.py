# SPDX-License-Identifier: MIT
"""The sequence numbers of one boot of a probe: which came, which are missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from zlib import crc32

import msgspec
import numpy as np

from imud.wire.messages import Message, Skew
from imud.wire.raws import Rows

# Numbers kept to tell a duplicate from a late message: ten times the messages of 40
# bytes that a kernel's serial buffer of 4 KiB holds.
NUMBERS_KEPT = 1024

# Device times are in the order of the numbers but for some milliseconds, which a sample
# may wait before it is sent. This is far more.
TIME_SLACK_US = 1_000_000

# After this silence on the host's clock the 32 bits of device time don't tell the
# order: they wrap after 71.6 minutes, and a difference has a sign for half of that.
SILENCE_NS = 600_000_000_000

_HALF = 1 << 31
_MASK = (1 << 32) - 1


def difference_32(a: int, b: int) -> int:
    """a - b of two wrapping 32-bit numbers, in -2^31 .. 2^31 - 1."""
    return ((a - b + _HALF) & _MASK) - _HALF


class DecodedFrame(msgspec.Struct, frozen=True):
    """A frame that passed its CRC and has a head, and when it came."""

    content: bytes
    decoded: Message | Skew
    sequence: int
    time_us: int
    t_ns: int | None  # host's time; None: not known
    t_sample_ns: int | None = None  # UTC of its sample, as a log has it


class Ordering(Enum):
    """Where the number of a frame stands among those that were heard."""

    AHEAD = 1
    COPY = 2
    LATE = 3
    IMPOSSIBLE = 4  # this boot can't have sent it


@dataclass(slots=True)
class BootNumbers:
    """The numbers of one boot, unrolled beyond 32 bits."""

    boot_count: int | None = None
    first: int = 0
    last: int = -1
    received: int = 0
    duplicated: int = 0
    skewed: Counter[str] = field(default_factory=Counter)
    probe_sent: int | None = None
    probe_dropped: int | None = None
    _recent: list[tuple[int, int, int] | None] = field(
        default_factory=lambda: [None] * NUMBERS_KEPT
    )
    _time_us: int = 0
    _t_ns: int | None = None

    @property
    def sent(self) -> int:
        return self.last - self.first + 1

    @property
    def lost(self) -> int:
        return self.sent - self.received - self.skewed.total()

    def number(self, sequence: int) -> int:
        """The unrolled number nearest to the last one."""
        if self.last < self.first:
            return sequence
        return self.last + difference_32(sequence, self.last & _MASK)

    def _at(self, number: int) -> tuple[int, int, int] | None:
        if self.last - number >= NUMBERS_KEPT or number < 0:
            return None
        entry = self._recent[number % NUMBERS_KEPT]
        return entry if entry is not None and entry[0] == number else None

    def is_copy(self, sequence: int, content: bytes) -> bool:
        entry = self._at(self.number(sequence))
        return entry is not None and entry[1] == crc32(content)

    def ordering(self, frame: DecodedFrame) -> Ordering:
        """Where a frame stands among those of this boot: by its number, and by whether
        its device time fits the frames beside it.
        """
        number = self.number(frame.sequence)
        if number > self.last:
            is_first = self.last < self.first
            if is_first or self._is_after_last(frame.time_us, frame.t_ns):
                return Ordering.AHEAD
            return Ordering.IMPOSSIBLE
        entry = self._at(number)
        if entry is not None:
            is_same = entry[1] == crc32(frame.content)
            return Ordering.COPY if is_same else Ordering.IMPOSSIBLE
        oldest = max(self.first, self.last - NUMBERS_KEPT + 1)
        if number > oldest and self._fits(number, frame.time_us, oldest):
            return Ordering.LATE
        return Ordering.IMPOSSIBLE

    def _is_after_last(self, time_us: int, t_ns: int | None) -> bool:
        silence_ns = 0 if t_ns is None or self._t_ns is None else t_ns - self._t_ns
        if silence_ns > SILENCE_NS:
            return True
        return difference_32(time_us, self._time_us) >= -TIME_SLACK_US

    def _fits(self, number: int, time_us: int, oldest: int) -> bool:
        before = next(
            (e for n in range(number - 1, oldest - 1, -1) if (e := self._at(n))), None
        )
        after = next(
            (e for n in range(number + 1, self.last + 1) if (e := self._at(n))), None
        )
        return (
            before is not None
            and after is not None
            and difference_32(time_us, before[2]) >= -TIME_SLACK_US
            and difference_32(time_us, after[2]) <= TIME_SLACK_US
        )

    def follow(self, frame: DecodedFrame) -> bool:
        """Enters a good frame if its number and time come next; says whether it did."""
        number = self.last + 1
        if frame.sequence != number & _MASK or self.last < self.first:
            return False
        step_us = (frame.time_us - self._time_us + TIME_SLACK_US) & _MASK
        if step_us >= _HALF:  # backwards, or after a silence: ordering() knows
            return False
        self._keep(number, frame)
        self.received += 1
        return True

    def follow_all(
        self, contents: Sequence[bytes], heads: Rows, t_ns: int | None
    ) -> bool:
        """follow() for good messages, heard until then, if it is true of all."""
        steps = np.diff(heads["sequence"], prepend=np.uint32(self.last & _MASK))
        steps_us = np.diff(heads["time_us"], prepend=np.uint32(self._time_us))
        is_next = (steps == 1).all() and (steps_us + TIME_SLACK_US < _HALF).all()
        if self.last < self.first or not is_next:
            return False
        times_us, number = heads["time_us"].tolist(), self.last
        for content, time_us in zip(contents, times_us, strict=True):
            number += 1
            self._recent[number % NUMBERS_KEPT] = number, crc32(content), time_us
        self.received += number - self.last
        self.last, self._time_us, self._t_ns = number, times_us[-1], t_ns
        return True

    def enter(self, frame: DecodedFrame, skew: str | None) -> None:
        """Counts a number that was not counted before; `skew` is its kind, if any."""
        number = self.number(frame.sequence)
        if self.last < self.first:
            self.first = number
        self._keep(number, frame)
        if skew is None:
            self.received += 1
        else:
            self.skewed[skew] += 1

    def _keep(self, number: int, frame: DecodedFrame) -> None:
        if number > self.last:
            self.last = number
            self._time_us = frame.time_us
            self._t_ns = frame.t_ns
        kept = number, crc32(frame.content), frame.time_us
        self._recent[number % NUMBERS_KEPT] = kept

    def counts(self) -> dict[str, object]:
        return {
            "sent": self.sent,
            "received": self.received,
            "lost": self.lost,
            "duplicated": self.duplicated,
            "skewed": dict(sorted(self.skewed.items())),
        }
