# SPDX-License-Identifier: MIT
"""From MicroPython's own image on a virtual Pico to a pose over the air in one command:
imud flash --wifi. Its network is simulated: datagrams go through its USB.
"""

from __future__ import annotations

import os
import re
import select
import socket
import threading
import tty
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import msgspec
import pytest

from demanded import leave_out
from fakes import DaemonProcess
from host.cli.test_flash_micropython import AIR, free_udp_port
from imud import cli
from imud.cli import flash_micropython
from imud.client import Client
from imud.flash import micropython, serial_port
from imud.virtual.boards import PICO as VIRTUAL
from micropython_frames import PROGRAMS
from system.live import LiveProbe, hear, take
from system.virtual import PICO, Stub

ROOT = Path(__file__).resolve().parents[2]
STOCK = ROOT / "build" / "pico" / "pico-stock.elf"
SIMULATED = (Path("fake/network.py"), Path("over_usb/socket.py"))
LINE = re.compile(rb"\x1e([0-9a-f]*)\r?\n")

SIMULATOR = ROOT / VIRTUAL.simulator

if not (STOCK.exists() and SIMULATOR.exists()):
    leave_out("the virtual Pico is not there", is_whole_file=True)


class Air:
    """A board's USB, without the datagrams on it, which go to a daemon."""

    def __init__(self, board: Path, daemon: int) -> None:
        self._board = os.open(board, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._board)
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.port = os.ttyname(self._theirs)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", daemon))
        self._end, self._stop = os.pipe()
        self._thread = threading.Thread(target=self._carry)
        self._thread.start()

    def _carry(self) -> None:
        heard = b""
        while True:
            ends = (self._board, self._ours, self._socket, self._end)
            ready, _, _ = select.select(ends, (), ())
            if self._end in ready:
                return
            if self._ours in ready:
                os.write(self._board, os.read(self._ours, 64))
            with suppress(ConnectionRefusedError):  # no daemon listens
                if self._socket in ready:
                    text = self._socket.recv(2000).hex().encode()
                    os.write(self._board, b"\x1e" + text + b"\n")
            if self._board in ready:
                heard += os.read(self._board, 4096)
                for found in LINE.finditer(heard):
                    with suppress(ConnectionRefusedError):
                        self._socket.send(bytes.fromhex(found[1].decode()))
                heard = LINE.sub(b"", heard)
                at = heard.find(b"\x1e")
                plain = heard if at < 0 else heard[:at]
                os.write(self._ours, plain)
                heard = heard[len(plain) :]

    def close(self) -> None:
        os.write(self._stop, b"x")
        self._thread.join()
        for end in (self._board, self._ours, self._theirs, self._end, self._stop):
            os.close(end)
        self._socket.close()


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_a_blank_pico_sends_poses_over_the_air(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon_port = free_udp_port()
    rows = [msgspec.structs.replace(row, has_wifi=True) for row in micropython.boards()]
    monkeypatch.setattr(micropython, "boards", lambda: rows)
    monkeypatch.setattr("getpass.getpass", lambda _question: AIR["password"])
    monkeypatch.setattr(flash_micropython, "EVERYWHERE", "127.0.0.1")
    monkeypatch.setattr(flash_micropython, "UDP_PORT", daemon_port)
    # The emulator takes ten times as long as a board.
    monkeypatch.setattr(flash_micropython, "HELLO_S", 600)
    monkeypatch.setattr(micropython, "ANSWER_S", 200)
    monkeypatch.setattr(micropython, "PROMPT_S", 200)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    files = {name.name: (PROGRAMS / name).read_bytes() for name in SIMULATED}
    files["air.json"] = msgspec.json.encode(AIR)
    probe = LiveProbe(Stub(PICO, SIMULATOR, STOCK, tmp_path), "--wire", "usb")
    with ExitStack() as stack:
        stack.callback(probe.end)
        air = stack.enter_context(closing(Air(probe.port, daemon_port)))
        with serial_port.opened(air.port, micropython.BAUD) as wire:
            micropython.Prompt(wire).put(files, lambda _done, _of: None)
        assert cli.main(["flash", air.port, "--wifi", "home", "--yes"]) == 0
        words = ("--config", "imud.toml")
        with DaemonProcess(*words, directory=tmp_path, log=False) as daemon:
            daemon.expect("found on udp:127.0.0.1:")
            with Client(daemon.endpoint) as client:
                (status,) = client.statuses()
                assert client.command(status["probe"], "start")["ok"]
                poses = take(hear(client, "pose"), 20)
                (status,) = client.statuses()
            daemon.stop()
    assert status["hello"]["filter"] == "fuse"  # computed on board
    assert len({pose["number"] for pose in poses}) == 20
    assert status["ledger"]["corrupt"] == 0
