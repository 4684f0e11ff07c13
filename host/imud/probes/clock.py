# SPDX-License-Identifier: MIT
"""A probe's clock against the host's, from causality alone. No I/O; time is an
argument, in us of the device and ns of `timeline.host_ns`.

A message arrives after it was made, and a command is heard after it was written: each
arrival is an upper bound of the host's time at a device time, each command with a reply
a lower bound. The estimate is between them, and its bound reaches to both. A late
message adds little and spoils nothing. docs/clock.md has the arithmetic.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import msgspec

from imud.probes.boot import difference_32
from imud.probes.timeline import Rising

# Largest error of the probe's oscillator: 1 % for an RC oscillator, 0.5 % for a ceramic
# resonator, 0.01 % for a crystal.
RATE_MAX = 0.02

# Largest change of its rate, per second: a ceramic resonator of 30 ppm/K that warms by
# 4 K a minute.
DRIFT_MAX = 2e-6

# Points older than this add nothing: with DRIFT_MAX they are uncertain by 0.9 ms.
WINDOW_US = 30_000_000

# One point of each kind is kept in a bin. A bin is an eighth of the time since the
# first point, within these limits: short ones at first make the rate known early.
BIN_MIN_US, BIN_MAX_US = 20_000, 500_000

# Device time is in whole microseconds, rounded down.
QUANTUM_NS = 1_000

# A device time further ahead than this of those after it was damaged on the way.
LEAP_NS = 1_000_000_000

# Without replies to commands the rate is unknown: older arrivals mislead.
ALONE_S = 2.0

# The estimate is this part of the possible range away from its edges, at least.
SHARE_MIN = 0.25

# Slopes between the flattest and the steepest at which the range is evaluated.
SLOPES = 5


class Moment(msgspec.Struct, frozen=True):
    """The host's time of a device time."""

    host_ns: int
    bound_ns: int | None  # None: there is no lower bound


@dataclass(frozen=True, slots=True)
class _Estimate:
    """The possible host times at and near a device time."""

    at_ns: int  # of the device
    middle_ns: int  # of the host
    rate: float  # host's nanoseconds in one of the device, less 1
    half_ns: float | None
    spread: float  # of the rate, to both sides


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


class Clock:
    """The clock of one boot of a probe. `rate`: the last one known before."""

    def __init__(self, rate: float = 0.0) -> None:
        self.rate = rate
        self.exchanges = 0
        self.restarts = 0  # of the estimate, at points that contradict each other
        self.t_us: int | None = None  # the latest, unrolled
        self._t_ns: int | None = None
        self._rising = Rising()
        self._forget_all()

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
        if is_fresh_bin or host_ns < self._middle(device_us):
            self._solve(device_us, point, None)

    def date(self, device_us: int, host_ns: int) -> Moment:
        """arrived(), and the moment() of it."""
        if self._is_news(device_us, host_ns):
            self.arrived(device_us, host_ns)
        return self.moment(device_us)

    def _is_news(self, device_us: int, host_ns: int) -> bool:
        """Whether an arrival can change anything. Most can't: they come in a bin that
        has a tighter one, and later than estimated.
        """
        if device_us >= self._next_us or not self._above:
            return True
        then_us, then_ns = self._above.points[-1]
        step_ns = 1000 * (device_us - then_us)
        is_tighter = host_ns - 1000 * device_us - then_ns < self.rate * step_ns
        return is_tighter or host_ns < self._middle(device_us)

    def heard(self, device_us: int, host_ns: int) -> None:
        """At `device_us` the probe heard what was not sent before `host_ns`."""
        self.exchanges += 1
        is_fresh_bin = self._enter(device_us)
        is_bounded = self._estimate is not None and self._estimate.half_ns is not None
        point = device_us, host_ns - QUANTUM_NS - 1000 * device_us
        self._below.add(point, self._bin_us, self.rate)
        if is_fresh_bin or not is_bounded or host_ns > self._middle(device_us):
            self._solve(device_us, None, point)

    def moment(self, device_us: int) -> Moment:
        """The host's time of `device_us`. There must be an arrival before."""
        host_ns = self._rising.at(1000 * device_us)
        estimate = self._estimate
        if estimate is None or estimate.half_ns is None:
            return Moment(host_ns, None)
        age_s = abs(1000 * device_us - estimate.at_ns) * 1e-9
        bound_ns = (
            estimate.half_ns
            + abs(host_ns - self._middle(device_us))
            + (estimate.spread * age_s + DRIFT_MAX * age_s * age_s / 2) * 1e9
        )
        return Moment(host_ns, round(bound_ns) + QUANTUM_NS)

    @property
    def rate_ppm(self) -> float | None:
        """How fast the probe's clock runs; positive: too fast, None: not known yet."""
        estimate = self._estimate
        if estimate is None or estimate.half_ns is None:
            return None
        return -1e6 * estimate.rate

    def _middle(self, device_us: int) -> int:
        estimate = self._estimate
        if estimate is None:
            return 1 << 63
        step = 1000 * device_us - estimate.at_ns
        return estimate.middle_ns + step + round(estimate.rate * step)

    def _enter(self, device_us: int) -> bool:
        """Whether a bin begins there."""
        if self._first_us is None:
            self._first_us = device_us
        elif device_us < self._next_us:
            return False
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
            side.forget(device_us - WINDOW_US)
        if not self._above.points:
            return
        latest = (each.points[-1][0] for each in (self._above, self._below) if each)
        at_us = max(device_us, *latest)
        estimate = _possible(self._above.points, self._below.points, at_us, self.rate)
        if estimate is not None:
            self._follow(estimate)
            return
        # The latest point holds, whatever was wrong with the earlier ones.
        self.restarts += 1
        self._forget_all()
        if self._rising.is_beyond(1000 * device_us + LEAP_NS):
            self._rising = Rising()
            self.t_us, self._t_ns = device_us, None
        self._enter(device_us)
        for side, point in ((self._above, above), (self._below, below)):
            if point is not None:
                side.add(point, self._bin_us, self.rate)
        self._solve(device_us, None, None)

    def _follow(self, estimate: _Estimate) -> None:
        self._estimate = estimate
        if estimate.half_ns is not None:
            self.rate = estimate.rate
        self._rising.turn(estimate.at_ns, estimate.middle_ns, estimate.rate)


_Line = tuple[float, float]  # seconds from the reference, ns


def _possible(
    above: deque[_Point],
    below: deque[_Point],
    at_us: int,
    rate: float,
) -> _Estimate | None:
    """All lines between both kinds of points; None if there is no such line.

    Time is relative to `at_us`, so it is negative or nearly zero. A line is its value
    there and its slope. A steeper line can be higher there: the highest possible value
    belongs to the steepest possible line, the lowest to the flattest.
    """
    reference = above[-1][1]
    uppers = [_relaxed(point, at_us, reference, 1) for point in above]
    at_ns = 1000 * at_us
    if not below:
        slope = rate * 1e9
        top = min(y - slope * x for x, y in uppers if x > -ALONE_S)
        return _Estimate(at_ns, at_ns + reference + round(top), rate, None, 0.0)
    lowers = [_relaxed(point, at_us, reference, -1) for point in below]
    steepest = _extreme(uppers, lowers, 1)
    flattest = _extreme(uppers, lowers, -1)
    if steepest is None or flattest is None:
        return None
    high = min(y - steepest * x for x, y in uppers)
    low = max(y - flattest * x for x, y in lowers)
    slope, middle = _centre(uppers, lowers, flattest, steepest)
    # Lines that touch may cross by rounding.
    half_ns = max(0.0, high - middle, middle - low)
    spread = max(0.0, steepest - slope, slope - flattest)
    middle_ns = at_ns + reference + round(middle)
    return _Estimate(at_ns, middle_ns, slope * 1e-9, half_ns, spread * 1e-9)


def _centre(
    uppers: list[_Line], lowers: list[_Line], flattest: float, steepest: float
) -> tuple[float, float]:
    """Slope and value of the line in the middle of all possible ones, where each slope
    has the weight of its range of values.
    """
    step = (steepest - flattest) / SLOPES
    weights = slopes = values = 0.0
    for i in range(SLOPES):
        slope = flattest + (i + 0.5) * step
        tops = [y - slope * x for x, y in uppers]
        bottoms = [y - slope * x for x, y in lowers]
        top, bottom = min(tops), max(bottoms)
        # The least of n delays is about 1/n of their mean. The truth is nearer to the
        # side with shorter delays, in that proportion.
        late = (sum(tops) / len(tops) - top) / len(tops)
        early = (bottom - sum(bottoms) / len(bottoms)) / len(bottoms)
        share = early / (early + late) if early + late > 0 else 0.5
        share = min(max(share, SHARE_MIN), 1 - SHARE_MIN)
        weight = max(top - bottom, 1e-3)  # ns: below it is rounding
        weights += weight
        slopes += weight * slope
        values += weight * (bottom + share * (top - bottom))
    return slopes / weights, values / weights


def _relaxed(point: _Point, at_us: int, reference: int, sign: int) -> _Line:
    """A point relative to `at_us`, less strict by what the rate may have changed."""
    x = (point[0] - at_us) * 1e-6
    return x, point[1] - reference + sign * DRIFT_MAX / 2 * x * x * 1e9


def _extreme(uppers: list[_Line], lowers: list[_Line], sign: int) -> float | None:
    """The slope in ns/s of the steepest line between the points (`sign` 1) or of the
    flattest (-1). The gap between both hulls is a concave function of the slope, so
    Newton's method from outside converges to the edge.
    """
    slope = sign * RATE_MAX * 1e9
    for _ in range(len(uppers) + len(lowers) + 2):
        top, upper = min((y - slope * x, x) for x, y in uppers)
        bottom, lower = max((y - slope * x, x) for x, y in lowers)
        gap = top - bottom
        if gap >= -1e-3:  # ns: below it is rounding
            return slope
        run = upper - lower
        if sign * run <= 0:
            return None
        slope += gap / run
    return None
