# SPDX-License-Identifier: MIT
"""Raw messages at a rate that the firmware's filter takes, for sensors of other rates:
straight lines between the samples of slow ones, means of the samples of fast ones.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import cast

from imud.wire import messages
from imud.wire.messages import Message, Value

# The rates that the filter takes (native/inputs.c); at its least, 100 Hz, the rest that
# it begins with lasts for longer than most do.
LEAST_HZ, MOST_HZ = 150, 800
# Slower ones become that of a Nano; of faster ones at most this is left.
SLOW_HZ, FAST_HZ = 200, 400
# A hand turns too far between the samples of slower ones.
LOWEST_HZ = 20
# No line is drawn across a longer pause, in sample periods.
PAUSE = 2.5

_TIME = 1 << 32  # us, at which the wire's time wraps
_VECTORS = ("acc", "gyr", "mag")


class Resampler:
    """Takes raw messages in their order."""

    def __init__(self, rate_hz: int) -> None:
        """ValueError for too low a rate."""
        if rate_hz < LOWEST_HZ:
            raise ValueError(
                f"{rate_hz} samples a second are too few; {LOWEST_HZ} are needed"
            )
        self._rate_hz = rate_hz
        self._parts = 1 if rate_hz >= LEAST_HZ else math.ceil(SLOW_HZ / rate_hz)
        self._group = 1 if rate_hz <= MOST_HZ else math.ceil(rate_hz / FAST_HZ)
        self._waiting: list[Message] = []  # the last one, or those of a group

    @property
    def rate_hz(self) -> int:
        """Of what comes out."""
        return self._rate_hz * self._parts // self._group

    @property
    def is_plain(self) -> bool:
        """Whether what comes in comes out."""
        return self._parts == self._group == 1

    def add(
        self, message: Message, content: bytes, *, is_behind_gap: bool = False
    ) -> Sequence[bytes]:
        """The contents that it becomes, the last of which are of its time; none while
        its group is not complete. Nothing is drawn or averaged across a gap.
        """
        if self.is_plain:
            return (content,)
        if is_behind_gap:
            self._waiting = [message] if self._parts > 1 else []
            return (content,)
        before = self._waiting
        self._waiting = [*before, message] if self._group > 1 else [message]
        if self._group > 1:
            if len(self._waiting) < self._group:
                return ()
            mean, self._waiting = _mean(self._waiting), []
            return (mean,)
        span_us = (message.time_us - before[0].time_us) % _TIME if before else _TIME
        if span_us * self._rate_hz > PAUSE * 1e6:
            return (content,)
        shares = (part / self._parts for part in range(1, self._parts))
        return (*(_between(before[0], message, share) for share in shares), content)


def _between(first: Message, then: Message, share: float) -> bytes:
    """On the line between two samples. A magnetometer has nothing new there."""
    weights = (1.0 - share, share)
    return _blended((first, then), weights, ("acc", "gyr"))


def _mean(group: Sequence[Message]) -> bytes:
    return _blended(group, [1.0 / len(group)] * len(group), _VECTORS)


def _blended(
    group: Sequence[Message], weights: Sequence[float], vectors: Sequence[str]
) -> bytes:
    """The raw message of the weighted mean of some, with the flags of them all."""
    last, begin_us = group[-1], group[0].time_us
    after = (((each.time_us - begin_us) % _TIME) for each in group)
    at_us = round(sum(w * us for w, us in zip(weights, after, strict=True)))
    names = (cast(tuple[str, ...], each.fields["sample_flags"]) for each in group)
    flags = dict.fromkeys(itertools.chain.from_iterable(names))
    fields: dict[str, Value] = dict.fromkeys(_VECTORS)
    for name in vectors:
        known = [
            (weight, cast(tuple[int, int, int], each.fields[name]))
            for weight, each in zip(weights, group, strict=True)
            if each.fields[name] is not None
        ]
        whole = sum(weight for weight, _ in known)
        if known:
            axes = zip(*(each for _, each in known), strict=True)
            fields[name] = tuple(
                round(sum(w * x for (w, _), x in zip(known, axis, strict=True)) / whole)
                for axis in axes
            )
    fields |= {"temperature": last.fields["temperature"], "sample_flags": (*flags,)}
    return messages.encode("raw", fields, last.sequence, (begin_us + at_us) % _TIME)
