# SPDX-License-Identifier: MIT
"""A machine that is out of files or space: poses continue; the log reports the
shortage, and continues when it is over.
"""

from __future__ import annotations

import resource
import time
from pathlib import Path

import pytest

from configured import running
from fakes import SOON_S
from imud.client import Client

CONFIG = "[log]\nrotate_mb = 1\nfloor_mb = 1\n"


@pytest.mark.parametrize("limit", ["RLIMIT_NOFILE", "RLIMIT_FSIZE"])
def test_the_log_stops_says_why_and_goes_on_when_there_is_room_again(
    tmp_path: Path, limit: str
) -> None:
    which = getattr(resource, limit)
    with running(tmp_path, CONFIG) as (daemon, probe, port):
        pid = daemon.process.pid
        before = resource.prlimit(pid, which)
        with Client(daemon.endpoint) as client:
            heard: list[bytes] = []
            client.subscribe("pose", None, lambda _, payload: heard.append(payload))
            client.statuses()  # then the daemon knows of it
            # No more files than are open, or none longer than some kilobytes.
            least = 3 if limit == "RLIMIT_NOFILE" else 20_000
            resource.prlimit(pid, which, (least, before[1]))
            while not any("log failed" in line for line in daemon.seen()):
                port.write(probe.poses(100))
                time.sleep(0.05)
            count = len(heard)
            port.write(probe.poses(20))
            while len(heard) < count + 20:
                time.sleep(0.02)
            resource.prlimit(pid, which, before)
            while not any("log works again" in line for line in daemon.seen()):
                port.write(probe.poses(20))
                time.sleep(0.05)
        failing = [line for line in daemon.lines if "log failed" in line]
        assert len(failing) == 1, failing
        assert daemon.stop() < SOON_S
        assert not any("internal error" in line for line in daemon.lines)
