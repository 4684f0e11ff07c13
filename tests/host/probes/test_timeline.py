# SPDX-License-Identifier: MIT
"""UTC that never falls within a timeline, whatever is done to the host's clock."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes import FakeProbe
from imud._core import Rising
from imud.probes.record import Stamp
from imud.probes.session import Probe, Received, Session
from imud.probes.timeline import BACK_MAX_NS, READING_NS, Timeline

SECOND = 1_000_000_000
MS = 1_000_000

TURNS = st.lists(
    st.tuples(
        st.integers(-5000, 20_000), st.integers(-9000, 9000), st.floats(-0.02, 0.02)
    ),
    max_size=30,
)


@given(TURNS, st.lists(st.integers(-3000, 3000), min_size=30, max_size=30))
def test_a_rising_function_never_falls_whatever_it_is_told(
    turns: list[tuple[int, int, float]], late: list[int]
) -> None:
    rising = Rising()
    rising.turn(0, 0, 0.0)
    asked: dict[int, int] = {}
    x = 0
    for (step, error, rate), back in zip(turns, late, strict=False):
        rising.turn(x + step, x + step + error, rate)
        x += abs(step) // 3
        for at in (x, x + back):
            asked.setdefault(at, rising.at(at))
    # So long as no more pieces came in between than are kept.
    if len(turns) < 15:
        inside = [asked[at] for at in sorted(asked) if at >= 0]
        assert inside == sorted(inside)


def ahead(timeline: Timeline, host_ns: int) -> int:
    return timeline.ahead(host_ns, timeline.utc(host_ns))


def test_utc_follows_a_step_forwards_at_once() -> None:
    timeline = Timeline(1000 * SECOND)
    assert timeline.utc(SECOND) == 1001 * SECOND
    assert timeline.follow(SECOND, 1001 * SECOND, SECOND) == 0
    assert timeline.follow(2 * SECOND, 1005 * SECOND, 2 * SECOND) == 3 * SECOND
    assert timeline.utc(2 * SECOND + 1) == 1005 * SECOND + 1
    assert timeline.utc(SECOND) == 1001 * SECOND
    assert (timeline.steps, timeline.last_step_ns) == (1, 3 * SECOND)
    assert ahead(timeline, 2 * SECOND + 1) == 0


def test_utc_makes_up_a_step_backwards_without_running_back() -> None:
    timeline = Timeline(1000 * SECOND)
    timeline.utc(2 * SECOND)
    assert timeline.follow(2 * SECOND, 1001 * SECOND, 2 * SECOND) == -SECOND
    times = [timeline.utc(2 * SECOND + i * 100 * MS) for i in range(150)]
    assert times == sorted(times)
    assert times[0] == 1002 * SECOND
    assert ahead(timeline, 2 * SECOND) == SECOND
    assert ahead(timeline, 7 * SECOND) == pytest.approx(SECOND // 2, abs=2)
    assert timeline.utc(13 * SECOND) == 1012 * SECOND
    assert ahead(timeline, 13 * SECOND) == 0


def test_utc_that_was_set_back_by_far_begins_a_timeline_at_once() -> None:
    timeline = Timeline(1_000_000 * SECOND)
    timeline.utc(2 * SECOND)
    day = 86_400 * SECOND
    at = 2 * SECOND
    assert timeline.follow(at, 1_000_002 * SECOND - day, at) == -day
    for later in (0, 1, SECOND, day):
        assert timeline.utc(at + later) == 1_000_002 * SECOND - day + later
        assert ahead(timeline, at + later) == 0
    assert (timeline.number, timeline.steps) == (2, 1)


def test_a_clock_that_is_slewed_is_followed_and_no_step_is_told() -> None:
    timeline = Timeline(1000 * SECOND)
    assert timeline.follow(SECOND, 1001 * SECOND, SECOND) == 0
    ahead_ns = READING_NS + 1
    assert timeline.follow(2 * SECOND, 1002 * SECOND + ahead_ns, 2 * SECOND) == 0
    assert timeline.utc(2 * SECOND + 1) == 1002 * SECOND + ahead_ns + 1
    assert (timeline.steps, timeline.last_step_ns) == (0, 0)


def test_a_reading_that_took_long_is_left_out() -> None:
    timeline = Timeline(0)
    assert timeline.follow(0, SECOND, READING_NS + 1) == 0
    assert timeline.follow(0, READING_NS, 0) == 0
    assert timeline.steps == 0


@dataclass(frozen=True)
class Setting:
    """What NTP does to a host's UTC at STEPPED_NS: a step, or a slew for 20 s."""

    step_ns: int = 0
    slew_ppm: int = 0

    def utc(self, host_ns: int) -> int:
        since_ns = max(0, host_ns - STEPPED_NS)
        step_ns = self.step_ns if since_ns else 0
        slewed_ns = min(since_ns, 20 * SECOND) * self.slew_ppm // 1_000_000
        return 1_700_000_000 * SECOND + host_ns + step_ns + slewed_ns


HOUR = 3600 * SECOND
STEPPED_NS = 15 * SECOND + 3 * MS + 7
SETTINGS = {
    "a second on": Setting(step_ns=SECOND),
    "a second back": Setting(step_ns=-SECOND),
    "an hour on": Setting(step_ns=HOUR),
    "an hour back": Setting(step_ns=-HOUR),
    "2 ms on": Setting(step_ns=2 * MS),
    "2 ms back": Setting(step_ns=-2 * MS),
    "a slew on": Setting(slew_ppm=500),
    "a slew back": Setting(slew_ppm=-500),
}


def measured_under(
    setting: Setting, seconds: int
) -> tuple[list[int], list[Stamp], Timeline]:
    """When each pose was sampled, in the host's time; what was said of it."""
    probe, known = FakeProbe(), Probe(FakeProbe().name)
    timeline = Timeline(setting.utc(0))
    session = Session(lambda _: known, 0, timeline=timeline)
    session.receive(b"\0" + probe.say("hello"), MS)
    sampled: list[int] = []
    stamps: list[Stamp] = []
    for number in range(1, 100 * seconds):
        at_ns = number * 10 * MS
        if number % 100 == 20:
            known.clock.heard(at_ns // 1000, at_ns - MS // 10)
        probe.time_us = at_ns // 1000
        came_ns = at_ns + 5 * MS if number % 100 else at_ns + MS // 10
        timeline.follow(came_ns, setting.utc(came_ns), came_ns)
        (event,) = session.receive(probe.say("pose"), came_ns)
        assert isinstance(event, Received)
        sampled.append(at_ns)
        stamps.append(event.stamp)
    return sampled, stamps, timeline


@pytest.mark.sampled(2)
@pytest.mark.parametrize("setting", SETTINGS.values(), ids=SETTINGS)
def test_when_utc_is_set_no_time_falls_and_each_bound_holds(setting: Setting) -> None:
    sampled, stamps, timeline = measured_under(setting, 60)
    times = [stamp.t_ns or 0 for stamp in stamps]
    falls = [a for a, b in itertools.pairwise(times) if b < a]
    assert timeline.number == 1 + len(falls)
    assert len(falls) == (1 if setting.step_ns < -BACK_MAX_NS else 0)
    bounds = [stamp.t_bound_ns for stamp in stamps]
    for at_ns, t_ns, bound_ns in zip(sampled, times, bounds, strict=True):
        if bound_ns is not None:
            assert abs(t_ns - setting.utc(at_ns)) <= bound_ns
    wide = [
        at_ns
        for at_ns, bound_ns in zip(sampled, bounds, strict=True)
        if at_ns > 10 * SECOND and (bound_ns is None or bound_ns > 1.5 * MS)
    ]
    assert timeline.steps == (1 if setting.step_ns else 0)
    assert timeline.last_step_ns == pytest.approx(setting.step_ns, abs=READING_NS)
    if setting.slew_ppm:
        assert wide == []
    elif setting.step_ns > 0 or falls:
        # Those alone that were taken before it was known.
        assert max(wide) - min(wide) < 30 * MS
    else:
        # A tenth of the time is made up: ten times the step.
        until_ns = min(STEPPED_NS - 10 * setting.step_ns, 60 * SECOND)
        assert max(wide) == pytest.approx(until_ns, abs=30 * MS)
