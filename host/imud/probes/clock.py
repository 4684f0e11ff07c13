# SPDX-License-Identifier: MIT
"""A probe's clock against the host's, from causality alone. No I/O; time is an
argument, in us of the device and ns of `timeline.host_ns`.

A message arrives after it was made, and a command is heard after it was written: each
arrival is an upper bound of the host's time at a device time, each command with a reply
a lower bound. The estimate is between them, and its bound reaches to both. A late
message adds little and spoils nothing. docs/pose-details.md explains how.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from imud import _core
from imud._core import Line, Rising
from imud.probes.boot import difference_32

# Largest change of its rate, per second: a ceramic resonator of 30 ppm/K that warms by
# 4 K a minute.
DRIFT_MAX = 2e-6

# Points older than this add nothing: with DRIFT_MAX they are uncertain by 0.9 ms.
POINTS_KEPT_US = 30_000_000

# One point of each kind is kept in a bin. A bin is an eighth of the time since the
# first point, within these limits: short ones at first make the rate known early.
BIN_MIN_US, BIN_MAX_US = 20_000, 500_000

# Device time is in whole microseconds, rounded down.
QUANTUM_NS = 1_000

# A device time further ahead than this of those after it was damaged on the way.
LEAP_NS = 1_000_000_000

# What is known of the time before a longer silence is off by more than a new exchange:
# with DRIFT_MAX by 0.4 s.
SILENCE_US = 600_000_000

# An estimate that is later by more than this than a message of that time arrived is not
# approached slowly.
JUMP_NS = 100_000_000
# Late messages that are told; a busy machine reads the first ones late, too.
LATE_NS = 1_000_000_000


class Moment(NamedTuple):
    """The host's time of a device time."""

    host_ns: int
    bound_ns: int | None  # None: there is no lower bound


class Refit(NamedTuple):
    """An estimate that was wrong by more than its bound, and was begun anew."""

    step_ns: int  # by which the host's time of a device time has changed
    reason: str  # "late": older messages came late; "parted": a clock jumped


class _Estimate(NamedTuple):
    """The possible host times at and near a device time."""

    at_ns: int  # of the device
    middle_ns: int  # of the host
    rate: float  # host's nanoseconds in one of the device, less 1
    half_ns: float  # negative: there is no lower bound
    spread: float  # of the rate, to both sides

    def middle_at(self, device_us: int) -> int:
        step_ns = 1000 * device_us - self.at_ns
        return self.middle_ns + step_ns + round(self.rate * step_ns)

    def bound_at(self, device_us: int) -> float:
        """To both sides of the middle, in ns."""
        age_s = abs(1000 * device_us - self.at_ns) * 1e-9
        return self.half_ns + (self.spread + DRIFT_MAX * age_s / 2) * age_s * 1e9


_Point = tuple[int, int]  # device time, us; host's less device's, ns


class _Side:
    """The tightest points of one kind, one for each bin, by device time."""

    def __init__(self, sign: int) -> None:
        self._sign = sign  # 1: from above, so that less is tighter
        self.points: deque[_Point] = deque()
        self._bin_us = 0  # where the last point's bin begins

    def add(self, point: _Point, bin_us: int, rate: float) -> None:
        """`bin_us` is where the bin of this point begins."""
        if self.points and bin_us == self._bin_us:
            then = self.points[-1]
            gained = point[1] - then[1] - rate * 1000 * (point[0] - then[0])
            if self._sign * gained < 0:
                self.points[-1] = point
        elif not self.points or bin_us > self._bin_us:
            self.points.append(point)
            self._bin_us = bin_us

    def __bool__(self) -> bool:
        return bool(self.points)

    def forget(self, before_us: int) -> None:
        """Keeps the last point: it grows uncertain, but is better than none."""
        while len(self.points) > 1 and self.points[0][0] < before_us:
            self.points.popleft()


class ProbeClock:
    """The clock of one boot of a probe. `rate`: the last one known before."""

    def __init__(self, rate: float = 0.0) -> None:
        self.rate = rate
        self.exchanges = 0
        self.restarts = 0  # of the estimate, at points that contradict each other
        self.refits = 0  # of those, and others, how many are told
        self.refit = Refit(0, "")  # the latest
        self._known: _Estimate | None = None  # the latest
        self._known_restarts = 0  # before it
        self.t_us: int | None = None  # the latest, unrolled
        self._t_ns: int | None = None
        self._begin()
        self._forget_all()

    def _begin(self) -> None:
        self._rising = Rising()
        self._line = Line(self._rising, DRIFT_MAX, QUANTUM_NS)

    def _forget_all(self) -> None:
        self._above, self._below = _Side(1), _Side(-1)
        self._first_us: int | None = None
        self._bin_us = self._next_us = 0  # where this bin and the next one begin
        self._estimate: _Estimate | None = None

    def unroll(self, time_us: int, host_ns: int | None) -> int:
        """Device time beyond its 32 bits, which wrap after 71.6 minutes."""
        if self.t_us is None:
            unrolled = time_us
        else:
            expected = self.t_us
            if host_ns is not None and self._t_ns is not None:
                # The host's time tells how often it wrapped in a long silence.
                expected += (host_ns - self._t_ns) // 1000
            unrolled = expected + difference_32(time_us, expected)
        if self.t_us is None or unrolled > self.t_us:
            self.t_us, self._t_ns = unrolled, host_ns
        return unrolled

    def arrived(self, device_us: int, host_ns: int) -> None:
        """A message made at `device_us` or later was on the wire by `host_ns`."""
        is_fresh_bin = self._enter(device_us)
        point = device_us, host_ns - 1000 * device_us
        self._above.add(point, self._bin_us, self.rate)
        if is_fresh_bin or host_ns < self._line.middle(device_us):
            self._solve(device_us, point, None)
        self._update_line()
        estimate = self._estimate
        if (
            estimate is not None
            and estimate.half_ns >= 0
            and self._line.moment(device_us)[0] > host_ns + JUMP_NS
        ):
            self._begin()
            self._follow(estimate)
            self._update_line()
        self._compare(device_us)

    def date(self, device_us: int, host_ns: int) -> tuple[int, int | None]:
        """arrived(), and the moment() of it, which is not after its arrival."""
        moment = self._line.date(device_us, host_ns)
        if moment is None:
            self.arrived(device_us, host_ns)
            at_ns, bound_ns = moment = self._line.moment(device_us)
            if at_ns > host_ns:  # the estimate is not, only the way to it
                bound_ns = None if bound_ns is None else bound_ns - (at_ns - host_ns)
                moment = host_ns, bound_ns
        return moment

    def heard(self, device_us: int, host_ns: int) -> None:
        """At `device_us` the probe heard what was not sent before `host_ns`."""
        self.exchanges += 1
        is_fresh_bin = self._enter(device_us)
        is_bounded = self._estimate is not None and self._estimate.half_ns >= 0
        point = device_us, host_ns - QUANTUM_NS - 1000 * device_us
        self._below.add(point, self._bin_us, self.rate)
        if is_fresh_bin or not is_bounded or host_ns > self._line.middle(device_us):
            self._solve(device_us, None, point)
        self._update_line()
        self._compare(device_us)

    def moment(self, device_us: int) -> Moment:
        """The host's time of `device_us`. There must be an arrival before."""
        return Moment(*self._line.moment(device_us))

    @property
    def rate_ppm(self) -> float | None:
        """How fast the probe's clock runs; positive: too fast, None: not known yet."""
        estimate = self._estimate
        if estimate is None or estimate.half_ns < 0:
            return None
        return -1e6 * estimate.rate

    def _compare(self, device_us: int) -> None:
        """Notes that an estimate was wrong by more than its bound."""
        before, estimate = self._known, self._estimate
        if estimate is None or estimate is before:
            return
        is_contradicted = self.restarts != self._known_restarts
        self._known, self._known_restarts = estimate, self.restarts
        if before is None:
            return
        step_ns = estimate.middle_at(device_us) - before.middle_at(device_us)
        reason = "late" if before.half_ns < 0 else "parted"
        is_wrong = step_ns < -LATE_NS
        if reason == "parted":
            least_ns = max(before.bound_at(device_us), JUMP_NS)
            is_wrong = is_contradicted and abs(step_ns) > least_ns
        if is_wrong:
            self.refit = Refit(step_ns, reason)
            self.refits += 1

    def _update_line(self) -> None:
        """What the line answers from, until an arrival changes that."""
        self._line.know(
            self._next_us,
            self._above.points[-1] if self._above else None,
            self.rate,
            self._estimate,
        )

    def _enter(self, device_us: int) -> bool:
        """Whether a bin begins there."""
        if self._first_us is None:
            self._first_us = device_us
        elif device_us < self._next_us:
            return False
        elif device_us > self._next_us + SILENCE_US:
            self._forget_all()
            self._first_us = device_us
        self._bin_us = device_us
        width_us = (device_us - self._first_us) // 8
        self._next_us = device_us + min(max(width_us, BIN_MIN_US), BIN_MAX_US)
        return True

    def _solve(
        self, device_us: int, above: _Point | None, below: _Point | None
    ) -> None:
        """Estimates the host's time at `device_us`; begins again if the points
        contradict each other.
        """
        for side in (self._above, self._below):
            side.forget(device_us - POINTS_KEPT_US)
        if not self._above.points:
            return
        latest = (each.points[-1][0] for each in (self._above, self._below) if each)
        at_us = max(device_us, *latest)
        above_points, below_points = self._above.points, self._below.points
        reference = above_points[-1][1]
        found = _core.estimate(
            *(above_points, below_points, at_us, reference, self.rate, DRIFT_MAX)
        )
        if found is not None:
            self._follow(_Estimate(*found))
            return
        # The latest point holds, whatever was wrong with the earlier ones.
        self.restarts += 1
        self._forget_all()
        if self._rising.is_beyond(1000 * device_us + LEAP_NS):
            self._begin()
            self.t_us, self._t_ns = device_us, None
        self._enter(device_us)
        for side, point in ((self._above, above), (self._below, below)):
            if point is not None:
                side.add(point, self._bin_us, self.rate)
        self._solve(device_us, None, None)

    def _follow(self, estimate: _Estimate) -> None:
        self._estimate = estimate
        if estimate.half_ns >= 0:
            self.rate = estimate.rate
        else:
            # It only gets earlier by a message that arrives, whose time it is: times
            # don't fall, and what was later need not be approached.
            self._begin()
        self._rising.turn(estimate.at_ns, estimate.middle_ns, estimate.rate)
