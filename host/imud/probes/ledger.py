# SPDX-License-Identifier: MIT
"""Follows the sequence numbers of a probe and accounts for every one of them.

For each boot of a probe, always: sent = received + skewed + lost. `sent` is last number
minus first number heard plus one; `received` counts numbers that came whole, once, in
order; `skewed` those that came but are not to be used, by kind; the rest is `lost`.
Copies and strays come on top and are counted apart.

Numbers going backwards are not taken for a restart without evidence, which is one of:
- a hello with another boot count;
- a hello with number 0 that is not a copy of one heard before;
- two messages in a row that continue each other and that this boot can't have sent:
  a number it used for something else, a device time that doesn't fit between its
  neighbours', or a number longer ago than any driver keeps bytes.
The first of those two is held until the second decides; without one it is a stray.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from zlib import crc32

import msgspec

from imud.wire.messages import Message, Skew

# Numbers remembered to tell a copy from a late one: ten times what a kernel's serial
# buffer of 4 KiB holds in messages of 40 bytes.
WINDOW = 1024

# Messages that a kernel's serial buffer may hold from before a restart.
BUFFERED = 100

# Device times of messages sent one after the other differ little from the order of
# their numbers: a sample waits for its turn for some milliseconds.
TIME_SLACK_US = 1_000_000

# A restart is believed at two messages that are at most this many numbers apart.
CONTINUES_WITHIN = 16

# Past this silence on the host's clock, the 32 bits of device time say nothing about
# order: they wrap after 71.6 minutes and a difference has a sign for half of that.
SILENCE_NS = 600_000_000_000

_HALF = 1 << 31
_MASK = (1 << 32) - 1


# Messages that say nothing about boots or the probe's own counts.
_PLAIN = frozenset({"pose", "raw", "event", "reply", "equipment"})


def difference_32(a: int, b: int) -> int:
    """a - b of two wrapping 32-bit numbers, in -2^31 .. 2^31 - 1."""
    return ((a - b + _HALF) & _MASK) - _HALF


class Heard(msgspec.Struct, frozen=True):
    """One frame that passed its CRC and has a head: what it says, and when it came."""

    content: bytes
    said: Message | Skew
    sequence: int
    time_us: int
    t_ns: int | None


class Verdict(Enum):
    GOOD = "good"
    SKEWED = "skewed"
    DUPLICATE = "duplicate"
    STRAY = "stray"


class Judged(msgspec.Struct, frozen=True):
    """What became of one frame, and whether a boot of the probe began with it."""

    heard: Heard
    verdict: Verdict
    begins_boot: bool = False


class _Place(Enum):
    AHEAD = 1
    COPY = 2
    LATE = 3
    ODD = 4  # this boot can't have sent it


@dataclass(slots=True)
class Boot:
    """The numbers of one boot. Numbers are unrolled: they don't wrap."""

    boot_count: int | None = None
    first: int = 0
    last: int = -1
    received: int = 0
    duplicated: int = 0
    skewed: Counter[str] = field(default_factory=Counter)
    probe_sent: int | None = None
    probe_dropped: int | None = None
    _window: list[tuple[int, int, int] | None] = field(
        default_factory=lambda: [None] * WINDOW
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
        """The unrolled number that lies nearest to the last one."""
        if self.last < self.first:
            return sequence
        return self.last + difference_32(sequence, self.last & _MASK)

    def _at(self, number: int) -> tuple[int, int, int] | None:
        if self.last - number >= WINDOW or number < 0:
            return None
        entry = self._window[number % WINDOW]
        return entry if entry is not None and entry[0] == number else None

    def is_copy(self, sequence: int, content: bytes) -> bool:
        entry = self._at(self.number(sequence))
        return entry is not None and entry[1] == crc32(content)

    def place(self, heard: Heard) -> _Place:
        number = self.number(heard.sequence)
        if number > self.last:
            is_first = self.last < self.first
            if is_first or self._is_after_last(heard.time_us, heard.t_ns):
                return _Place.AHEAD
            return _Place.ODD
        entry = self._at(number)
        if entry is not None:
            is_same = entry[1] == crc32(heard.content)
            return _Place.COPY if is_same else _Place.ODD
        oldest = max(self.first, self.last - WINDOW + 1)
        if number > oldest and self._fits(number, heard.time_us, oldest):
            return _Place.LATE
        return _Place.ODD

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

    def follow(self, heard: Heard) -> bool:
        """Enters a good one if it has the number and the time that come next."""
        number = self.last + 1
        if heard.sequence != number & _MASK or self.last < self.first:
            return False
        step_us = (heard.time_us - self._time_us + TIME_SLACK_US) & _MASK
        if step_us >= _HALF:  # backwards, or after a silence: place() knows
            return False
        self.last = number
        self._time_us = heard.time_us
        self._t_ns = heard.t_ns
        self._window[number % WINDOW] = (number, crc32(heard.content), heard.time_us)
        self.received += 1
        return True

    def enter(self, heard: Heard, skew: str | None) -> None:
        """Counts a number for the first and only time."""
        number = self.number(heard.sequence)
        if self.last < self.first:
            self.first = number
        if number > self.last:
            self.last = number
            self._time_us = heard.time_us
            self._t_ns = heard.t_ns
        self._window[number % WINDOW] = (number, crc32(heard.content), heard.time_us)
        if skew is None:
            self.received += 1
        else:
            self.skewed[skew] += 1

    def counts(self) -> dict[str, object]:
        return {
            "sent": self.sent,
            "received": self.received,
            "lost": self.lost,
            "duplicated": self.duplicated,
            "skewed": dict(sorted(self.skewed.items())),
        }


class Account:
    """All boots of one probe, the latest of them open."""

    def __init__(self) -> None:
        self.boot = Boot()
        self.boots = 0
        self.strays = 0
        self.unplaced: Counter[str] = Counter()
        self._before: Boot | None = None
        self._earlier = Boot()
        self._earlier_sent = 0
        self._suspect: Heard | None = None

    def note(self, heard: Heard) -> list[Judged]:
        """Judges one frame; the answer may hold the one before it, or be put off."""
        said = heard.said
        is_plain = type(said) is Message and said.name in _PLAIN
        if is_plain and self._suspect is None and self.boot.follow(heard):
            return [Judged(heard, Verdict.GOOD)]  # nearly all of them

        skew: str | None = said.kind if isinstance(said, Skew) else None
        if self.boots == 0:
            return [self._begin(heard)] if skew is None else [self._unplaced(heard)]

        boot_count = _boot_count(heard)
        place = self.boot.place(heard)
        is_far_ahead = place is _Place.AHEAD and self._step(heard) > CONTINUES_WITHIN
        is_doubtful = is_far_ahead or place is _Place.ODD
        if is_doubtful and self._is_copy_of_before(heard):
            return [Judged(heard, Verdict.DUPLICATE)]
        if place is _Place.COPY and not self._is_next_of_suspect(heard):
            self.boot.duplicated += 1
            return [Judged(heard, Verdict.DUPLICATE)]
        if skew is not None and (place is _Place.ODD or self._step(heard) > WINDOW):
            # A frame that is damaged and yet passes its CRC is not believed about
            # its number, lest a million messages count as lost.
            return [self._unplaced(heard)]
        if self._is_other_boot(boot_count):
            return self._restart(heard)
        if place is _Place.ODD or self._is_next_of_suspect(heard):
            return self._suspect_restart(heard, boot_count)
        judged = self.close()
        if place is _Place.LATE and skew is None:
            skew = "late"
        self.boot.enter(heard, skew)
        self._learn(heard, boot_count)
        verdict = Verdict.GOOD if skew is None else Verdict.SKEWED
        return [*judged, Judged(heard, verdict)]

    def close(self) -> list[Judged]:
        """Gives up waiting for the message that would decide about a suspect."""
        if self._suspect is None:
            return []
        heard, self._suspect = self._suspect, None
        self.strays += 1
        return [Judged(heard, Verdict.STRAY)]

    @property
    def _earlier_lost(self) -> int:
        earlier = self._earlier
        return self._earlier_sent - earlier.received - earlier.skewed.total()

    @property
    def lost(self) -> int:
        """Of all boots."""
        return self.boot.lost + self._earlier_lost

    @property
    def skewed(self) -> Counter[str]:
        """Of all boots, with those whose number is not believed."""
        return self.boot.skewed + self._earlier.skewed + self.unplaced

    def counts(self) -> dict[str, object]:
        earlier = self._earlier.counts()
        earlier["sent"] = self._earlier_sent
        earlier["lost"] = self._earlier_lost
        return {
            **self.boot.counts(),
            "probe_sent": self.boot.probe_sent,
            "probe_dropped": self.boot.probe_dropped,
            "strays": self.strays,
            "unplaced": dict(sorted(self.unplaced.items())),
            "boots": self.boots,
            "earlier_boots": earlier,
        }

    def _unplaced(self, heard: Heard) -> Judged:
        self.unplaced[getattr(heard.said, "kind", "good")] += 1
        return Judged(heard, Verdict.SKEWED)

    def _is_other_boot(self, boot_count: int | None) -> bool:
        known = self.boot.boot_count
        return boot_count is not None and known is not None and boot_count != known

    def _step(self, heard: Heard) -> int:
        return self.boot.number(heard.sequence) - self.boot.last

    def _is_next_of_suspect(self, heard: Heard) -> bool:
        suspect = self._suspect
        return (
            suspect is not None
            and not hasattr(heard.said, "kind")
            and difference_32(heard.sequence, suspect.sequence) == 1
            and _continues(suspect, heard)
        )

    def _is_copy_of_before(self, heard: Heard) -> bool:
        """A copy from the end of the boot before, out of a buffer, after a restart.

        Not to be looked for any longer or further back: a probe that does the same in
        each boot, as an emulated one does, says the same under the same numbers.
        """
        before = self._before
        if before is None or self.boot.sent > BUFFERED:
            return False
        if before.last - before.number(heard.sequence) >= BUFFERED:
            return False
        if not before.is_copy(heard.sequence, heard.content):
            return False
        self._earlier.duplicated += 1
        return True

    def _suspect_restart(self, heard: Heard, boot_count: int | None) -> list[Judged]:
        if boot_count is not None and heard.sequence == 0:
            return self._restart(heard)
        if self._suspect is not None and _continues(self._suspect, heard):
            return self._restart(heard)
        judged = self.close()
        self._suspect = heard
        return judged

    def _restart(self, heard: Heard) -> list[Judged]:
        suspect, self._suspect = self._suspect, None
        judged = []
        if suspect is not None:
            if _continues(suspect, heard):
                judged.append(self._begin(suspect))
                self.boot.enter(heard, None)
                self._learn(heard, _boot_count(heard))
                return [*judged, Judged(heard, Verdict.GOOD)]
            self.strays += 1
            judged.append(Judged(suspect, Verdict.STRAY))
        return [*judged, self._begin(heard)]

    def _begin(self, heard: Heard) -> Judged:
        if self.boots > 0:
            self._before = self.boot
            self._earlier_sent += self.boot.sent
            self._earlier.received += self.boot.received
            self._earlier.duplicated += self.boot.duplicated
            self._earlier.skewed.update(self.boot.skewed)
        self.boots += 1
        self.boot = Boot()
        self.boot.enter(heard, None)
        self._learn(heard, _boot_count(heard))
        return Judged(heard, Verdict.GOOD, begins_boot=True)

    def _learn(self, heard: Heard, boot_count: int | None) -> None:
        if boot_count is not None:
            self.boot.boot_count = boot_count
        fields = getattr(heard.said, "fields", None)
        if fields is not None and "messages_sent" in fields:
            self.boot.probe_sent = fields["messages_sent"]
            self.boot.probe_dropped = fields["messages_dropped"]


def _continues(before: Heard, heard: Heard) -> bool:
    step = difference_32(heard.sequence, before.sequence)
    is_later = difference_32(heard.time_us, before.time_us) >= -TIME_SLACK_US
    return 0 < step <= CONTINUES_WITHIN and is_later


def _boot_count(heard: Heard) -> int | None:
    fields = getattr(heard.said, "fields", None)
    count = fields.get("boot_count") if fields is not None else None
    return count if isinstance(count, int) else None
