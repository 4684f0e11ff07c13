# SPDX-License-Identifier: MIT
"""The daemon in a network that is not its own, which comes and goes; a subscriber that
stands still; others who publish on its keys.
"""

from __future__ import annotations

import json
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fakes import PATIENCE_S, DaemonProcess, FakeProbe, Port, free_endpoint
from imud.client import Client

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

READER = """
import sys, zenoh
from imud.network import open_client
session = open_client(sys.argv[1])
subscriber = session.declare_subscriber("imud/*/pose", lambda _: None)
print("up", flush=True)
sys.stdin.read()
"""


class Process:
    """Python in a process of its own, once it has said that it is up."""

    def __init__(self, code: str, endpoint: str) -> None:
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

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()


class Streaming:
    """A probe that says poses until it is told not to."""

    def __init__(self, port: Port, probe: FakeProbe, period_s: float = 0.005) -> None:
        self._port, self._probe, self._period_s = port, probe, period_s
        self.said = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(self._period_s):
            self._port.write(self._probe.say("pose"))
            self.said += 1

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()


def numbers_of(client: Client) -> queue.Queue[int]:
    numbers: queue.Queue[int] = queue.Queue()
    client.listen(
        "pose", None, lambda each: numbers.put(json.loads(each.payload)["number"])
    )
    return numbers


def until(is_so: Callable[[], object]) -> float:
    """Seconds that it took."""
    begin = time.monotonic()
    while not is_so():
        assert time.monotonic() < begin + PATIENCE_S
        time.sleep(0.02)
    return time.monotonic() - begin


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


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_a_router_that_comes_goes_and_comes_back_finds_the_daemon_there(
    tmp_path: Path, port: Port, mode: str
) -> None:
    endpoint = free_endpoint()
    path = settings(tmp_path, mode, endpoint)
    probe = FakeProbe()
    with DaemonProcess(
        port.path, "--config", path, directory=tmp_path, log=False
    ) as daemon:
        daemon.expect(f"connects to {endpoint}")
        port.wait_open()
        port.write(probe.say("hello"))
        daemon.expect("found on")
        stream = Streaming(port, probe)
        if mode == "client":
            daemon.expect("warning: zenoh fails and is tried again: no Zenoh router")
        for _ in range(2):
            router = Process(ROUTER, endpoint)
            begin = time.monotonic()
            with Client(endpoint) as client:
                numbers = numbers_of(client)
                first = numbers.get(timeout=PATIENCE_S)
                # A client's session is opened every 2 s, a peer's every 4 s at most.
                assert time.monotonic() - begin < 8.0
                assert client.alive() == [PROBE]
                assert [each["probe"] for each in client.statuses()] == [PROBE]
                assert numbers.get(timeout=PATIENCE_S) == first + 1
            router.kill()
        stream.stop()
        # The serial side has felt nothing of it: all that was said is numbered.
        router = Process(ROUTER, endpoint)
        with Client(endpoint) as client:
            until(client.statuses)

            def received() -> int:
                (status,) = client.statuses()
                count = status["ledger"]["received"]
                assert status["ledger"]["lost"] == 0
                return int(count)

            until(lambda: received() == stream.said + 1)  # and a hello
        router.kill()
        daemon.stop()
        fails = [line for line in daemon.lines if "zenoh fails" in line]
        # Once while there was no router, then once each time that it went.
        assert len(fails) == (3 if mode == "client" else 0)


def test_a_subscriber_that_stands_still_costs_another_nothing(
    tmp_path: Path, port: Port
) -> None:
    probe = FakeProbe()
    with DaemonProcess(port.path, directory=tmp_path, log=False) as daemon:
        daemon.expect("listens on")
        port.wait_open()
        port.write(probe.say("hello"))
        daemon.expect("found on")
        stuck = Process(READER, daemon.endpoint)
        with Client(daemon.endpoint) as client:
            numbers = numbers_of(client)
            stuck.send(signal.SIGSTOP)
            # 2 MB in poses: more than the sockets between hold.
            stream = Streaming(port, probe, period_s=0.001)
            time.sleep(10.0)
            stream.stop()
            heard: list[int] = []
            while len(heard) < stream.said:
                heard.append(numbers.get(timeout=PATIENCE_S))
            (status,) = client.statuses()
        stuck.send(signal.SIGCONT)
        stuck.kill()
        assert heard == list(range(heard[0], heard[0] + stream.said))
        assert stream.said > 2000
        assert status["ledger"]["lost"] == 0
        assert status["ledger"]["dropped"]["zenoh"] == 0


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
            client.session.put(f"imud/{PROBE}/pose", b"forged")
            daemon.expect(f"warning: network: another publishes on imud/{PROBE}/pose")
        daemon.stop()
        # What is its own is not another's.
        told = [line for line in daemon.lines if "another publishes" in line]
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
            port.write(probe.poses(1))
            kept.append(heard.get(timeout=PATIENCE_S))
        assert kept == list(range(kept[-1] - history, kept[-1] + 1))
