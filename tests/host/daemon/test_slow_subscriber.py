# SPDX-License-Identifier: MIT
"""A subscriber that reads nothing costs the others nothing."""

from __future__ import annotations

import json
import os
import signal
import statistics
import time
from collections.abc import Callable
from pathlib import Path

from fakes import DaemonProcess, FakeProbe, Port
from imud.client import Client, Delivery
from streaming import Process, Streaming, until, zenoh_of

# Reports received and missing messages on request.
READER = """
import json, sys, threading, imud
told = {"count": 0, "first": None, "last": None}
poses = imud.subscribe(endpoint=sys.argv[1])

def follow():
    for pose in poses:
        if told["first"] is None:
            told["first"] = pose.number
        told["count"], told["last"] = told["count"] + 1, pose.number
threading.Thread(target=follow, daemon=True).start()
print("up", flush=True)
for _ in sys.stdin:
    print(json.dumps({**told, "missed": poses.missed.network}), flush=True)
"""
# Longer than the lease of a Zenoh session, 10 s, after which who is silent is left.
STOPPED_S = float(os.environ.get("IMUD_STOPPED_SECONDS", "12"))
LEASE_S = 10.0


def comes(is_so: Callable[[], bool], client: Client) -> bool:
    """Whether it becomes true before some more statuses have come, one a second."""
    for _ in range(5):
        if is_so():
            return True
        before = client.statuses()
        until(lambda before=before: client.statuses() != before)
    return is_so()


def resident_mb(pid: int) -> float:
    text = Path(f"/proc/{pid}/status").read_text("utf-8")
    (line,) = [line for line in text.splitlines() if line.startswith("VmRSS")]
    return int(line.split()[1]) / 1024


def test_a_subscriber_that_stands_still_costs_another_nothing(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    # What else the machine does delays poses, too, or costs some, but not three times
    # in a row.
    ports = (Port(tmp_path / f"probe-{number}") for number in range(3))
    assert any(
        is_as_fast_beside_one_that_stands_still(tmp_path, port, record_property)
        for port in ports
    )


def is_as_fast_beside_one_that_stands_still(
    tmp_path: Path, port: Port, record_property: Callable[[str, object], None]
) -> bool:
    """Whether all poses come, and no later than before."""
    probe = FakeProbe()
    with DaemonProcess(port.path, directory=tmp_path, log=False) as daemon:
        daemon.find(port, probe)
        stuck = Process(READER, daemon.endpoint)
        heard: list[tuple[int, float]] = []

        def take(each: Delivery) -> None:
            number = json.loads(each.payload)["number"]
            heard.append((number, time.monotonic()))

        with Client(daemon.endpoint) as client:
            client.listen("pose", None, take)
            client.statuses()  # then the router knows of it
            pid = daemon.process.pid
            with Streaming(port, probe, period_s=0.001) as stream:
                until(lambda: len(heard) > 2000)
                before, memory = len(heard), resident_mb(pid)
                stuck.send(signal.SIGSTOP)
                time.sleep(STOPPED_S)  # so long it stands
                during, grown = len(heard), resident_mb(pid) - memory
                stuck.send(signal.SIGCONT)
                begin, sent = time.monotonic(), stream.sent
                until(lambda: stuck.ask()["last"] >= sent)
                record_property("back_s", time.monotonic() - begin)
            has_all = comes(lambda: len(heard) == stream.sent, client)
            is_back = comes(lambda: stuck.ask()["last"] == heard[-1][0], client)
            counts = zenoh_of(client)
        told = stuck.ask()
        stuck.kill()
        if not (has_all and is_back):
            return False
        # The other has all of them in their order.
        assert [number for number, _ in heard] == list(range(1, stream.sent + 1))
        late_s = [at - stream.sent_s[number - 1] for number, at in heard]
        usual = statistics.quantiles(late_s[:before], n=100)
        meanwhile = statistics.quantiles(late_s[before:during], n=100)
        for name, value in (
            ("poses", during - before),
            ("median_ms", [1000 * usual[49], 1000 * meanwhile[49]]),
            ("p99_ms", [1000 * usual[98], 1000 * meanwhile[98]]),
            ("grown_mb", grown),
            ("told", told),
        ):
            record_property(name, value)
        assert grown < 30
        assert counts["dropped"] == 0
        # What it missed is known to it, to the pose.
        assert told["count"] + told["missed"] == told["last"] - told["first"] + 1
        assert (told["missed"] > 0) == (STOPPED_S > LEASE_S)
    port.vanish()
    # One put of them all waits for room, 50 ms.
    return meanwhile[49] < max(0.01, 3 * usual[49]) and meanwhile[98] < max(
        0.1, 3 * usual[98]
    )
