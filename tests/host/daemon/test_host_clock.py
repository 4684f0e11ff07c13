# SPDX-License-Identifier: MIT
"""A host says whether it follows UTC, and by how much it may be off."""

from __future__ import annotations

import socket

import pytest

from imud.config.settings import Config
from imud.daemon import host_clock
from imud.daemon.host_clock import MAXERROR_US, STA_UNSYNC, TIME_ERROR, HostClock, Sync
from imud.daemon.host_clock import sync_of_host as asked
from imud.daemon.hub import Hub
from imud.daemon.lines import ProbeLines
from imud.daemon.publisher import RecordPublisher
from imud.daemon.registry import Registry
from imud.journal.output import Journal


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
