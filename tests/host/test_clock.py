# SPDX-License-Identifier: MIT
"""A probe's clock against the host's, on modelled links in virtual time."""

from __future__ import annotations

import itertools
import json
import queue
import random
import re
import select
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from heapq import heapify, heappop, heappush
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes import PATIENCE_S, DaemonProcess, FakeProbe, Port
from imud.client import Client
from imud.daemon.commands import Asking
from imud.probes.clock import WINDOW_US, Clock, Moment
from imud.probes.record import Stamp
from imud.probes.session import Probe, Received, Session
from imud.probes.timeline import READING_NS, Rising, Timeline
from length import choose

SECOND = 1_000_000_000
MS = 1_000_000


@dataclass(frozen=True)
class Link:
    """A probe, its clock's error, and what is between it and the host."""

    ppm: float = 200.0
    drift_ppm_s: float = 1.0
    batch_ns: int = 0  # a USB adapter hands over what it has at whole multiples
    burst_ns: int = 0  # so long nothing comes, at random once a second
    jitter_ns: int = MS // 10  # to the host, at random
    write_ns: int = MS  # from the host, at random, up to
    busy_ns: int = 3 * MS  # of each 5 ms a Nano works on a sample and hears nothing
    pose_ns: int = 4 * MS  # from a sample to its pose on the wire, at least
    pose_hz: int = 100
    start_us: int = 5_000_000  # device time at host time 0
    seed: int = 1


@dataclass
class Heard:
    """What came of one pose."""

    true_ns: int
    host_ns: int
    moment: Moment
    device_us: int

    @property
    def error_ns(self) -> int:
        return self.moment.host_ns - self.true_ns


@dataclass
class Run:
    link: Link
    clock: Clock = field(default_factory=Clock)

    def device_us(self, true_ns: float) -> int:
        s = true_ns * 1e-9
        error = self.link.ppm * 1e-6 * s + self.link.drift_ppm_s * 1e-6 * s * s / 2
        return self.link.start_us + int((s + error) * 1e6)

    def go(self, seconds: float, *, from_s: float = 0.0) -> list[Heard]:
        """All poses, in order, while commands come ten times in the first second."""
        link, rng = self.link, random.Random(self.link.seed)  # noqa: S311
        begin = int(from_s * 1e9)
        end = begin + int(seconds * 1e9)
        stalls = [
            s * SECOND + rng.randrange(SECOND - link.burst_ns)
            for s in range(begin // SECOND, end // SECOND + 2)
        ]

        def arrival(sent_ns: int) -> int:
            at = sent_ns + rng.randrange(link.jitter_ns + 1)
            for stall in stalls:
                if stall <= at < stall + link.burst_ns:
                    at = stall + link.burst_ns
            return -(-at // link.batch_ns) * link.batch_ns if link.batch_ns else at

        # Came, made, kind, and when the command was written that it answers.
        said: list[tuple[int, int, int, int | None]] = []
        for true in range(begin, end, SECOND // link.pose_hz):
            late = link.pose_ns + rng.randrange(MS)
            said.append((arrival(true + late), true, 0, None))
        for true in range(begin + SECOND // 3, end, SECOND // 2):  # hello, status
            said.append((arrival(true), true, 1, None))
        heapify(said)
        asking = Asking(rng)
        asking.due_s = (begin + SECOND // 10) * 1e-9
        poses: list[Heard] = []
        last_came, moment = 0, Moment(0, None)
        while said:
            due_ns = round(asking.due_s * 1e9)
            if due_ns < min(said[0][0], end):
                made = self._heard_at(due_ns + rng.randrange(link.write_ns))
                heappush(said, (arrival(made), made, 2, due_ns))
                asking.unanswered = 0
                stamp = Stamp(1, 0, 0, 0, moment.bound_ns)
                asking.put_off(stamp, asking.due_s)
                continue
            came, made, kind, written = heappop(said)
            host_ns = last_came = max(came, last_came)
            wrapped = self.device_us(made) & 0xFFFFFFFF
            device_us = self.clock.unroll(wrapped, host_ns)
            assert device_us == self.device_us(made)
            self.clock.arrived(device_us, host_ns)
            moment = self.clock.moment(device_us)
            if written is not None:
                self.clock.heard(device_us, written)
            if kind == 0:
                poses.append(Heard(made, host_ns, moment, device_us))
        return poses

    def _heard_at(self, came_ns: int) -> int:
        """When the probe hears a command that came: once a sample's work is over."""
        return max(came_ns, came_ns - came_ns % (5 * MS) + self.link.busy_ns)


LINKS = {
    "a wire": Link(),
    "no drift": Link(ppm=-200.0, drift_ppm_s=0.0),
    "cooling": Link(drift_ppm_s=-1.0),
    "USB batches of 16 ms": Link(batch_ns=16 * MS),
    "bursts of 100 ms": Link(burst_ns=100 * MS),
    "batches and bursts": Link(batch_ns=16 * MS, burst_ns=100 * MS),
    "jitter of 5 ms": Link(jitter_ns=5 * MS),
    "slow to the probe": Link(write_ns=3 * MS, jitter_ns=1000),
    "an RC oscillator": Link(ppm=9_000.0, drift_ppm_s=1.5),
    "a slow probe": Link(pose_hz=5, batch_ns=16 * MS),
}


@pytest.mark.parametrize("link", LINKS.values(), ids=LINKS)
@pytest.mark.parametrize("seed", range(3))
def test_a_pose_is_timed_to_a_millisecond_and_its_bound_holds(
    link: Link, seed: int
) -> None:
    run = Run(replace(link, seed=seed))
    poses = run.go(60.0)
    later = [pose for pose in poses if pose.true_ns > 10 * SECOND]
    assert max(abs(pose.error_ns) for pose in later) < MS
    bounded = [pose for pose in poses if pose.moment.bound_ns is not None]
    assert len(bounded) > 0.98 * len(poses)
    honest = sum(abs(p.error_ns) <= (p.moment.bound_ns or 0) for p in bounded)
    assert honest == len(bounded)
    assert max(pose.moment.bound_ns or 0 for pose in later) < 5 * MS
    times = [pose.moment.host_ns for pose in poses]
    assert times == sorted(times)
    assert run.clock.restarts == 0
    truth_ppm = link.ppm + link.drift_ppm_s * 60
    assert run.clock.rate_ppm == pytest.approx(truth_ppm, abs=100)


def test_before_the_first_answer_there_is_a_time_and_no_bound() -> None:
    clock = Clock()
    clock.arrived(1000, 5 * MS)
    clock.arrived(3000, 6 * MS)
    assert clock.moment(3000) == Moment(6 * MS, None)
    assert clock.rate_ppm is None


def test_device_time_goes_on_over_days() -> None:
    clock = Run(Link()).clock
    t_us = 0
    for minutes in range(0, 60 * 24 * 5, 50):
        device_us = minutes * 60_000_000
        t_us = clock.unroll(device_us & 0xFFFFFFFF, device_us * 1000)
        assert t_us == device_us
    away_us = t_us + 7 * 2**32 + 12345
    assert clock.unroll(away_us & 0xFFFFFFFF, away_us * 1000 + 3 * SECOND) == away_us


def test_a_wrap_changes_nothing() -> None:
    run = Run(Link(start_us=2**32 - 15_000_000))
    later = [p for p in run.go(40.0) if p.true_ns > 10 * SECOND]
    assert max(abs(pose.error_ns) for pose in later) < MS
    assert run.clock.restarts == 0


def test_a_long_silence_widens_the_bound_and_costs_no_honesty() -> None:
    run = Run(Link())
    run.go(20.0)
    again = run.go(20.0, from_s=300.0)
    first = again[0].moment.bound_ns
    assert first is not None
    assert first > 5 * MS
    assert all(abs(p.error_ns) <= (p.moment.bound_ns or 0) for p in again)
    assert max(abs(p.error_ns) for p in again[1000:]) < MS
    assert run.clock.restarts == 0


@pytest.mark.parametrize("by_us", [-40_000, 40_000])
def test_a_device_clock_that_jumps_is_followed_and_counted(by_us: int) -> None:
    run = Run(Link(drift_ppm_s=0.0))
    run.go(15.0)
    run.link = replace(run.link, start_us=run.link.start_us + by_us)
    poses = run.go(25.0, from_s=15.1)
    later = [p for p in poses if p.true_ns > 30 * SECOND]
    assert run.clock.restarts > 0
    assert max(abs(p.error_ns) for p in later) < MS
    assert all(abs(p.error_ns) <= (p.moment.bound_ns or 0) for p in later)


def test_one_impossible_device_time_does_not_stay() -> None:
    run = Run(Link(drift_ppm_s=0.0))
    run.go(15.0)
    wrong_us = run.device_us(15 * SECOND) + 900_000_000
    run.clock.arrived(run.clock.unroll(wrong_us, 15 * SECOND), 15 * SECOND)
    run.clock.moment(wrong_us)
    later = [p for p in run.go(25.0, from_s=15.1) if p.true_ns > 26 * SECOND]
    assert run.clock.restarts > 0
    assert max(abs(p.error_ns) for p in later) < MS


def test_memory_does_not_grow() -> None:
    run = Run(Link(drift_ppm_s=0.0))
    run.go(3 * WINDOW_US / 1e6)
    assert len(run.clock._above.points) < 120
    assert len(run.clock._below.points) < 60


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


def said_under(
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


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=SETTINGS)
def test_when_utc_is_set_no_time_falls_and_each_bound_holds(setting: Setting) -> None:
    sampled, stamps, timeline = said_under(setting, 60)
    times = [stamp.t_ns or 0 for stamp in stamps]
    assert times == sorted(times)
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
    elif setting.step_ns > 0:
        # Those alone that were taken before it was known.
        assert max(wide) - min(wide) < 30 * MS
    else:
        # A tenth of the time is made up: ten times the step.
        until_ns = min(STEPPED_NS - 10 * setting.step_ns, 60 * SECOND)
        assert max(wide) == pytest.approx(until_ns, abs=30 * MS)


SETTABLE = """
import signal, sys, time
from imud.cli import program

read, steps = time.time_ns, []
time.time_ns = lambda: read() + sum(steps)
signal.signal(signal.SIGUSR1, lambda *_: steps.append(3600 * 10**9))
signal.signal(signal.SIGUSR2, lambda *_: steps.append(-(10**9)))
sys.argv[0] = "imud"
program()
"""


def test_a_running_daemon_says_that_utc_was_set_and_goes_on(tmp_path: Path) -> None:
    script = tmp_path / "settable.py"
    script.write_text(SETTABLE)
    probe, port = FakeProbe(), Port(tmp_path / "port")
    program = (str(script),)
    heard: queue.Queue[dict[str, Any]] = queue.Queue()
    # Real UTC just before and after each pose was sampled, by its number on the wire.
    sampled: dict[int, tuple[int, int]] = {}

    def device_us() -> int:
        return time.monotonic_ns() // 1000 & 0xFFFFFFFF

    def speak(count: int) -> list[dict[str, Any]]:
        """So many poses, one in 5 ms, with answers in between; what came of them."""
        for _ in range(count):
            before_ns = time.time_ns()
            probe.time_us = device_us()
            sampled[probe.sequence] = before_ns, time.time_ns()
            port.write(probe.say("pose"))
            select.select([port.master], [], [], 0.005)
            probe.time_us = device_us()
            port.write(port.answers(probe))
        return [heard.get(timeout=PATIENCE_S) for _ in range(count)]

    with DaemonProcess(port.path, directory=tmp_path, program=program) as daemon:
        port.wait_open()
        probe.time_us = device_us()
        port.write(b"\0" + probe.say("hello"))
        daemon.expect("found on")
        with Client(daemon.endpoint) as client:
            clocks: queue.Queue[dict[str, Any]] = queue.Queue()
            statuses: queue.Queue[dict[str, Any]] = queue.Queue()
            for topic, into in (("pose", heard), ("clock", clocks)):
                client.subscribe(topic, None, taker(into))
            client.statuses()  # then the router knows who subscribes
            before = speak(200)
            daemon.process.send_signal(signal.SIGUSR1)
            while clocks.empty():
                before += speak(1)
            on = clocks.get()
            after = speak(100)
            daemon.process.send_signal(signal.SIGUSR2)
            client.subscribe("status", None, taker(statuses))
            while clocks.empty():
                after += speak(1)
            back = clocks.get()
            late = speak(100)
            while (status := statuses.get(timeout=PATIENCE_S))["clock"][
                "host_steps"
            ] < 2:
                late += speak(10)
        lines = [daemon.expect(re.escape(what)) for what in ("+3600.0", "-1.0")]
        daemon.stop()
    port.vanish()
    assert on["step_ns"] == pytest.approx(HOUR, abs=100 * MS)
    assert back["step_ns"] == pytest.approx(-SECOND, abs=100 * MS)
    assert "time stamps follow slowly" in lines[1]
    assert "time stamps follow slowly" not in lines[0]
    poses = before + after + late
    times = [pose["t_ns"] for pose in poses]
    assert times == sorted(times)
    for pose in poses[100:]:
        bound_ns = 1000 * pose["t_bound_us"]
        earliest, latest = sampled[pose["seq"]]
        assert any(
            earliest - bound_ns <= pose["t_ns"] - set_ns <= latest + bound_ns
            for set_ns in (0, HOUR, HOUR - SECOND)
        )
    assert after[-1]["t_ns"] - sampled[after[-1]["seq"]][0] > HOUR - SECOND
    # Of the second, a tenth of the time since is made up.
    assert 300_000 < late[0]["t_bound_us"] < 1_100_000
    assert status["clock"]["host_ahead_ns"] > SECOND // 3
    assert status["state"] != "silent"


def taker(into: queue.Queue[dict[str, Any]]) -> Callable[[str, bytes], None]:
    return lambda _, payload: into.put(json.loads(payload))


# A silence, whether a reboot ends it, and by how much the probe's clock is fast.
GAPS_S = st.lists(
    st.tuples(st.integers(1200, 3600), st.booleans(), st.integers(-10_000, 10_000)),
    min_size=1,
    max_size=40,
)
DAYS_10_S = 10 * 24 * 3600


@pytest.mark.long
@settings(max_examples=choose(everyday=25, long=100))
@given(GAPS_S, st.integers(0, 2**32 - 1))
def test_ten_days_of_silences_and_reboots_are_unrolled(
    gaps: list[tuple[int, bool, int]], began_us: int
) -> None:
    probe, known = FakeProbe(), Probe(FakeProbe().name)
    session = Session(lambda _: known, 0)
    host_ns, device_us = SECOND, float(began_us)

    def say(name: str) -> None:
        probe.time_us = int(device_us) & 0xFFFFFFFF
        (stamp,) = (
            each.stamp
            for each in session.receive(probe.say(name), host_ns)
            if isinstance(each, Received)
        )
        assert stamp.t_device_us == int(device_us)

    session.receive(b"\0", host_ns)
    say("hello")
    for gap_s, is_reboot, ppm in itertools.cycle(gaps):
        if host_ns > DAYS_10_S * SECOND:
            return
        host_ns += gap_s * SECOND
        device_us += gap_s * (1e6 + ppm)
        if is_reboot:
            probe.restart()
            device_us = 5.0
            say("hello")
        for name in ("pose", "status"):
            host_ns += 5 * MS
            device_us += 5000
            say(name)
