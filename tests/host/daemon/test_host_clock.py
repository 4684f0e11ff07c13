# SPDX-License-Identifier: MIT
"""A host says whether it follows UTC, and by how much it may be off."""

from __future__ import annotations

import json
import socket
import time

import pytest

from imud.config.settings import Config
from imud.daemon import host_clock
from imud.daemon.host_clock import HostClock
from imud.daemon.hub import Hub
from imud.daemon.lane import Item
from imud.daemon.lines import ProbeLines
from imud.daemon.publisher import RecordPublisher
from imud.daemon.registry import Registry
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


def test_a_pause_is_told_and_its_silence_is_nobodys(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    now, slept, hub, told = [100 * SECOND], [7 * SECOND], Hub(), list[Item]()
    monkeypatch.setattr(hub, "put", told.append)
    caplog.set_level("INFO", "imud")
    monkeypatch.setattr(host_clock, "host_ns", lambda: now[0])
    monkeypatch.setattr(host_clock, "slept_ns", lambda: slept[0])
    monkeypatch.setattr(time, "time_ns", lambda: now[0])
    registry = Registry(Config())
    registry.add("ab")
    clock = HostClock(registry, RecordPublisher(hub), ProbeLines(Journal(10.0, 3)))
    now[0] += 60 * SECOND  # it was not asked to look yet
    clock.follow()
    session = Session(Probe, now[0], timeline=clock.timeline)
    for pause_s, slept_s in ((1, 0), (40, 40), (28_800, 28_800), (30, 0), (50, 20)):
        now[0] += pause_s * SECOND
        slept[0] += slept_s * SECOND
        clock.follow()
        assert not session.check(now[0] + 2 * SECOND)
    assert session.check(now[0] + 4 * SECOND) == [Silent(4.0)]
    assert caplog.messages == [
        "this machine slept for 40 s",
        "this machine slept for 28800 s",
        "imud itself stood still for 30 s",
        "this machine slept for 20 s",
        "imud itself stood still for 30 s",
    ]
    values = [json.loads(each.payload) for each in told if isinstance(each, Record)]
    assert [(each["reason"], each["step_ns"] // SECOND) for each in values] == [
        *(("slept", 40), ("slept", 28_800), ("stood_still", 30)),
        *(("slept", 20), ("stood_still", 30)),
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
