# SPDX-License-Identifier: MIT
"""The whole chain: image, emulator, pty, daemon, subscriber, log."""

from __future__ import annotations

import queue
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from demanded import BUILT
from fakes import PATIENCE_S, DaemonProcess
from imud.client import Client
from system.live import LiveProbe, hear, take
from system.virtual import Stub

pytestmark = pytest.mark.sampled(2)

CLICK = ("--press", "200000:300000")


def drained(heard: queue.Queue[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    while not heard.empty():
        yield heard.get()


@pytest.mark.parametrize("stub", BUILT, indirect=True)
def test_a_live_probe_reaches_a_subscriber_with_nothing_lost(stub: Stub) -> None:
    probe = LiveProbe(stub, "--press", "1500000:1700000")
    with DaemonProcess(probe.port, directory=stub.folder) as daemon:
        daemon.expect("found on")
        with Client(daemon.endpoint) as client:
            name = client.wait_for(seconds=PATIENCE_S)
            poses = hear(client, "pose")
            got = take(poses, 300)
            assert client.command(name, "stop")["ok"]
            got += list(drained(poses))
            (status,) = client.statuses()
        summary = probe.end()
        daemon.stop()
    assert not summary["crashed"]
    assert summary["late"] == 0
    assert status["ledger"]["lost"] == 0
    assert status["ledger"]["corrupt"] == 0
    numbers = [pose["seq"] for pose in got]
    steps = np.diff([pose["t_device_us"] for pose in got])
    assert np.all(np.abs(steps - 10_000) < stub.board.unevenness_us)
    assert numbers == sorted(numbers)
    assert set(got[0]) == {
        *("type", "probe", "seq", "number", "missing", "t_device_us", "t_ns"),
        *("t_bound_us", "age_us", "q", "position_m", "normal", "tilt_sigma_deg"),
        *("heading_sigma_deg", "flags", "since_origin", "utc_host", "utc_bound_us"),
    }
