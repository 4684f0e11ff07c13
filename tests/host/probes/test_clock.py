# SPDX-License-Identifier: MIT
"""A probe's clock as the host sees it, over links that are late."""

from __future__ import annotations

import itertools
import random
from dataclasses import dataclass, field, replace
from heapq import heapify, heappop, heappush

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes import FakeProbe
from imud.daemon.commands import Asking
from imud.probes.clock import POINTS_KEPT_US, Moment, ProbeClock, Refit
from imud.probes.record import Stamp
from imud.probes.session import Probe, Received, Session
from length import choose

pytestmark = pytest.mark.sampled(2)

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
    """The timing of one pose."""

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
    clock: ProbeClock = field(default_factory=ProbeClock)

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
        stamps: list[tuple[int, int, int, int | None]] = []
        for true in range(begin, end, SECOND // link.pose_hz):
            late = link.pose_ns + rng.randrange(MS)
            stamps.append((arrival(true + late), true, 0, None))
        for true in range(begin + SECOND // 3, end, SECOND // 2):  # hello, status
            stamps.append((arrival(true), true, 1, None))
        heapify(stamps)
        asking = Asking(rng)
        asking.put_off((begin + SECOND // 20) * 1e-9)
        poses: list[Heard] = []
        last_came, moment = 0, Moment(0, None)
        while stamps:
            due_s = asking.due_s(Stamp(1, 0, 0, 0, moment.bound_ns))
            due_ns = round(due_s * 1e9)
            if due_ns < min(stamps[0][0], end):
                made = self._heard_at(due_ns + rng.randrange(link.write_ns))
                heappush(stamps, (arrival(made), made, 2, due_ns))
                asking.unanswered = 0
                asking.put_off(due_s)
                continue
            came, made, kind, written = heappop(stamps)
            host_ns = last_came = max(came, last_came)
            wrapped = self.device_us(made) & 0xFFFFFFFF
            device_us = self.clock.unroll(wrapped, host_ns)
            assert device_us == self.device_us(made)
            moment = Moment(*self.clock.date(device_us, host_ns))
            assert moment.host_ns <= host_ns
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
    clock = ProbeClock()
    clock.arrived(1000, 5 * MS)
    clock.arrived(3000, 6 * MS)
    assert clock.moment(3000) == Moment(6 * MS, None)
    assert clock.rate_ppm is None


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
    assert first > 5 * MS
    assert all(abs(p.error_ns) <= (p.moment.bound_ns or 0) for p in again)
    assert max(abs(p.error_ns) for p in again[1000:]) < MS
    assert run.clock.restarts == 0


# A host that stands still for 40 s, without a clock that counts that, looks the same as
# a probe whose clock gains them; a probe that stands still, as one that loses them.
@pytest.mark.parametrize("by_us", [-40_000_000, -40_000, 40_000, 40_000_000])
def test_a_device_clock_that_jumps_is_followed_and_counted(by_us: int) -> None:
    run = Run(Link(drift_ppm_s=0.0))
    run.go(15.0)
    run.link = replace(run.link, start_us=run.link.start_us + by_us)
    poses = run.go(25.0, from_s=15.1)
    assert run.clock.restarts > 0
    assert all(p.moment.bound_ns is not None for p in poses if p.true_ns > 16 * SECOND)
    assert max(abs(p.error_ns) for p in poses if p.true_ns > 30 * SECOND) < MS
    is_told = abs(by_us) > 100_000
    assert run.clock.refits == is_told
    if is_told:
        assert run.clock.refit == Refit(
            pytest.approx(-1000 * by_us, abs=SECOND), "parted"
        )
    later = [p for p in poses if p.true_ns > (16 if is_told else 30) * SECOND]
    assert all(abs(p.error_ns) <= (p.moment.bound_ns or 0) for p in later)


@pytest.mark.parametrize("answers", [True, False])
@pytest.mark.parametrize("gone_s", [4, 60, 3600])
def test_old_messages_that_come_first_do_not_fix_the_time(
    gone_s: int, answers: bool
) -> None:
    clock, begun_us = ProbeClock(), 7_000_000
    now_ns, then_us = 100 * SECOND, begun_us
    ages = []
    for i in range(150):  # what a port of 8 KB had kept
        host_ns, bound_ns = clock.date(then_us + 10_000 * i, now_ns + 1000 * i)
        assert host_ns <= now_ns + 1000 * i
        assert bound_ns is None
    for i in range(200):
        true_ns = now_ns + SECOND // 2 + 10 * MS * i
        device_us = begun_us + gone_s * 1_000_000 + 10_000 * i
        host_ns, bound_ns = clock.date(device_us, true_ns + MS)
        ages.append(true_ns + MS - host_ns)
        if answers and i % 10 == 1:
            clock.heard(device_us, true_ns - MS)
        if bound_ns is not None:
            assert abs(host_ns - true_ns) <= bound_ns
    assert min(ages) >= 0
    assert max(ages) < 5 * MS
    assert clock.refit.reason == "late"
    assert clock.refit.step_ns == pytest.approx(-gone_s * SECOND, abs=2 * SECOND)


def test_the_time_before_a_night_says_nothing_of_that_after_it() -> None:
    run = Run(Link(drift_ppm_s=0.0))
    run.go(20.0)
    # The oscillator cooled meanwhile: it is 2 s late, which no bound should have to
    # cover, and it says nothing until it was asked.
    run.link = replace(run.link, start_us=run.link.start_us - 2_000_000)
    again = run.go(5.0, from_s=20.0 + 8 * 3600)
    known = [p for p in again if p.moment.bound_ns is not None]
    assert len(known) > len(again) - 20
    assert max(p.moment.bound_ns or 0 for p in known) < 5 * MS
    assert all(abs(p.error_ns) <= (p.moment.bound_ns or 0) for p in known)
    assert run.clock.refits == 0


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
    run.go(3 * POINTS_KEPT_US / 1e6)
    assert len(run.clock._above.points) < 120
    assert len(run.clock._below.points) < 60


# A silence, whether a reboot ends it, and by how much the probe's clock is fast.
GAPS_S = st.lists(
    st.tuples(st.integers(1200, 3600), st.booleans(), st.integers(-10_000, 10_000)),
    min_size=1,
    max_size=40,
)
DAYS_10_S = 10 * 24 * 3600


@pytest.mark.long
@settings(max_examples=choose(everyday=10, long=100))
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
