# SPDX-License-Identifier: MIT
"""A host says whether it follows UTC, and by how much it may be off."""

from __future__ import annotations

import json
import socket
import time
from types import SimpleNamespace

import pytest

from imud.config.settings import Config
from imud.daemon import host_clock
from imud.daemon.host_clock import HostClock
from imud.daemon.hub import Hub
from imud.daemon.lane import Item
from imud.daemon.lines import ProbeLines
from imud.daemon.publisher import RecordPublisher
from imud.daemon.registry import Registry
from imud.daemon.status import _clock
from imud.journal.output import Journal
from imud.machine.utc import MAXERROR_US, STA_UNSYNC, TIME_ERROR, Sync
from imud.machine.utc import sync_of_host as asked
from imud.probes.record import Record
from imud.probes.session import Probe, Session, Silent

SECOND = 1_000_000_000


@pytest.mark.parametrize(
    ("state", "status", "maxerror_us", "bound_us"),
    [
        (0, 1, 250, 250),
        (1, 1, MAXERROR_US - 1, MAXERROR_US - 1),
        (0, 1, MAXERROR_US, None),
        (0, STA_UNSYNC | 1, 250, None),
        (TIME_ERROR, 1, 250, None),
    ],
)
def test_only_a_clock_that_is_corrected_has_a_bound(
    state: int, status: int, maxerror_us: int, bound_us: int | None
) -> None:
    sync = Sync.of("here", state, status, maxerror_us)
    assert sync == Sync("here", bound_us is not None, bound_us)


def test_the_kernel_is_asked() -> None:
    sync = asked()
    assert sync.host == socket.gethostname()
    assert sync.is_synchronised in (True, False)
    assert (sync.bound_us is not None) == sync.is_synchronised


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A host's clocks in ns, a probe, and what is told of them."""
    its = SimpleNamespace(now=100 * SECOND, slept=7 * SECOND, utc=0, told=list[Item]())
    hub, registry = Hub(), Registry(Config())
    monkeypatch.setattr(hub, "put", its.told.append)
    monkeypatch.setattr(host_clock, "host_ns", lambda: its.now)
    monkeypatch.setattr(host_clock, "slept_ns", lambda: its.slept)
    monkeypatch.setattr(time, "time_ns", lambda: its.now + its.utc)
    its.entry = registry.add("ab")
    lines = ProbeLines(Journal(10.0, 3))
    its.clock = HostClock(registry, RecordPublisher(hub), lines)
    return its


def told_of(machine: SimpleNamespace) -> list[tuple[str, int, int]]:
    """Of each record the reason, seconds, and the number of the timeline."""
    records = [each for each in machine.told if isinstance(each, Record)]
    values = [json.loads(each.payload) for each in records]
    return [(v["reason"], v["step_ns"] // SECOND, v["timeline"]) for v in values]


def test_a_step_of_utc_is_told(
    machine: SimpleNamespace, caplog: pytest.LogCaptureFixture
) -> None:
    for step_s in (3600, -1, -86_400):
        machine.now += SECOND
        machine.utc += step_s * SECOND
        machine.clock.follow()
    assert caplog.messages == [
        "this machine's clock was set by +3600.000 s",
        "this machine's clock was set by -1.000 s; time stamps follow gradually",
        "this machine's clock was set by -86400.000 s; time stamps jump back with it, "
        "and a new log starts",
    ]
    assert told_of(machine) == [("set", 3600, 1), ("set", -1, 1), ("set", -86_400, 2)]
    told = _clock(machine.entry, machine.clock.timeline, machine.now)
    steps = {name: told[f"host_{name}"] for name in ("steps", "timeline", "ahead_ns")}
    assert steps == {"steps": 3, "timeline": 2, "ahead_ns": 0}


def test_a_pause_is_told_and_its_silence_is_nobodys(
    machine: SimpleNamespace, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "imud")
    clock = machine.clock
    machine.now += 60 * SECOND  # it was not asked to look yet
    clock.follow()
    session = Session(Probe, machine.now, timeline=clock.timeline)
    for pause_s, slept_s in ((1, 0), (40, 40), (28_800, 28_800), (30, 0), (50, 20)):
        machine.now += pause_s * SECOND
        machine.slept += slept_s * SECOND
        clock.follow()
        assert not session.check(machine.now + 2 * SECOND)
    assert session.check(machine.now + 4 * SECOND) == [Silent(4.0)]
    assert caplog.messages == [
        "this machine slept for 40 s",
        "this machine slept for 28800 s",
        "imud itself stood still for 30 s",
        "this machine slept for 20 s",
        "imud itself stood still for 30 s",
    ]
    assert told_of(machine) == [
        *(("slept", 40, 1), ("slept", 28_800, 1), ("stood_still", 30, 1)),
        *(("slept", 20, 1), ("stood_still", 30, 1)),
    ]


def test_losing_and_regaining_utc_is_told(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    current = [Sync("here", is_synchronised=True, bound_us=7)]
    monkeypatch.setattr(host_clock, "sync_of_host", lambda: current[0])
    hub = Hub()
    lines = ProbeLines(Journal(10.0, 3))
    caplog.set_level("INFO", "imud")
    clock = HostClock(Registry(Config()), RecordPublisher(hub), lines)
    assert clock.timeline.whose == ("here", 7)
    clock.look()
    assert not caplog.messages
    current[0] = Sync("here", is_synchronised=False)
    clock.look()
    clock.look()
    assert clock.timeline.whose == ("here", None)
    current[0] = Sync("here", is_synchronised=True, bound_us=9)
    clock.look()
    told = [message for message in caplog.messages if "UTC" in message]
    assert len(told) == 2
    assert "no longer follows UTC" in told[0]
    assert "again" in told[1]
