# SPDX-License-Identifier: MIT
"""Debouncing: one event a change of the button, none for its bounce."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import native

pytestmark = pytest.mark.sampled(3)

ffi, lib = native.load()

NONE, PRESSED, RELEASED = lib.BUTTON_NONE, lib.BUTTON_PRESSED, lib.BUTTON_RELEASED
STABLE_US = lib.BUTTON_STABLE_US
STEP_US = 500


class Pin:
    """A level over time, made of edges."""

    def __init__(self, edges: Iterable[int] = (), is_down: bool = False) -> None:
        self.edges = sorted(edges)
        self.starts_down = is_down

    def at(self, time_us: int) -> bool:
        passed = sum(edge <= time_us for edge in self.edges)
        return self.starts_down ^ (passed % 2 == 1)


def events(
    pin: Pin, times: Iterable[int], button: Any = None, start_us: int = 0
) -> list[tuple[int, int]]:
    """Step at each of the times; return what happened and when."""
    button = button or ffi.new("struct button *")
    happened = []
    for time_us in times:
        now_us = (time_us + start_us) & 0xFFFFFFFF
        event = lib.button_step(button, pin.at(time_us), now_us)
        if event != NONE:
            happened.append((event, time_us))
    return happened


def kinds(happened: list[tuple[int, int]]) -> list[int]:
    return [event for event, _ in happened]


@pytest.mark.parametrize(("length_us", "counts"), [(49_999, False), (50_000, True)])
def test_a_level_counts_from_fifty_milliseconds_on(length_us, counts):
    pin = Pin([0, length_us + 1])
    happened = events(pin, range(0, 200_000, 1))
    assert kinds(happened) == ([PRESSED, RELEASED] if counts else [])


def test_a_button_held_at_boot_is_a_press():
    happened = events(Pin(is_down=True), range(0, 300_000, STEP_US))
    assert happened == [(PRESSED, STABLE_US)]


def test_a_button_left_alone_is_nothing():
    assert events(Pin(), range(0, 1_000_000, STEP_US)) == []


def test_a_press_held_for_hours_is_one_event():
    button = ffi.new("struct button *")
    pin = Pin([0])
    happened = events(pin, range(0, 100_000, STEP_US), button)
    for hour in range(4):
        start_us = 100_000 + hour * 3_600_000_000
        happened += events(pin, range(start_us, start_us + 10**6, 5000), button)
    assert kinds(happened) == [PRESSED]


@pytest.mark.parametrize("before_us", range(0, 600_000, 7000))
def test_time_may_wrap_at_any_moment(before_us):
    pin = Pin([100_000, 101_000, 102_000, 300_000, 310_000, 320_000])
    times = range(0, 600_000, STEP_US)
    shifted = events(pin, times, start_us=2**32 - before_us)
    assert shifted == events(pin, times)


def test_stretches_that_nobody_watched_do_not_count_as_stable():
    # Two glitches of 1 ms, 60 ms apart, seen by steps 60 ms apart.
    pin = Pin([0, 1000, 60_000, 61_000])
    assert events(pin, [0, 60_000, 120_000, 180_000]) == []


def test_rare_steps_make_an_event_later_but_not_lost():
    happened = events(Pin([0]), range(0, 1_000_000, 30_000))
    assert happened == [(PRESSED, 150_000)]


bounces = st.lists(st.integers(1, STABLE_US - 1), max_size=40, unique=True).map(sorted)
steps = st.lists(st.integers(100, 10_000), min_size=1, max_size=50)


def irregular(gaps: list[int], end_us: int) -> list[int]:
    """Return times from 0 on, by these gaps over and over."""
    times, time_us = [], 0
    while time_us < end_us:
        times.append(time_us)
        time_us += gaps[len(times) % len(gaps)]
    return times


@given(make=bounces, release=bounces, gaps=steps, start_us=st.integers(0, 2**32 - 1))
def test_any_bounce_below_50_ms_gives_exactly_one_event(make, release, gaps, start_us):
    # From the first edge on an even number more, so that the level ends changed.
    make = make[: len(make) // 2 * 2]
    release = release[: len(release) // 2 * 2]
    edges = [20_000 + edge for edge in (0, *make)]
    edges += [300_000 + edge for edge in (0, *release)]
    happened = events(Pin(edges), irregular(gaps, 600_000), start_us=start_us)
    assert kinds(happened) == [PRESSED, RELEASED]


@given(bounce=bounces, gaps=steps, is_down=st.booleans())
def test_bounce_alone_never_toggles(bounce, gaps, is_down):
    edges = bounce[: len(bounce) // 2 * 2]
    pin = Pin([200_000 + edge for edge in edges], is_down)
    happened = events(pin, irregular(gaps, 500_000))
    assert kinds(happened) == ([PRESSED] if is_down else [])


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 2**32 - 1)), max_size=200))
def test_press_and_release_alternate_whatever_comes(seen):
    button = ffi.new("struct button *")
    happened = [lib.button_step(button, level, now_us) for level, now_us in seen]
    changes = [event for event in happened if event != NONE]
    expected = [PRESSED, RELEASED] * len(changes)
    assert changes == expected[: len(changes)]
