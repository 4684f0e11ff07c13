# SPDX-License-Identifier: MIT
"""Probes on a daemon's UDP port: each with its key, and nobody else."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from fakes import PATIENCE_S, DaemonProcess, FakeProbe
from fakes.datagrams import SignedProbe, UdpProbe
from imud import cli
from imud.client import Client
from imud.config import reader
from imud.errors import ConfigError
from imud.net import probe_keys

FIRST, SECOND = "00000000000000a1", "00000000000000b2"
STRANGER = "00000000000000c3"


@contextmanager
def listening(folder: Path, *probes: str) -> Iterator[tuple[DaemonProcess, Any]]:
    """A daemon with keys of these probes, and the address that it listens on."""
    for probe in probes:
        probe_keys.make(folder / "keys", probe)
    config = folder / "imud.toml"
    config.write_text('[ports]\nfind = false\nudp = "127.0.0.1:0"\nudp_keys = "keys"\n')
    daemon = DaemonProcess("--config", config, directory=folder, log=False)
    with daemon:
        line = daemon.expect(r"udp 127\.0\.0\.1:\d+: open to")
        port = re.search(r"127\.0\.0\.1:(\d+)", line)
        yield daemon, ("127.0.0.1", int(port[1]))
        daemon.stop()


def joined(folder: Path, address: Any, probe: str) -> tuple[UdpProbe, FakeProbe]:
    """A probe with a session, whose hello is said."""
    name = bytes.fromhex(probe)
    wire = UdpProbe(address, name, probe_keys.read(folder / "keys")[name])
    wire.greet()
    fake = FakeProbe(probe_id=name)
    wire.send(fake.say("hello"))
    return wire, fake


def status_when(client: Client, probe: str, is_so: Any) -> dict[str, Any]:
    while True:
        for status in client.statuses():
            if status["probe_id"] == probe and is_so(status):
                return status
        time.sleep(0.05)


def test_two_probes_stream_and_a_lost_datagram_is_counted(tmp_path: Path) -> None:
    with listening(tmp_path, FIRST, SECOND) as (daemon, address):
        one, first = joined(tmp_path, address, FIRST)
        daemon.expect(f"probe {FIRST} found on udp:127.0.0.1:")
        two, second = joined(tmp_path, address, SECOND)
        daemon.expect(f"probe {SECOND} found on udp:127.0.0.1:")
        for number in range(20):
            one.send(first.poses(3))
            lost = two.signed.data(second.poses(2))
            if number != 10:
                two.socket.send(lost)
        with Client(daemon.endpoint) as client:
            mine = status_when(client, FIRST, lambda s: s["ledger"]["received"] == 61)
            theirs = status_when(
                client, SECOND, lambda s: s["ledger"]["received"] == 39
            )
        assert mine["ledger"]["lost"] == 0
        assert theirs["ledger"]["lost"] == 2
        assert theirs["ledger"]["corrupt"] == 0
        assert mine["link"]["datagrams"]["received"] == 21
        assert set(mine["link"]["datagrams"]["refused"].values()) == {0}
        one.close()
        two.close()


def test_a_command_arrives_signed_and_its_answer_returns(tmp_path: Path) -> None:
    with listening(tmp_path, FIRST) as (daemon, address):
        wire, fake = joined(tmp_path, address, FIRST)
        daemon.expect("found on")
        with Client(daemon.endpoint) as client:
            client.wait_for(seconds=PATIENCE_S)
            served = threading.Thread(target=serve, args=(wire, fake, "start"))
            served.start()
            assert client.command(FIRST, "start")["ok"]
            served.join()
        wire.close()


def serve(wire: UdpProbe, fake: FakeProbe, until: str) -> None:
    """Answers commands up to one of that name."""
    while not any(command["command"] == until for command in fake.commands):
        answer = fake.hear(wire.receive())
        if answer:
            wire.send(answer)


def test_who_has_no_key_is_counted_and_never_answered(tmp_path: Path) -> None:
    with listening(tmp_path, FIRST) as (daemon, address):
        wire, fake = joined(tmp_path, address, FIRST)
        daemon.expect("found on")
        name, forger = bytes.fromhex(FIRST), FakeProbe(probe_id=bytes.fromhex(FIRST))
        stranger = UdpProbe(address, name, bytes(32))
        forged = SignedProbe(name, bytes(32), session=bytes(32))
        unknown = SignedProbe(bytes.fromhex(STRANGER), bytes(32), session=bytes(32))
        recorded = wire.send(fake.poses(1))
        sent = 2

        def flood(status: dict[str, Any]) -> bool:
            """More of it until each kind was counted: the kernel may drop some."""
            nonlocal sent
            for datagram in [
                *[forged.hello()] * 10,
                *[forged.data(forger.poses(1)) for _ in range(50)],
                *[unknown.hello()] * 10,
                *[b"", bytes(10), bytes(3000)],
            ]:
                stranger.socket.send(datagram)
            wire.socket.send(recorded)
            wire.send(fake.poses(1))
            sent += 1
            refused = status["link"]["datagrams"]["refused"]
            kinds = ("bad_signature", "no_session", "replayed")
            return all(refused[kind] > 0 for kind in kinds)

        with Client(daemon.endpoint) as client:
            status = status_when(client, FIRST, flood)
        ledger, link = status["ledger"], status["link"]
        # Of a stranger's messages none was taken.
        assert ledger["received"] == link["datagrams"]["received"]
        assert ledger["received"] + ledger["lost"] <= sent
        assert ledger["corrupt"] == ledger["duplicated"] == 0
        for words in ("bad signature", "unknown key", "malformed", "oversized"):
            daemon.expect(f"datagrams refused: .* {words}, the last from 127.0.0.1")
        stranger.socket.setblocking(False)
        with pytest.raises(BlockingIOError):
            stranger.socket.recv(2000)
        stranger.close()
        wire.close()


def test_a_key_speaks_for_its_probe_alone(tmp_path: Path) -> None:
    with listening(tmp_path, FIRST) as (daemon, address):
        wire, _ = joined(tmp_path, address, FIRST)
        daemon.expect(f"probe {FIRST} found on")
        wire.send(FakeProbe(probe_id=bytes.fromhex(STRANGER)).say("hello"))
        daemon.expect(f"a probe claims to be {STRANGER}, with the key of another")
        with Client(daemon.endpoint) as client:
            status_when(client, FIRST, lambda status: status["state"] != "gone")
            assert [s["probe_id"] for s in client.statuses()] == [FIRST]
        wire.close()


def test_a_key_counts_while_its_file_is_there(tmp_path: Path) -> None:
    with listening(tmp_path, FIRST) as (daemon, address):
        probe_keys.make(tmp_path / "keys", SECOND)
        wire, _ = joined(tmp_path, address, SECOND)
        daemon.expect(f"probe {SECOND} found on")
        (tmp_path / "keys" / "probes" / f"{SECOND}.key").unlink()
        with Client(daemon.endpoint) as client:
            status_when(client, SECOND, lambda status: status["state"] == "gone")
        wire.close()


def test_a_key_is_made_once_and_is_a_secret(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["keys", "probe", str(tmp_path / "keys"), FIRST]
    assert cli.main(words) == 0
    path = tmp_path / "keys" / "probes" / f"{FIRST}.key"
    assert path.stat().st_mode & 0o777 == 0o600
    key = bytes.fromhex(path.read_text())
    assert probe_keys.read(tmp_path / "keys") == {bytes.fromhex(FIRST): key}
    assert key.hex() not in capsys.readouterr().out
    assert cli.main(words) == 1
    assert "already exists" in capsys.readouterr().err
    assert bytes.fromhex(path.read_text()) == key
    assert cli.main([*words[:-1], "a1"]) == 1
    path.write_text("not a key")
    with pytest.raises(ConfigError, match="was not created by imud keys probe"):
        probe_keys.read(tmp_path / "keys")


@pytest.mark.parametrize(
    ("lines", "mistake"),
    [
        ('udp = "127.0.0.1:0"', "udp_keys: is empty"),
        ('udp = "somewhere"\nudp_keys = "keys"', "is not HOST:PORT"),
    ],
)
def test_without_keys_no_port_is_opened(
    tmp_path: Path, lines: str, mistake: str
) -> None:
    config = tmp_path / "imud.toml"
    config.write_text(f"[ports]\n{lines}\n")
    with pytest.raises(ConfigError, match=mistake):
        reader.load(config)


def test_a_port_that_is_taken_is_told_once(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        udp = f"127.0.0.1:{holder.getsockname()[1]}"
        probe_keys.make(tmp_path / "keys", FIRST)
        config = tmp_path / "imud.toml"
        config.write_text(f'[ports]\nfind = false\nudp = "{udp}"\nudp_keys = "keys"\n')
        with DaemonProcess("--config", config, directory=tmp_path, log=False) as daemon:
            daemon.expect(f"udp {udp}: .*in use")
            holder.close()
            daemon.expect(f"udp {udp}: open to")
            daemon.stop()
        assert sum("in use" in line for line in daemon.lines) == 1
