# SPDX-License-Identifier: MIT
"""The C under the clock and the log: limits, refusals, lines found by brute force."""

from __future__ import annotations

import gc
from itertools import product

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from imud import _core
from imud.probes.clock import DRIFT_MAX

FAR = 2**63 - 1
RATE_MAX = 0.02  # as docs/pose-details.md has it


def test_nothing_is_known_before_the_first_turn() -> None:
    rising = _core.Rising()
    with pytest.raises(ValueError, match="nothing is known yet"):
        rising.at(0)
    assert not rising.is_beyond(-FAR)


def test_a_time_that_does_not_fit_64_bits_is_refused_and_changes_nothing() -> None:
    rising = _core.Rising()
    with pytest.raises(OverflowError):
        rising.turn(-FAR - 1, 0, 0.0)
    rising.turn(0, 5, 0.0)
    assert rising.at(0) == 5
    for call in (rising.at, rising.is_beyond, lambda x: rising.turn(x, 0, 0.0)):
        with pytest.raises(OverflowError):
            call(FAR + 1)
    with pytest.raises(OverflowError):
        rising.at(FAR)
    with pytest.raises(OverflowError):
        rising.turn(-FAR, FAR, 0.02)
    assert not rising.is_beyond(0)
    assert rising.at(0) == 5
    line = _core.Line(rising, DRIFT_MAX, 1000)
    line.know(10, (0, 0), 0.0, (0, 0, 0.0, 1.0, 0.0))
    for call in (line.moment, line.middle, lambda far: line.date(-far, 0)):
        with pytest.raises(OverflowError):
            call(FAR)
    with pytest.raises(OverflowError):
        _core.estimate([(FAR, 0)], [], -FAR, 0, 0.0, DRIFT_MAX)


def test_a_line_is_made_of_a_rising_function_and_keeps_it() -> None:
    with pytest.raises(TypeError, match="made of a Rising"):
        _core.Line(5, DRIFT_MAX, 1000)  # type: ignore[arg-type]
    rising = _core.Rising()
    rising.turn(0, 0, 0.0)
    line = _core.Line(rising, DRIFT_MAX, 1000)
    del rising
    gc.collect()
    assert line.moment(3) == (3000, None)
    assert line.middle(3) == FAR
    with pytest.raises(TypeError):
        line.know(0, (1, 2, 3), 0.0, None)  # type: ignore[arg-type]
    assert line.date(3, 5000) is None  # all is news


# Delays in us of arrivals and of commands, one a second.
DELAYS = st.lists(
    st.tuples(st.integers(1, 50_000), st.integers(1, 50_000)), min_size=2, max_size=12
)


@given(DELAYS, st.floats(-0.019, 0.019))
def test_the_estimate_is_in_the_middle_of_all_possible_lines(
    delays: list[tuple[int, int]], rate: float
) -> None:
    above, below = [], []
    for second, (late_us, early_us) in enumerate(delays):
        offset = round(rate * second * 1e9)
        above.append((1_000_000 * second, offset + 1000 * late_us))
        below.append((1_000_000 * second, offset - 1000 * early_us))
    at_us = above[-1][0]
    found = _core.estimate(above, below, at_us, above[-1][1], 0.0, 0.0)
    at_ns, middle_ns, slope, half_ns, spread = found
    assert at_ns == 1000 * at_us
    # By brute force: the extremes touch one point of each kind.
    uppers = [((x - at_us) * 1e-6, float(y)) for x, y in above]
    lowers = [((x - at_us) * 1e-6, float(y)) for x, y in below]
    slopes = [
        (upper[1] - lower[1]) / (upper[0] - lower[0])
        for upper, lower in product(uppers, lowers)
        if upper[0] != lower[0]
    ]

    def gap(s: float) -> float:
        return min(y - s * x for x, y in uppers) - max(y - s * x for x, y in lowers)

    possible = [s for s in slopes if gap(s) > -1.0 and abs(s) < RATE_MAX * 1e9]
    assume(len(possible) > 1)
    steepest, flattest = max(possible), min(possible)
    assert flattest - 1 <= slope * 1e9 <= steepest + 1
    widest = max(steepest - slope * 1e9, slope * 1e9 - flattest)
    assert spread * 1e9 >= widest - 2
    high = min(y - steepest * x for x, y in uppers)
    low = max(y - flattest * x for x, y in lowers)
    offset_ns = middle_ns - at_ns
    assert half_ns >= max(high - offset_ns, offset_ns - low) - 3


def test_points_that_contradict_each_other_have_no_estimate() -> None:
    assert _core.estimate([(0, 0)], [(0, 10)], 0, 0, 0.0, DRIFT_MAX) is None
    assert _core.estimate([(0, 10)], [(0, 0)], 0, 10, 0.0, DRIFT_MAX) is not None
    with pytest.raises(TypeError):
        _core.estimate([(0, 0)], [(0,)], 0, 0, 0.0, DRIFT_MAX)  # type: ignore[list-item]


def test_a_chunk_refuses_what_its_records_have_no_room_for() -> None:
    chunk = _core.Chunk()
    chunk.add_record(b"schema")
    assert chunk.take() is None
    for wrong in ((1 << 16, 0, b"", 0, 0), (1, -1, b"", 0, 0), (1, 0, b"", 0, 1 << 32)):
        with pytest.raises(OverflowError):
            chunk.add(*wrong)
    with pytest.raises(TypeError):
        chunk.add(1, 2, b"")  # type: ignore[call-arg]
    assert chunk.take() is None
    size = chunk.add(0xFFFF, 2**64 - 1, b"abc", 7, 2**32 - 1)
    taken = chunk.take()
    data, first, last, (index,) = taken
    assert data[:6] == b"schema"
    assert data[-3:] == b"abc"
    assert len(data) == size
    assert first == last == 2**64 - 1
    assert index[:2] == (0xFFFF, 1)


def test_a_chunk_is_used_again_without_what_it_had() -> None:
    chunk = _core.Chunk()
    for channel in range(300, 0, -1):
        chunk.add(channel, channel, bytes(channel), 0, channel)
    taken = chunk.take()
    assert [channel for channel, _, _ in taken[3]] == list(range(300, 0, -1))
    assert chunk.add(5, 1, b"x", 0, 0) == 32
    again = chunk.take()
    assert [entry[:2] for entry in again[3]] == [(5, 1)]
