# SPDX-License-Identifier: MIT
"""`imud replay`: readers and subscribers can't tell a log from the probe itself."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes import PATIENCE_S, DaemonProcess, FakeProbe, free_endpoint
from imud import cli
from imud.client import Client
from imud.errors import CommandRefused, ProbeUnknown
from imud.net import keys
from imud.probes.record import Record
from imud.probes.session import Probe as HeardProbe
from imud.probes.session import Received, Session
from imud.recordings import replay
from log_files import records, write


def status(name: str, t_ns: int, **fields: object) -> Record:
    payload = json.dumps({"type": "status", "probe": name, "t_ns": t_ns} | fields)
    return Record(name, "status", payload.encode(), b"", 0, t_ns, t_ns)


@contextlib.contextmanager
def network(tmp_path: Path) -> Iterator[tuple[Client, str]]:
    """Of a daemon without probes."""
    with DaemonProcess(tmp_path / "none", directory=tmp_path, log=False) as daemon:
        daemon.expect("listens on")
        with Client(daemon.endpoint) as client:
            yield client, daemon.endpoint


@contextlib.contextmanager
def playing(*words: object) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "imud", "replay", *map(str, words)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def test_a_replayed_probe_is_alive_answers_with_its_status_and_takes_no_command(
    tmp_path: Path,
) -> None:
    put = records(500)
    path = write(
        tmp_path / "in", [status("left", put[0].t_ns, state="streaming"), *put]
    )
    with network(tmp_path) as (client, endpoint):
        assert client.alive() == []
        with playing(path, "--connect", endpoint, "--speed", 0.2) as process:
            assert client.wait_for("left", seconds=PATIENCE_S) == "left"
            until = time.monotonic() + PATIENCE_S
            while not client.statuses():
                assert time.monotonic() < until
            (shown,) = client.statuses()
            assert (shown["probe"], shown["state"]) == ("left", "streaming")
            with pytest.raises(CommandRefused, match="a replay of a log"):
                client.command("left", "start")
            # One who would say the same on the same keys is kept from it.
            with (
                Client(endpoint) as second,
                pytest.raises(ProbeUnknown, match="a probe left already exists"),
            ):
                replay.to_network(replay.log_set([path]), second, None)
            process.send_signal(signal.SIGINT)
            output, error = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 130
        assert output.startswith("stopped after ")
        assert output.count("\n") == 1
        assert error == ""
        assert client.alive() == []
        assert client.statuses() == []


def test_while_none_reads_the_pty_control_c_ends_it_with_one_line(
    tmp_path: Path,
) -> None:
    path, link = write(tmp_path, records(10)), tmp_path / "probe"
    with playing(path, "--link", link) as process:
        assert process.stdout is not None
        assert "probe left is on" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        output, error = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, output, error) == (
        130,
        "stopped after 0 messages\n",
        "",
    )
    assert not link.is_symlink()


def test_files_are_played_in_the_order_in_which_they_were_begun(
    tmp_path: Path,
) -> None:
    """Also one that is cut, whose probes stand in no summary."""
    put = records(300)
    thirds = [put[:100], put[100:200], put[200:]]
    names = ["b", "c", "a"]
    paths = [
        write(tmp_path / name, third) for name, third in zip(names, thirds, strict=True)
    ]
    paths[1].write_bytes(paths[1].read_bytes()[:-30])
    what = replay.log_set([paths[2], paths[0], paths[1]])
    assert what == replay.LogSet(paths, ["left"], "imud")
    with network(tmp_path) as (client, _):
        found: dict[str, list[bytes]] = {"frame": [], "pose": []}
        subscribers = [
            client.session.declare_subscriber(
                f"imud/left/{topic}",
                lambda sample, of=of: of.append(sample.payload.to_bytes()),
            )
            for topic, of in found.items()
        ]
        # In the same session: what is put is heard at once.
        assert replay.to_network(what, client, None) == 0
        for subscriber in subscribers:
            subscriber.undeclare()
    assert found["frame"] == [record.content for record in put]
    assert found["pose"] == [each.payload for each in put if each.topic == "pose"]


def test_each_probe_of_a_log_speaks_on_a_pty_of_its_own(tmp_path: Path) -> None:
    left, right = records(400, name="left"), records(400, FakeProbe(), "right")
    path = write(tmp_path, left, right)
    with playing(path, "--speed", "0") as process:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(2)]
        ports = [line.split(" is on ")[1].split(";")[0] for line in lines]
        found = dict(zip(("left", "right"), read(ports, 400), strict=True))
        assert process.stdout.readline() == "replayed 800 messages\n"
    assert found["left"] == [record.content for record in left]
    assert found["right"] == [record.content for record in right]


def read(ports: list[str], count: int) -> list[list[bytes]]:
    """`count` messages of each port."""
    files = [os.open(port, os.O_RDONLY | os.O_NOCTTY) for port in ports]
    sessions = {}
    for file in files:
        probe = HeardProbe("x")
        sessions[file] = Session(lambda _, probe=probe: probe, None, probe)
        sessions[file].receive(b"\0", None)
    found: dict[int, list[bytes]] = {file: [] for file in files}
    try:
        while any(len(each) < count for each in found.values()):
            ready, _, _ = select.select(files, [], [], PATIENCE_S)
            assert ready
            for file in ready:
                events = sessions[file].receive(os.read(file, 4096), None)
                found[file] += [e.content for e in events if isinstance(e, Received)]
    finally:
        for file in files:
            os.close(file)
    return [found[file] for file in files]


def test_where_keys_rule_a_daemon_may_replay_and_nobody_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "in", [*records(50), status("left", 1)])
    folder = tmp_path / "keys"
    endpoint = free_endpoint().replace("tcp/", "tls/")
    keys.initialise(folder, ["localhost"], int(endpoint.rpartition(":")[2]))
    keys.add(folder, "daemon", "player")
    settings = tmp_path / "imud.toml"
    settings.write_text(f'[zenoh]\nkeys = "{folder}"\n')
    words = ("--config", settings)
    with DaemonProcess(
        tmp_path / "none", *words, directory=tmp_path, log=False, endpoint=endpoint
    ) as daemon:
        daemon.expect("listens on tls")
        clients = folder / "clients"
        with Client(keys=clients / "recorder.toml") as client:
            found: list[bytes] = []
            done = threading.Event()

            def take(_: str, payload: bytes) -> None:
                found.append(payload)
                if len(found) == 50:
                    done.set()

            client.subscribe("frame", None, take)
            client.statuses()  # then the router knows who subscribes
            as_player = ["--keys", str(clients / "player.toml"), "--speed", "max"]
            assert cli.main(["replay", str(path), *as_player]) == 0
            assert done.wait(PATIENCE_S)
        assert capsys.readouterr().out == "replayed 101 messages\n"
        as_viewer = ["--keys", str(clients / "viewer.toml")]
        assert cli.main(["replay", str(path), *as_viewer]) == 1
        assert "only the role daemon may publish" in capsys.readouterr().err
    both = [*as_player, "--link", str(tmp_path / "x")]
    assert cli.main(["replay", str(path), *both]) == 1
    assert "leave out one of them" in capsys.readouterr().err


@pytest.mark.parametrize("what", ["replaying", "exporting", "recovering", "reading"])
def test_on_a_terminal_a_bar_shows_how_far_it_is(tmp_path: Path, what: str) -> None:
    path = write(tmp_path / "in", *[records(50) for _ in range(20)])
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    words = {
        "replaying": ["replay", "--speed", "max"],
        "exporting": ["export"],
        "recovering": ["recover"],
        "reading": ["info"],
    }[what]
    command = [sys.executable, "-m", "imud", words[0], str(path), *words[1:]]
    master, slave = pty.openpty()
    with subprocess.Popen(
        command, stderr=slave, stdout=subprocess.PIPE, text=True
    ) as process:
        os.close(slave)
        assert process.stdout is not None
        if what == "replaying":
            line = process.stdout.readline()
            read([line.split(" is on ")[1].split(";")[0]], 1)
        shown = b""
        with contextlib.suppress(OSError):
            while some := os.read(master, 4096):
                shown += some
        process.wait(PATIENCE_S)
    os.close(master)
    assert f"{what} ".encode() in shown
    assert b"%" in shown
    assert shown.rfind(b"\r\x1b[K") > shown.rfind(b"%")  # it is taken away
