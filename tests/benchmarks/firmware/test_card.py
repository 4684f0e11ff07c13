# SPDX-License-Identifier: MIT
"""The comparison of the card's log with the wire's."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

from benchmarks.firmware import card

RAW, POSE, HELLO = card.IDS["raw"], card.IDS["pose"], card.IDS["hello"]


def contents(count: int, first: int = 0, sequence: int = 0) -> list[bytes]:
    """Raw and pose by turns, numbered on, each with a content of its own."""
    return [
        bytes([(RAW, POSE)[n % 2]])
        + (sequence + n).to_bytes(4, "little")
        + (first + n).to_bytes(4, "little")
        for n in range(count)
    ]


def compared(wire: list[bytes], kept: list[bytes]) -> int:
    sent, had = card.Counts(Counter()), card.Counts(Counter())
    return card.compare(sent.take(wire), had.take(kept))


def test_two_logs_are_equal_whatever_their_numbers() -> None:
    assert compared(contents(100), contents(100, sequence=7)) == 100


def test_what_power_kept_from_the_card_is_no_difference() -> None:
    assert compared(contents(100), contents(90)) == 90


def test_a_sample_may_have_been_sent_before_the_log_began() -> None:
    assert compared(contents(100), contents(98, first=2)) == 98
    with pytest.raises(card.ItDiffers, match="4 raw and poses were sent before"):
        compared(contents(102), contents(98, first=4))


@pytest.mark.parametrize("place", [1, 50, 99])
def test_a_byte_that_differs_is_told(place: int) -> None:
    kept = contents(100)
    kept[place] = kept[place][:-1] + b"\x01"
    with pytest.raises(card.ItDiffers, match=f"raw or pose {place} of the log"):
        compared(contents(100), kept)


def test_a_sample_that_is_missing_on_either_side_is_told() -> None:
    for is_of_wire in (True, False):
        one, other = contents(100), contents(100)
        del (one if is_of_wire else other)[40]
        with pytest.raises(card.ItDiffers, match="differs from the sent one"):
            compared(one, other)


def test_an_empty_card_and_another_probes_are_told() -> None:
    with pytest.raises(card.ItDiffers, match="no sample on the card"):
        compared(contents(10), [bytes([HELLO]) + bytes(20)])
    with pytest.raises(card.ItDiffers, match="never sent"):
        compared(contents(10), contents(10, first=1000))


def test_holes_in_the_numbers_are_counted() -> None:
    counts = card.Counts(Counter())
    assert len(list(counts.take(contents(10) + contents(5, sequence=13)))) == 15
    assert (counts.holes, counts.first, counts.last) == (3, 0, 17)


@pytest.mark.parametrize(
    ("change", "missed"),
    [
        ({}, []),
        ({"cut_off": 190}, []),
        ({"late": 1}, ["samples late"]),
        ({"missing_on_card": 2}, ["messages missing on the card"]),
        ({"cut_off": 191}, ["raw messages of the end that are not on the card"]),
        ({"complaints": 1}, ["complaints of the modelled chips"]),
    ],
)
def test_the_verdict(change: dict[str, Any], missed: list[str]) -> None:
    report = card.report_of(dict.fromkeys(card.SHOWN, 0) | change)
    assert [each.name for each in report.figures if each.verdict == "MISSED"] == missed
