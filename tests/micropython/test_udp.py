# SPDX-License-Identifier: MIT
"""The package's UDP in MicroPython's unix port: at a daemon, and at an end that drops,
forges and repeats datagrams."""

from __future__ import annotations

import os
import re
import socket
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import pytest

from fakes import PATIENCE_S, DaemonProcess
from imud.client import Client
from imud.errors import ConfigError
from imud.net import probe_keys
from imud.ports.datagram import HELLO, DatagramFault, Peer, sign
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode, encode
from micropython_frames import PACKAGE, PROGRAMS
from system.live import hear, take

NAME = "udp"


def folded(data: bytes) -> bytes:
    """FNV-1a of 64 bits: the id that a probe makes of its chip's."""
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value.to_bytes(8, "little")


ID = folded(NAME.encode())


@contextmanager
def probe(
    stock: Path, keys: Path, port: int, kind: str = "plain", host: str = "127.0.0.1"
) -> Iterator[None]:
    """The probe of udp_probe.py in MicroPython."""
    key = keys / "probes" / f"{ID.hex()}.key"
    words = [str(stock), str(PROGRAMS / "udp_probe.py"), str(key), host, str(port)]
    path = f"{PROGRAMS / 'fake'}:{PACKAGE.parent}"
    process = subprocess.Popen(
        [*words, NAME, kind],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"MICROPYPATH": path},
    )
    try:
        yield
        output, _ = process.communicate()
        assert (process.returncode, output) == (0, b"")
    finally:
        process.kill()
        process.wait()


def test_it_streams_to_a_daemon_that_computes_its_poses(
    stock: Path, tmp_path: Path
) -> None:
    probe_keys.make(tmp_path / "keys", ID.hex())
    config = tmp_path / "imud.toml"
    config.write_text(
        '[ports]\nfind = false\nudp = "127.0.0.1:0"\nudp_keys = "keys"\n'
        f"[probes.{ID.hex()}]\nstart = true\nfuse_on_host = true\n"
    )
    with DaemonProcess("--config", config, directory=tmp_path, log=False) as daemon:
        port = re.search(r":(\d+): open", daemon.expect("udp .*: open to 1 probe"))
        assert port is not None
        with (
            probe(stock, tmp_path / "keys", int(port[1])),
            Client(daemon.endpoint) as client,
        ):
            daemon.expect(f"probe {ID.hex()} found on udp:127.0.0.1:")
            daemon.expect("stream started")
            poses = take(hear(client, "pose"), 100)
            (status,) = client.statuses()
        daemon.stop()
    numbers = [pose["number"] for pose in poses]
    assert numbers == list(range(numbers[0], numbers[0] + 100))
    assert status["ledger"]["lost"] == 0
    assert status["ledger"]["adds_up"]


class End:
    """A daemon's end that a test commands."""

    def __init__(self, keys: Path) -> None:
        with suppress(ConfigError):  # of another end
            probe_keys.make(keys, ID.hex())
        self.peer = Peer(ID, probe_keys.read(keys)[ID])
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(PATIENCE_S)
        self.port = self.socket.getsockname()[1]
        self.decoder = FrameDecoder()
        self.messages: list[Message] = []
        self.commands = 0

    def close(self) -> None:
        self.socket.close()

    def receive(self) -> bytes:
        """Takes a datagram and returns it."""
        datagram, self.address = self.socket.recvfrom(2000)
        if datagram[0] != HELLO:
            payload = self.peer.open(datagram, self.address)
            assert not isinstance(payload, DatagramFault), payload
            assert payload.endswith(b"\0")  # whole frames
            found = map(decode, self.decoder.feed(payload))
            self.messages += [m for m in found if isinstance(m, Message)]
        return datagram

    def welcome(self) -> None:
        """Waits for a hello and answers it."""
        while (datagram := self.receive())[0] != HELLO:
            pass
        self.answer(datagram, self.address)

    def answer(self, hello: bytes, address: tuple[str, int]) -> None:
        answer = self.peer.welcome(hello, address)
        assert isinstance(answer, bytes)
        self.socket.sendto(answer, address)

    def command(self, name: str) -> bytes:
        """A signed datagram with a command, not sent."""
        self.commands += 1
        fields = {"command": name, "token": self.commands, "arguments": (0, 0)}
        frame = encode_frame(encode("command", fields, self.commands, 0))
        assert self.peer.channel is not None
        return self.peer.channel.seal(b"\0" + frame)

    def until(self, name: str, count: int) -> list[Message]:
        """Receives until `count` messages of that name have arrived."""
        while len(found := [m for m in self.messages if m.name == name]) < count:
            self.receive()
        return found


@pytest.mark.parametrize("kind", ["plain", "module"])
def test_it_obeys_what_is_signed_for_it_once(
    stock: Path, tmp_path: Path, kind: str
) -> None:
    with closing(End(tmp_path)) as end, probe(stock, tmp_path, end.port, kind):
        end.welcome()
        end.until("hello", 1)
        start, stop = end.command("start"), end.command("stop")
        forged = sign(bytes(32), stop[:-16])
        for datagram in (forged, stop[:-1], b"", bytes(60), start, start, forged):
            end.socket.sendto(datagram, end.address)
        end.until("raw", 10)
        replies = end.until("reply", 1)
        end.socket.sendto(start, end.address)
        end.socket.sendto(end.command("hello"), end.address)
        replies = end.until("reply", 2)
    assert [reply.fields["replied_token"] for reply in replies] == [1, 3]
    numbers = [message.sequence for message in end.messages]
    assert numbers == list(range(len(numbers)))


def test_it_greets_again_where_its_daemon_is_silent(
    stock: Path, tmp_path: Path
) -> None:
    with closing(End(tmp_path)) as end, probe(stock, tmp_path, end.port):
        end.welcome()
        end.until("hello", 1)
        end.socket.sendto(end.command("start"), end.address)
        end.until("raw", 10)
        end.welcome()  # after some seconds without a message from here
        end.until("raw", len([m for m in end.messages if m.name == "raw"]) + 10)
    assert end.peer.sessions == 2
    # What was sent meanwhile waited, as far as there was room.
    numbers = [message.sequence for message in end.messages]
    assert numbers == sorted(set(numbers))


def test_a_host_with_a_new_address_is_found_and_one_of_two_daemons_serves(
    stock: Path, tmp_path: Path
) -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as network,
        closing(End(tmp_path)) as one,
        closing(End(tmp_path)) as two,
    ):
        network.bind(("127.255.255.255", 0))  # hears what is sent to everybody
        network.settimeout(PATIENCE_S)
        port = network.getsockname()[1]
        with probe(stock, tmp_path, port, host="127.0.0.2"):  # nobody is there now
            hello, address = network.recvfrom(2000)
            for end in (one, two):
                end.answer(hello, address)
            one.until("hello", 1)
            two.socket.setblocking(False)
            with pytest.raises(BlockingIOError):
                two.socket.recv(2000)
