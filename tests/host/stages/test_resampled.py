# SPDX-License-Identifier: MIT
"""Samples of other rates than the filter's, brought to one of those."""

from __future__ import annotations

from typing import Any

import pytest

from imud.stages.resampled import Resampler
from imud.wire.messages import Message, decode, encode


def sample(t_us: int, count: int, *, has_mag: bool = False) -> tuple[Message, bytes]:
    fields: dict[str, Any] = dict.fromkeys(("acc", "gyr"), (count, 0, -count))
    fields |= {"mag": (count, 0, 0) if has_mag else None, "temperature": None}
    fields["sample_flags"] = ("gyr_clipped",) if count == 40 else ()
    content = encode("raw", fields, 7, t_us % 2**32)
    message = decode(content)
    assert isinstance(message, Message)
    return message, content


def seen(contents: Any) -> list[tuple[Any, ...]]:
    """Time, a count, of the field, and flags."""
    found: list[Any] = list(map(decode, contents))
    return [
        (
            each.time_us,
            each.fields["gyr"][0],
            each.fields["mag"],
            each.fields["sample_flags"],
        )
        for each in found
    ]


def test_slow_ones_lie_on_lines_also_where_the_time_wraps() -> None:
    slow = Resampler(50)
    assert slow.rate_hz == 200
    begin_us = 2**32 - 10_000
    assert len(slow.add(*sample(begin_us, 0))) == 1
    assert seen(slow.add(*sample(begin_us + 20_000, 40, has_mag=True))) == [
        (2**32 - 5_000, 10, None, ("gyr_clipped",)),
        (0, 20, None, ("gyr_clipped",)),
        (5_000, 30, None, ("gyr_clipped",)),
        (10_000, 40, (40, 0, 0), ("gyr_clipped",)),
    ]
    # Behind a pause, or a loss, nothing is drawn.
    assert len(slow.add(*sample(begin_us + 90_000, 0))) == 1
    assert len(slow.add(*sample(begin_us + 110_000, 0), is_behind_gap=True)) == 1
    assert len(slow.add(*sample(begin_us + 130_000, 0))) == 4


def test_of_fast_ones_some_become_their_mean() -> None:
    fast = Resampler(1200)
    assert fast.rate_hz == 400
    begin_us = 2**32 - 1_000
    assert not fast.add(*sample(begin_us, 10))
    assert not fast.add(*sample(begin_us + 900, 40, has_mag=True))
    assert seen(fast.add(*sample(begin_us + 1_800, 70))) == [
        (2**32 - 100, 40, (40, 0, 0), ("gyr_clipped",))
    ]
    # A loss ends a group; what follows it says so itself.
    assert not fast.add(*sample(begin_us + 2_700, 10))
    behind, content = sample(begin_us + 9_000, 20)
    assert fast.add(behind, content, is_behind_gap=True) == (content,)
    assert not fast.add(*sample(begin_us + 9_900, 10))


def test_too_slow_ones_are_refused() -> None:
    with pytest.raises(
        ValueError, match="19 samples a second are too few; 20 are needed"
    ):
        Resampler(19)
    assert Resampler(149).rate_hz == 298
    assert Resampler(800).rate_hz == 800
