# SPDX-License-Identifier: MIT
"""The host's time goes on while the machine sleeps, and NTP does not move it."""

from __future__ import annotations

import time

import pytest

from imud.machine.posix import _HostClock

S = 1_000_000_000
STILL = {time.CLOCK_MONOTONIC, time.CLOCK_MONOTONIC_RAW}


class Machine:
    """Its clocks; each reading takes 50 ns."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, slept_ns: int) -> None:
        self.now_ns = 100 * S
        self.slept_ns = slept_ns
        self.pause_ns = 0  # before the next reading of a clock that stands still
        monkeypatch.setattr(time, "clock_gettime_ns", self.read)

    def read(self, which: int) -> int:
        self.now_ns += 50
        if which == time.CLOCK_MONOTONIC:
            self.now_ns += self.pause_ns
            self.pause_ns = 0
        return self.now_ns - (self.slept_ns if which in STILL else 0)


@pytest.mark.parametrize("before_s", [0, 5 * 86_400])
def test_the_time_of_a_sleep_is_counted(
    monkeypatch: pytest.MonkeyPatch, before_s: int
) -> None:
    machine = Machine(monkeypatch, before_s * S)
    clock = _HostClock()
    begun_ns = clock()
    assert clock.slept_ns() == pytest.approx(before_s * S, abs=1000)
    for slept_s in (40, 8 * 3600, 0.001):
        slept_ns = int(slept_s * S)
        before_ns, slept_before_ns = clock(), clock.slept_ns()
        machine.now_ns += slept_ns
        machine.slept_ns += slept_ns
        assert clock() - before_ns == pytest.approx(slept_ns, abs=2000)
        assert clock.slept_ns() - slept_before_ns == pytest.approx(slept_ns, abs=1000)
    assert clock() - begun_ns == pytest.approx(28_840.001 * S, abs=20_000)


def test_a_pause_between_two_readings_is_no_sleep(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = Machine(monkeypatch, 0)
    clock = _HostClock()
    before_ns = clock()
    for _ in range(3):
        machine.pause_ns = S
        clock()
    assert clock.slept_ns() == 0
    assert clock() - before_ns == pytest.approx(3 * S, abs=2000)
    # The first reading after a sleep is disturbed: the rest of it follows.
    machine.now_ns += 40 * S
    machine.slept_ns += 40 * S
    machine.pause_ns = S
    clock()
    assert clock.slept_ns() == pytest.approx(40 * S, abs=1000)
