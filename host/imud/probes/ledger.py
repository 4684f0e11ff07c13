# SPDX-License-Identifier: MIT
"""Accounts for every sequence number of a probe: received, skewed or lost.

For each boot, always: sent = received + skewed + lost. `sent` is the last number minus
the first number heard, plus one; `received` counts messages that came whole, once and
in order; `skewed` those that came but can't be used, by kind; the rest is `lost`.
Duplicates and strays are counted apart.

Numbers that go backwards are a restart only with evidence, which is one of:
- a hello with another boot count;
- a hello with number 0 that is not a copy of one heard before;
- two messages in a row that continue each other and that this boot can't have sent: a
  number it used for another message, a device time that does not fit between its
  neighbours', or a number so old that no driver has kept it.
The first of those two is held back until the second decides; without one it is a stray.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

import msgspec

from imud.probes.boot import (
    NUMBERS_KEPT,
    TIME_SLACK_US,
    BootNumbers,
    DecodedFrame,
    Ordering,
    difference_32,
)
from imud.wire.messages import Message, Skew
from imud.wire.raws import Rows

# Messages from before a restart that a kernel's serial buffer may hold.
BUFFERED = 100

# Two messages continue each other if they are at most this many numbers apart.
CONTINUES_WITHIN = 16

# Messages without anything about boots or the probe's own counts.
_PLAIN = frozenset({"pose", "raw", "event", "stroke", "reply", "equipment"})


class FrameVerdict(Enum):
    GOOD = "good"
    SKEWED = "skewed"
    DUPLICATE = "duplicate"
    STRAY = "stray"


class Judged(msgspec.Struct, frozen=True):
    """The verdict on one frame, and whether a boot began with it."""

    frame: DecodedFrame
    verdict: FrameVerdict
    begins_boot: bool = False


class Totals(msgspec.Struct, frozen=True):
    """Messages of one probe, all boots together: sent = received + skewed + lost."""

    sent: int
    received: int
    lost: int
    duplicated: int
    skewed: Counter[str]  # by kind


def totals(counts: Mapping[str, Any]) -> Totals:
    """Sums the open boot and the earlier ones, in the counts of an account or in the
    ledger of a status. A count that is not there is 0.
    """
    earlier = counts.get("earlier_boots") or {}

    def both(name: str) -> int:
        return int(counts.get(name) or 0) + int(earlier.get(name) or 0)

    return Totals(
        both("sent"),
        both("received"),
        both("lost"),
        both("duplicated"),
        Counter(counts.get("skewed") or {}) + Counter(earlier.get("skewed") or {}),
    )


class Account:
    """All boots of one probe, the latest of them open."""

    def __init__(self) -> None:
        self.boot = BootNumbers()
        self.boots = 0
        self.strays = 0
        self.unplaced: Counter[str] = Counter()
        self._before: BootNumbers | None = None
        self._earlier = BootNumbers()
        self._earlier_sent = 0
        self._pending: DecodedFrame | None = None
        self._lost: int | None = None  # of all boots; None: to be counted again

    def note(self, frame: DecodedFrame) -> list[Judged]:
        """Judges one frame. The result is empty while the frame is pending, and may
        begin with the previous pending frame.
        """
        decoded = frame.decoded
        is_plain = type(decoded) is Message and decoded.name in _PLAIN
        if is_plain and self._pending is None and self.boot.follow(frame):
            # Nearly all of them; none is lost.
            return [Judged(frame, FrameVerdict.GOOD)]

        self._lost = None
        skew: str | None = decoded.kind if isinstance(decoded, Skew) else None
        if self.boots == 0:
            return [self._begin(frame)] if skew is None else [self._unplaced(frame)]

        boot_count = _boot_count(frame)
        ordering = self.boot.ordering(frame)
        is_far_ahead = (
            ordering is Ordering.AHEAD and self._step(frame) > CONTINUES_WITHIN
        )
        is_doubtful = is_far_ahead or ordering is Ordering.IMPOSSIBLE
        if is_doubtful and self._is_copy_of_before(frame):
            return [Judged(frame, FrameVerdict.DUPLICATE)]
        if ordering is Ordering.COPY and not self._is_next_of_pending(frame):
            self.boot.duplicated += 1
            return [Judged(frame, FrameVerdict.DUPLICATE)]
        if skew is not None and (
            ordering is Ordering.IMPOSSIBLE or self._step(frame) > NUMBERS_KEPT
        ):
            # A damaged frame may pass its CRC. Its number is not believed, lest a
            # million messages count as lost.
            return [self._unplaced(frame)]
        if self._is_other_boot(boot_count):
            return self._restart(frame)
        if ordering is Ordering.IMPOSSIBLE or self._is_next_of_pending(frame):
            return self._await_restart(frame, boot_count)
        judged = self.close()
        if ordering is Ordering.LATE and skew is None:
            skew = "late"
        self.boot.enter(frame, skew)
        self._learn(frame, boot_count)
        verdict = FrameVerdict.GOOD if skew is None else FrameVerdict.SKEWED
        return [*judged, Judged(frame, verdict)]

    def note_all(
        self, contents: Sequence[bytes], heads: Rows, t_ns: int | None
    ) -> bool:
        """Judges raw messages and poses as good, if each continues the one before."""
        return self._pending is None and self.boot.follow_all(contents, heads, t_ns)

    def close(self) -> list[Judged]:
        """Resolves the pending frame: no following message has confirmed it."""
        if self._pending is None:
            return []
        frame, self._pending = self._pending, None
        self.strays += 1
        return [Judged(frame, FrameVerdict.STRAY)]

    @property
    def _earlier_lost(self) -> int:
        earlier = self._earlier
        return self._earlier_sent - earlier.received - earlier.skewed.total()

    @property
    def lost(self) -> int:
        """Lost messages of all boots."""
        if self._lost is None:
            self._lost = self.boot.lost + self._earlier_lost
        return self._lost

    @property
    def skewed(self) -> Counter[str]:
        """Skewed messages of all boots, and those with an implausible sequence number;
        by kind."""
        return self.boot.skewed + self._earlier.skewed + self.unplaced

    def counts(self) -> dict[str, object]:
        """The counts of the present boot and of all earlier ones, as the status has
        them.
        """
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

    def _unplaced(self, frame: DecodedFrame) -> Judged:
        self.unplaced[getattr(frame.decoded, "kind", "good")] += 1
        return Judged(frame, FrameVerdict.SKEWED)

    def _is_other_boot(self, boot_count: int | None) -> bool:
        known = self.boot.boot_count
        return boot_count is not None and known is not None and boot_count != known

    def _step(self, frame: DecodedFrame) -> int:
        return self.boot.number(frame.sequence) - self.boot.last

    def _is_next_of_pending(self, frame: DecodedFrame) -> bool:
        pending = self._pending
        return (
            pending is not None
            and not hasattr(frame.decoded, "kind")
            and difference_32(frame.sequence, pending.sequence) == 1
            and _continues(pending, frame)
        )

    def _is_copy_of_before(self, frame: DecodedFrame) -> bool:
        """Whether it is a message of the boot before, which came out of a buffer after
        the restart. Not searched for longer or further back: a probe that does the same
        in each boot, as an emulated one does, sends equal messages.
        """
        before = self._before
        if before is None or self.boot.sent > BUFFERED:
            return False
        if before.last - before.number(frame.sequence) >= BUFFERED:
            return False
        if not before.is_copy(frame.sequence, frame.content):
            return False
        self._earlier.duplicated += 1
        return True

    def _await_restart(
        self, frame: DecodedFrame, boot_count: int | None
    ) -> list[Judged]:
        if boot_count is not None and frame.sequence == 0:
            return self._restart(frame)
        if self._pending is not None and _continues(self._pending, frame):
            return self._restart(frame)
        judged = self.close()
        self._pending = frame
        return judged

    def _restart(self, frame: DecodedFrame) -> list[Judged]:
        pending, self._pending = self._pending, None
        judged = []
        if pending is not None:
            if _continues(pending, frame):
                judged.append(self._begin(pending))
                self.boot.enter(frame, None)
                self._learn(frame, _boot_count(frame))
                return [*judged, Judged(frame, FrameVerdict.GOOD)]
            self.strays += 1
            judged.append(Judged(pending, FrameVerdict.STRAY))
        return [*judged, self._begin(frame)]

    def _begin(self, frame: DecodedFrame) -> Judged:
        if self.boots > 0:
            self._before = self.boot
            self._earlier_sent += self.boot.sent
            self._earlier.received += self.boot.received
            self._earlier.duplicated += self.boot.duplicated
            self._earlier.skewed.update(self.boot.skewed)
        self.boots += 1
        self.boot = BootNumbers()
        self.boot.enter(frame, None)
        self._learn(frame, _boot_count(frame))
        return Judged(frame, FrameVerdict.GOOD, begins_boot=True)

    def _learn(self, frame: DecodedFrame, boot_count: int | None) -> None:
        if boot_count is not None:
            self.boot.boot_count = boot_count
        fields = getattr(frame.decoded, "fields", None)
        if fields is not None and "messages_sent" in fields:
            self.boot.probe_sent = fields["messages_sent"]
            self.boot.probe_dropped = fields["messages_dropped"]


def _continues(before: DecodedFrame, frame: DecodedFrame) -> bool:
    step = difference_32(frame.sequence, before.sequence)
    is_later = difference_32(frame.time_us, before.time_us) >= -TIME_SLACK_US
    return 0 < step <= CONTINUES_WITHIN and is_later


def _boot_count(frame: DecodedFrame) -> int | None:
    fields = getattr(frame.decoded, "fields", None)
    count = fields.get("boot_count") if fields is not None else None
    return count if isinstance(count, int) else None
