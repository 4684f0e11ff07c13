# SPDX-License-Identifier: MIT
"""SIGHUP: changed settings are applied, and nothing is lost."""

from __future__ import annotations

import itertools
import queue
import re
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from configured import running
from fakes import DaemonProcess, free_address
from imud.client import Client
from imud.log.reader import Logged
from log_files import read_log
from streaming import Streaming, until


def reload(daemon: DaemonProcess, folder: Path, old: str, new: str) -> None:
    file = folder / "imud.toml"
    file.write_text(file.read_text().replace(old, new))
    daemon.process.send_signal(signal.SIGHUP)


def test_a_reload_gives_a_probe_its_name_and_loses_no_count(tmp_path: Path) -> None:
    with running(tmp_path, "# more") as (daemon, probe, port):
        port.write(probe.poses(20))
        own = "[probes.00112233445566aa]\nname = 'stylus'"
        reload(daemon, tmp_path, "# more", own)
        daemon.expect("reloaded: probes")
        with Client(daemon.endpoint) as client:
            assert client.wait_for("stylus") == "stylus"
            until(lambda: client.alive() == ["stylus"])
            # Once a second there is another status.
            ledger: dict[str, Any] = {}
            while any(
                ledger.get(sink, {}).get("pose") != 20
                for sink in ("logged", "published")
            ):
                for status in client.statuses("stylus"):
                    assert status["probe_id"] == probe.name
                    ledger = status["ledger"]
            assert ledger["adds_up"], ledger["differs"]
        reload(daemon, tmp_path, "'stylus'", "'tip'")
        daemon.expect("reloaded: probes")
        daemon.stop()
        assert any("probe tip: 21 received, 0 lost" in line for line in daemon.lines)


def test_a_renamed_probe_costs_no_subscriber_its_connection(tmp_path: Path) -> None:
    """Zenoh can leave a client deaf that connects while a router closes."""
    own = "[probes.00112233445566aa]\nname = 'tip'"
    with (
        running(tmp_path, own) as (daemon, probe, port),
        Client(daemon.endpoint) as client,
    ):
        client.wait_for("tip")
        heard: queue.SimpleQueue[str] = queue.SimpleQueue()
        client.subscribe("pose", None, lambda name, _: heard.put(name))
        by_id: queue.SimpleQueue[str] = queue.SimpleQueue()
        client.subscribe("pose", probe.name, lambda name, _: by_id.put(name))
        every = "imud/**"
        seen: list[object] = []
        client.session.declare_subscriber(every, lambda s: seen.append(s.key_expr))
        client.statuses()  # then the daemon knows who subscribes
        links: list[object] = []
        listener = client.session.info.declare_link_events_listener(links.append)
        for old, new in (("tip", "stylus"), ("stylus", "tip")) * 2:
            reload(daemon, tmp_path, f"'{old}'", f"'{new}'")
            daemon.expect("reloaded: probes")
            assert client.wait_for(new) == new
            until(lambda new=new: client.alive() == [new])
            port.write(probe.poses(1))
            assert (heard.get(), by_id.get()) == (new, new)
            assert client.only_probe(probe.name) == client.wait_for(probe.name)
            assert client.command(probe.name, "mark", value="1")["ok"]
            assert client.statuses(probe.name) == client.statuses(new)
            ledger_when(client, lambda each: each["adds_up"])
            assert [status["probe"] for status in client.statuses()] == [new]
        assert not by_id.qsize()
        assert not [key for key in seen if "@" in str(key)]
        assert links == []
        listener.undeclare()
        daemon.stop()


LOG_OFF, LOG_ON = "[log]\nenabled = false", "[log]\nenabled = true"
ROS2_ON = "[ros2]\nenabled = true\n"


def ledger_when(
    client: Client, is_so: Callable[[dict[str, Any]], bool]
) -> dict[str, Any]:
    """Of the first status of which that is true; there is another once a second."""
    while True:
        for status in client.statuses():
            ledger: dict[str, Any] = status["ledger"]
            if is_so(ledger):
                return ledger
        time.sleep(0.05)


def test_a_sink_that_a_reload_switches_keeps_the_ledger_adding_up(
    tmp_path: Path,
) -> None:
    with running(tmp_path, LOG_OFF, log=None) as (daemon, probe, port):
        with Client(daemon.endpoint) as client:
            port.write(probe.poses(20))
            ledger_when(client, lambda each: each["received"] == 21)
            for turn in range(1, 4):
                reload(daemon, tmp_path, LOG_OFF, ROS2_ON + LOG_ON)
                daemon.expect("reloaded: log, ros2")
                port.write(probe.poses(30))
                ledger = ledger_when(
                    client, lambda each: each["logged"].get("pose", 0) == 30
                )
                assert ledger["adds_up"], ledger["sinks"]
                assert ledger["sinks"].keys() == {"zenoh", "log", "ros2"}
                assert ledger["sinks"]["zenoh"]["earlier"] == 0
                # What was put while it was off is no loss of its own.
                log = ledger["sinks"]["log"]
                assert log["earlier"] >= 21 + 60 * (turn - 1)
                assert log["dropped"] == 0
                if turn == 2:  # its counts go along with the probe's name
                    named = f"[probes.{probe.name}]\nname = 'tip'\n"
                    reload(daemon, tmp_path, "[log]", f"{named}[log]")
                    daemon.expect("reloaded: probes")
                    after = ledger_when(client, lambda each: each["adds_up"])
                    assert after["sinks"]["log"]["earlier"] == log["earlier"]
                reload(daemon, tmp_path, ROS2_ON, "")
                daemon.expect("reloaded: ros2")
                reload(daemon, tmp_path, LOG_ON, LOG_OFF)
                daemon.expect("reloaded: log")
                port.write(probe.poses(30))
                received = probe.sequence
                ledger = ledger_when(
                    client, lambda each, n=received: each["received"] == n
                )
                assert ledger["adds_up"], ledger["sinks"]
                assert ledger["sinks"].keys() == {"zenoh"}
        daemon.stop()


def test_a_reload_sets_up_a_probe_that_is_there(tmp_path: Path) -> None:
    with running(tmp_path, "# more") as (daemon, probe, port):
        own = "[probes.00112233445566aa]\npose_rate = 50"
        reload(daemon, tmp_path, "# more", own)
        daemon.expect("reloaded: probes")
        port.serve(probe, 1)
        reload(daemon, tmp_path, "pose_rate = 50", "streams = ['raw']")
        daemon.expect("reloaded: probes")
        port.serve(probe, 1)
        heard = [(c["command"], c["arguments"]) for c in probe.commands]
        assert heard == [("rate", (0, 50)), ("fields", (2, 0))]
        daemon.stop()


RELOADS, MEANWHILE = 30, 30  # messages from one to the next


def frames_of(path: Path) -> list[bytes]:
    items = (each for each in read_log(path) if isinstance(each, Logged))
    return [each.data for each in items if each.topic == "frame"]


@pytest.mark.nightly
def test_thirty_reloads_under_a_stream_lose_nothing_and_leak_no_descriptor(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    changes = (  # restarts the log's sink, the network's, both
        ("rotate_mb = 1", "rotate_mb = 2", "reloaded: log"),
        ("history = 1", "history = 2", "reloaded: zenoh"),
        ("= 2", "= 1", "reloaded: zenoh, log"),
    )
    text = "[log]\nrotate_mb = 1\n[zenoh]\nhistory = 1\n"
    with running(tmp_path, text) as (daemon, probe, port):
        names = itertools.cycle(("hello", *["pose"] * 199))
        stream = Streaming(port, probe, say=lambda: probe.say(next(names)))
        folder = Path(f"/proc/{daemon.process.pid}/fd")
        with Client(daemon.endpoint) as client:  # Zenoh opens some for the first
            client.wait_for()
        at_first = len(list(folder.iterdir()))
        slowest_s = 0.0
        try:
            for turn in range(RELOADS):
                before, after, line = changes[turn % len(changes)]
                sent = probe.sequence
                begin = time.monotonic()
                reload(daemon, tmp_path, before, after)
                daemon.expect(line)
                slowest_s = max(slowest_s, time.monotonic() - begin)
                while probe.sequence < sent + MEANWHILE:
                    time.sleep(0.005)
        finally:
            stream.stop()
        with Client(daemon.endpoint) as client:
            sent = probe.sequence
            ledger = ledger_when(client, lambda each: each["received"] == sent)
            assert ledger["adds_up"], ledger["sinks"]
            assert ledger["lost"] == 0
            assert all(each["dropped"] == 0 for each in ledger["sinks"].values())
        # A log that is closing and the client that left are there for a moment.
        while (at_last := len(list(folder.iterdir()))) > at_first + 1:
            time.sleep(0.1)
        daemon.stop()
    frames = [data for path in daemon.logs.glob("*.mcap") for data in frames_of(path)]
    record_property("reloads", RELOADS)
    record_property("slowest reload, s", round(slowest_s, 3))
    record_property("descriptors, first and last", (at_first, at_last))
    record_property("messages sent", sent)
    record_property("messages in the logs", len(frames))
    assert len(frames) == sent


def test_a_file_with_a_mistake_is_told_and_changes_nothing(tmp_path: Path) -> None:
    with running(tmp_path, "[journal]\nburst = 3") as (daemon, probe, port):
        reload(daemon, tmp_path, "burst = 3", "burst = 0")
        line = daemon.expect("reload failed")
        assert re.search(r"imud.toml:5: \[journal\] burst: 0 is not", line)
        port.write(probe.say("event"))
        daemon.expect("stream started")
        reload(daemon, tmp_path, "burst = 0", "burst = 4")
        daemon.expect("reloaded: journal")
        daemon.stop()


def test_a_reload_turns_metrics_on_and_off(tmp_path: Path) -> None:
    address = free_address()
    table = f"[metrics]\nlisten = '127.0.0.1:{address[1]}'"
    with running(tmp_path, "# more") as (daemon, _, _):
        reload(daemon, tmp_path, "# more", table)
        daemon.expect("reloaded: metrics")
        with socket.create_connection(address, 10) as end:
            end.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
            assert end.recv(12) == b"HTTP/1.1 200"
        reload(daemon, tmp_path, table, "# more")
        daemon.expect("reloaded: metrics")
        with pytest.raises(OSError, match="refused"):
            socket.create_connection(address, 10).close()
        daemon.stop()
