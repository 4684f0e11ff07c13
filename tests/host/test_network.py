# SPDX-License-Identifier: MIT
"""The daemon in a network that is not its own, which comes and goes; a subscriber that
stands still; others who publish on its keys.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar, Self

import pytest

import imud
from fakes import PATIENCE_S, DaemonProcess, FakeProbe, Port, free_endpoint
from imud.client import Client, Heard
from imud.defaults import ENDPOINT

PROBE = "00112233445566aa"

ROUTER = """
import json, sys, zenoh
config = zenoh.Config()
for key, value in {
    "mode": "router",
    "listen/endpoints": [sys.argv[1]],
    "scouting/multicast/enabled": False,
}.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
print("up", flush=True)
sys.stdin.read()
"""

# Says what came and what did not, whenever it is asked.
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

WHILE_S = 1.0


class Process:
    """Python in a process of its own, once it has said that it is up."""

    made: ClassVar[list[Process]] = []

    def __init__(self, code: str, endpoint: str) -> None:
        self.made.append(self)
        self._process = subprocess.Popen(
            [sys.executable, "-c", code, endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "up\n"

    def send(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def ask(self) -> dict[str, Any]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        said: dict[str, Any] = json.loads(self._process.stdout.readline())
        return said

    def kill(self) -> None:
        self.made.remove(self)
        self._process.kill()
        self._process.communicate()


class Streaming:
    """A probe that says poses until it is told not to."""

    def __init__(self, port: Port, probe: FakeProbe, period_s: float = 0.005) -> None:
        self._port, self._probe, self._period_s = port, probe, period_s
        self.sent_s: list[float] = []  # when each was written
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(self._period_s):
            self.sent_s.append(time.monotonic())
            self._port.write(self._probe.say("pose"))

    @property
    def said(self) -> int:
        return len(self.sent_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Also where a test fails: before its daemon, which reads what is said."""
        self.stop()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()


def until(is_so: Callable[[], object]) -> float:
    """Seconds that it took."""
    begin = time.monotonic()
    while not is_so():
        assert time.monotonic() < begin + PATIENCE_S
        time.sleep(0.02)
    return time.monotonic() - begin


@pytest.fixture(autouse=True)
def _leave_none() -> Iterator[None]:
    """Also where a test fails."""
    yield
    for process in [*Process.made]:
        process.kill()


@pytest.fixture
def port(tmp_path: Path) -> Iterator[Port]:
    made = Port(tmp_path / "probe")
    yield made
    made.vanish()


def settings(directory: Path, mode: str, endpoint: str) -> Path:
    path = directory / "imud.toml"
    text = f'[zenoh]\nmode = "{mode}"\nconnect = ["{endpoint}"]\n'
    path.write_text(text, "utf-8")
    return path


def zenoh_of(client: Client) -> dict[str, int]:
    """What became of all records on their way to the network."""
    (status,) = client.statuses()
    counts: dict[str, int] = status["ledger"]["sinks"]["zenoh"]
    return counts


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_a_router_may_come_late_be_killed_and_come_back(
    tmp_path: Path,
    port: Port,
    mode: str,
    record_property: Callable[[str, object], None],
) -> None:
    endpoint = free_endpoint()
    path = settings(tmp_path, mode, endpoint)
    probe = FakeProbe()
    with DaemonProcess(
        port.path,
        "--config",
        path,
        directory=tmp_path,
        log=False,
        endpoint=ENDPOINT,  # as good as none: it listens nowhere
    ) as daemon:
        daemon.expect(f" connects to {endpoint}")
        port.wait_open()
        port.write(probe.say("hello"))
        daemon.expect("found on")
        with Streaming(port, probe) as stream:
            daemon.expect("warning: zenoh fails and is tried again: no Zenoh router")
            router = Process(ROUTER, endpoint)
            begin = time.monotonic()
            with imud.subscribe(endpoint=endpoint) as poses:
                first = poses.get(PATIENCE_S)
                assert first is not None
                record_property("first_s", time.monotonic() - begin)
                for _ in range(2):  # by two threads, in either order
                    daemon.expect(f"network: connected to {endpoint}|zenoh works again")
                router.kill()
                daemon.expect("warning: zenoh fails and is tried again: .* is gone")
                time.sleep(1.0)
                router = Process(ROUTER, endpoint)
                begin = time.monotonic()
                while poses.missed.network == 0:
                    poses.get(0.1)
                    assert time.monotonic() < begin + PATIENCE_S
                back_s = time.monotonic() - begin
                record_property("back_s", back_s)
                # The daemon looks each 2 s, a client of Zenoh's each 4 s at most.
                assert back_s < 8.0
                daemon.expect("zenoh works again")
                missed = poses.missed.network
        # A client finds all that it did before.
        with Client(endpoint) as client:
            until(client.statuses)
            assert client.alive() == [PROBE]

            def is_all_there() -> bool:
                (status,) = client.statuses()
                ledger = status["ledger"]
                assert ledger["lost"] == 0
                assert ledger["adds_up"], ledger["differs"]
                return bool(ledger["received"] == stream.said + 1)  # and a hello

            # The serial side has felt nothing of it.
            until(is_all_there)
            counts = zenoh_of(client)
            record_property("missed", missed)
            record_property("dropped", counts["dropped"])
            # Until the router was there for the first time, and while it was gone.
            assert counts["dropped"] > 0
            assert counts["taken"] + counts["dropped"] + counts["waiting"] > stream.said
        daemon.stop()
        router.kill()
        fails = [line for line in daemon.lines if "zenoh fails" in line]
        assert len(fails) == 2


def test_a_peer_that_listens_serves_on_while_another_is_gone(
    tmp_path: Path, port: Port
) -> None:
    endpoint = free_endpoint()
    path = settings(tmp_path, "peer", endpoint)
    probe = FakeProbe()
    with DaemonProcess(
        port.path, "--config", path, directory=tmp_path, log=False
    ) as daemon:
        daemon.expect("listens on .* and connects to")
        port.wait_open()
        port.write(probe.say("hello"))
        with (
            imud.subscribe(endpoint=daemon.endpoint) as near,
            Streaming(port, probe) as stream,
        ):
            daemon.expect(f"warning: network: {endpoint} is not there")
            for _ in range(2):
                router = Process(ROUTER, endpoint)
                daemon.expect(f"network: connected to {endpoint}")
                with imud.subscribe(endpoint=endpoint) as far:
                    assert far.get(PATIENCE_S) is not None
                router.kill()
                daemon.expect(f"warning: network: {endpoint} is gone")
            stream.stop()
            numbers = [pose.number for pose in iter(lambda: near.get(WHILE_S), None)]
            assert numbers == list(range(1, stream.said + 1))
        daemon.stop()


def test_who_went_while_there_was_no_router_is_not_alive(
    tmp_path: Path, port: Port
) -> None:
    endpoint = free_endpoint()
    path = settings(tmp_path, "client", endpoint)
    other = FakeProbe(probe_id=bytes.fromhex("0123456789abcdef"))
    there = Port(tmp_path / "other")
    with DaemonProcess(
        port.path, there.path, "--config", path, directory=tmp_path, log=False
    ) as daemon:
        daemon.expect("connects to")
        router = Process(ROUTER, endpoint)
        for each, one in ((port, FakeProbe()), (there, other)):
            each.wait_open()
            each.write(one.say("hello"))
        with Client(endpoint) as client:
            until(lambda: client.alive() == [PROBE, other.name])
        router.kill()
        daemon.expect("warning: zenoh fails and is tried again: .* is gone")
        there.vanish()
        daemon.expect(f"{there.path} vanished")
        router = Process(ROUTER, endpoint)
        with Client(endpoint) as client:
            until(lambda: len(client.statuses()) == 2)
            assert client.alive() == [PROBE]
        router.kill()
        daemon.stop()


def resident_mb(pid: int) -> float:
    text = Path(f"/proc/{pid}/status").read_text("utf-8")
    (line,) = [line for line in text.splitlines() if line.startswith("VmRSS")]
    return int(line.split()[1]) / 1024


@pytest.mark.timeout(300)
def test_a_subscriber_that_stands_still_costs_another_nothing(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    # What else the machine does delays poses, too, but not three times in a row.
    ports = (Port(tmp_path / f"probe-{number}") for number in range(3))
    assert any(
        is_as_fast_beside_one_that_stands_still(tmp_path, port, record_property)
        for port in ports
    )


def is_as_fast_beside_one_that_stands_still(
    tmp_path: Path, port: Port, record_property: Callable[[str, object], None]
) -> bool:
    """Whether poses come no later than before; that none is lost is asserted."""
    probe = FakeProbe()
    with DaemonProcess(port.path, directory=tmp_path, log=False) as daemon:
        daemon.expect("listens on")
        port.wait_open()
        port.write(probe.say("hello"))
        daemon.expect("found on")
        stuck = Process(READER, daemon.endpoint)
        heard: list[tuple[int, float]] = []

        def take(each: Heard) -> None:
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
                time.sleep(STOPPED_S)
                during, grown = len(heard), resident_mb(pid) - memory
                stuck.send(signal.SIGCONT)
                begin = time.monotonic()
                said = stream.said
                until(lambda: stuck.ask()["last"] >= said)
                record_property("back_s", time.monotonic() - begin)
            until(lambda: len(heard) == stream.said)
            until(lambda: stuck.ask()["last"] == heard[-1][0])
            counts = zenoh_of(client)
        told = stuck.ask()
        stuck.kill()
        # The other has all of them in their order.
        assert [number for number, _ in heard] == list(range(1, stream.said + 1))
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


def test_another_that_publishes_on_its_keys_is_told_of(
    tmp_path: Path, port: Port
) -> None:
    probe = FakeProbe()
    with DaemonProcess(port.path, directory=tmp_path, log=False) as daemon:
        daemon.expect("listens on")
        port.wait_open()
        port.write(probe.say("hello") + probe.poses(3))
        daemon.expect("found on")
        with Client(daemon.endpoint) as client:
            client.wait_for(PROBE)  # from then on it watches its keys
            client.session.put(f"imud/{PROBE}/pose", b"forged")
            daemon.expect(
                f"warning: network: another program publishes on imud/{PROBE}/pose"
            )
        daemon.stop()
        # What is its own is not another's.
        told = [line for line in daemon.lines if "another program publishes" in line]
        assert len(told) == 1


@pytest.mark.parametrize("history", [0, 5])
def test_who_comes_late_gets_the_poses_that_are_kept(
    tmp_path: Path, port: Port, history: int
) -> None:
    probe = FakeProbe()
    path = tmp_path / "imud.toml"
    path.write_text(f"[zenoh]\nhistory = {history}\n", "utf-8")
    with DaemonProcess(
        port.path, "--config", path, directory=tmp_path, log=False
    ) as daemon:
        daemon.expect("listens on")
        port.wait_open()
        port.write(probe.say("hello") + probe.poses(20))
        daemon.expect("found on")
        with Client(daemon.endpoint) as client:

            def published() -> bool:
                found = client.statuses()
                return bool(found) and found[0]["ledger"]["published"].get("pose") == 20

            until(published)
            heard: queue.Queue[int] = queue.Queue()
            client.listen(
                "pose",
                None,
                lambda each: heard.put(json.loads(each.payload)["number"]),
                history=100,
            )
            kept = [heard.get(timeout=PATIENCE_S) for _ in range(history)]

            def hears_another() -> bool:
                # The daemon learns of a subscriber a while after it has subscribed.
                port.write(probe.poses(1))
                with contextlib.suppress(queue.Empty):
                    kept.append(heard.get(timeout=WHILE_S))
                return len(kept) > history

            until(hears_another)
        assert kept == list(range(kept[-1] - history, kept[-1] + 1))
