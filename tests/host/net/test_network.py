# SPDX-License-Identifier: MIT
"""The daemon in a network that is not its own, which comes and goes; others who publish
on its keys; subscribers who come late.
"""

from __future__ import annotations

import contextlib
import json
import queue
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import imud
from chain import Chain
from fakes import (
    PATIENCE_S,
    DaemonProcess,
    FakeProbe,
    Port,
    Stopwatch,
    free_endpoint,
)
from imud.client import Client
from imud.defaults import ENDPOINT
from streaming import Process, Streaming, until, zenoh_of

pytestmark = pytest.mark.sampled(2)

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
WHILE_S = 1.0


def settings(directory: Path, mode: str, endpoint: str) -> Path:
    path = directory / "imud.toml"
    text = f'[zenoh]\nmode = "{mode}"\nconnect = ["{endpoint}"]\n'
    path.write_text(text, "utf-8")
    return path


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
        daemon.find(port, probe, up=f" connects to {endpoint}")
        with Streaming(port, probe) as stream:
            daemon.expect("warning: zenoh failed, retrying: no Zenoh router")
            router = Process(ROUTER, endpoint)
            begin = time.monotonic()
            with imud.subscribe(endpoint=endpoint) as poses:
                first = poses.get(PATIENCE_S)
                assert first is not None
                record_property("first_s", time.monotonic() - begin)
                for _ in range(2):  # by two threads, in either order
                    daemon.expect(f"network: connected to {endpoint}|zenoh works again")
                router.kill()
                daemon.expect("warning: zenoh failed, retrying: lost the connection")
                time.sleep(1.0)  # so long it is gone
                router = Process(ROUTER, endpoint)
                watch = Stopwatch(daemon.process.pid)
                while poses.missed.network == 0:
                    poses.get(0.1)
                back_s = watch.look()
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
                return bool(ledger["received"] == stream.sent + 1)  # and a hello

            # The serial side has felt nothing of it.
            until(is_all_there)
            counts = zenoh_of(client)
            record_property("missed", missed)
            record_property("dropped", counts["dropped"])
            # Until the router was there for the first time, and while it was gone.
            assert counts["dropped"] > 0
            assert counts["taken"] + counts["dropped"] + counts["waiting"] > stream.sent
        daemon.stop()
        router.kill()
        fails = [line for line in daemon.lines if "zenoh failed" in line]
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
            daemon.expect(f"warning: network: can't reach {endpoint}")
            for _ in range(2):
                router = Process(ROUTER, endpoint)
                daemon.expect(f"network: connected to {endpoint}")
                with imud.subscribe(endpoint=endpoint) as far:
                    assert far.get(PATIENCE_S) is not None
                router.kill()
                daemon.expect(f"warning: network: lost the connection to {endpoint}")
            stream.stop()
            numbers = [pose.number for pose in iter(lambda: near.get(WHILE_S), None)]
            # The daemon learns of a subscriber a while after it has subscribed.
            assert numbers == list(range(numbers[0], stream.sent + 1))
            assert len(numbers) > stream.sent / 2
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
        daemon.expect("warning: zenoh failed, retrying: lost the connection")
        there.vanish()
        daemon.expect(f"{there.path} disappeared")
        router = Process(ROUTER, endpoint)
        with Client(endpoint) as client:
            until(lambda: len(client.statuses()) == 2)
            assert client.alive() == [PROBE]
        router.kill()
        daemon.stop()


def test_another_that_publishes_on_its_keys_is_told_of(chain: Chain) -> None:
    words = "another program also publishes"
    chain.port.write(chain.probe.poses(3))
    chain.client.session.put(f"imud/{PROBE}/pose", b"forged")
    chain.daemon.expect(f"warning: network: {words} on imud/{PROBE}/pose")
    chain.daemon.stop()
    # What is its own is not another's.
    assert sum(words in line for line in chain.daemon.lines) == 1


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
        daemon.find(port, probe)
        port.write(probe.poses(20))
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
            kept = [heard.get() for _ in range(history)]

            def hears_another() -> bool:
                # The daemon learns of a subscriber a while after it has subscribed.
                port.write(probe.poses(1))
                with contextlib.suppress(queue.Empty):
                    kept.append(heard.get(timeout=WHILE_S))
                return len(kept) > history

            until(hears_another)
        assert kept == list(range(kept[-1] - history, kept[-1] + 1))


def test_a_probe_that_went_to_another_daemon_is_left_to_it(chain: Chain) -> None:
    client, daemon = chain.client, chain.daemon
    chain.port.vanish()
    daemon.expect("disappeared")
    until(lambda: client.alive() == [])
    # A daemon that has just noticed may not listen yet.
    told = f"network: probe {PROBE} is now at another imud"
    until(
        lambda: (
            client.session.put(f"imud/{PROBE}/status", b'{"state":"streaming"}')
            or any(told in line for line in daemon.seen())
        )
    )
    until(lambda: client.statuses() == [])
    chain.port = Port(chain.port.path)
    chain.port.wait_open()
    chain.port.write(chain.probe.say("hello"))
    daemon.expect("found on")
    until(client.statuses)
    # What the daemon that it left says of it is no other's claim.
    told = f"another program also publishes on imud/{PROBE}/pose"
    until(
        lambda: (
            client.session.put(f"imud/{PROBE}/status", b'{"state":"gone"}')
            or client.session.put(f"imud/{PROBE}/pose", b"forged")
            or any(told in line for line in daemon.seen())
        )
    )
    daemon.stop()
    assert not any("/status, too" in line for line in daemon.lines)
