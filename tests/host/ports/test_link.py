# SPDX-License-Identifier: MIT
"""A port in the loop: all bytes come and go, whatever the port takes at a time."""

from __future__ import annotations

import array
import asyncio
import errno
import fcntl
import os
import queue
import termios
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
import serial
from serial import serialposix

from fakes import PATIENCE_S, Port
from imud.errors import LinkError, PortLost
from imud.ports import link
from imud.ports.link import PENDING_MAX, Link


class Opened:
    """A link on a pty in a loop, and what it told."""

    def __init__(self, directory: Path) -> None:
        self.port = Port(directory / "port")
        self.data = b""
        self.fault: asyncio.Future[LinkError] = (
            asyncio.get_running_loop().create_future()
        )
        self.is_open = asyncio.Event()
        self.heard = asyncio.Event()
        self.link = Link(
            str(self.port.path),
            500_000,
            on_open=self.is_open.set,
            on_data=self._keep,
            on_fault=self._fail,
        )
        self.task = asyncio.create_task(self.link.run())

    def _keep(self, data: bytes, _: int) -> None:
        self.data += data
        self.heard.set()

    def _fail(self, error: LinkError) -> None:
        if not self.fault.done():
            self.fault.set_result(error)


def with_link(path: Path, check: Callable[[Opened], Awaitable[None]]) -> None:
    async def run() -> None:
        opened = Opened(path)
        await asyncio.wait_for(opened.is_open.wait(), PATIENCE_S)
        await asyncio.wait_for(check(opened), PATIENCE_S)
        opened.task.cancel()
        await asyncio.gather(opened.task, return_exceptions=True)
        opened.port.vanish()

    asyncio.run(run())


def test_a_port_that_takes_bytes_slowly_gets_them_all_in_order(tmp_path: Path) -> None:
    async def check(opened: Opened) -> None:
        sent = b""
        with pytest.raises(PortLost, match="accepts no bytes; unplug it"):
            for number in range(1000):
                block = number.to_bytes(2, "little") * 64
                opened.link.write(block)
                sent += block
        assert len(sent) > PENDING_MAX
        received = b""
        while len(received) < len(sent):
            received += opened.port.read()
            await asyncio.sleep(0)  # lets the loop write what has room by then
        assert received == sent

    with_link(tmp_path, check)


def test_bytes_come_as_they_were_sent(tmp_path: Path) -> None:
    async def check(opened: Opened) -> None:
        sent = bytes(range(256)) * 3
        opened.port.write(sent)
        while len(opened.data) < len(sent):
            await opened.heard.wait()
            opened.heard.clear()
        assert opened.data == sent

    with_link(tmp_path, check)


def test_a_hang_up_is_a_fault_and_writing_then_is_one_too(tmp_path: Path) -> None:
    async def check(opened: Opened) -> None:
        opened.port.vanish()
        assert isinstance(await opened.fault, PortLost)
        assert not opened.link.is_open
        with pytest.raises(PortLost, match="is not open"):
            opened.link.write(b"x")

    with_link(tmp_path, check)


def test_dtr_is_left_active_so_that_a_board_is_not_reset_again(tmp_path: Path) -> None:
    async def check(opened: Opened) -> None:
        other = os.open(opened.port.path, os.O_RDWR | os.O_NOCTTY)
        flags = termios.tcgetattr(other)[2]
        os.close(other)
        assert not flags & termios.HUPCL

    with_link(tmp_path, check)


# linux/tty_flags.h, and the place of `flags` in struct serial_struct.
ASYNC_LOW_LATENCY = 1 << 13
FLAGS = 4


class Driver:
    """A serial driver's answers to TIOCGSERIAL and TIOCSSERIAL, in place of a pty's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, refuses: int = 0) -> None:
        self.flags = 0x40  # one that is set already
        self.sets = 0
        self._refuses = refuses
        self._ioctl: Callable[..., int] = fcntl.ioctl
        monkeypatch.setattr(fcntl, "ioctl", self)

    def __call__(
        self, fd: int, request: int, argument: array.array[int] | bytes
    ) -> int:
        if request not in (termios.TIOCGSERIAL, termios.TIOCSSERIAL):
            return self._ioctl(fd, request, argument)
        assert isinstance(argument, array.array)
        if request == termios.TIOCGSERIAL:
            argument[FLAGS] = self.flags
            return 0
        self.sets += 1
        if self._refuses:
            raise OSError(self._refuses, os.strerror(self._refuses))
        self.flags = argument[FLAGS]
        return 0


def test_an_ftdis_driver_is_asked_for_low_latency(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = Driver(monkeypatch)

    async def check(opened: Opened) -> None:
        assert opened.link.is_open
        assert driver.flags == 0x40 | ASYNC_LOW_LATENCY

    with_link(tmp_path, check)


@pytest.mark.parametrize("code", [errno.ENOTTY, errno.EPERM, errno.EIO])
def test_a_driver_that_refuses_low_latency_carries_bytes_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    driver = Driver(monkeypatch, refuses=code)

    async def check(opened: Opened) -> None:
        opened.port.write(b"hello")
        while opened.data != b"hello":
            await opened.heard.wait()
            opened.heard.clear()

    with_link(tmp_path, check)
    assert driver.sets == 1
    assert driver.flags == 0x40


def test_a_system_without_low_latency_opens_ports_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What pyserial does on a system of which it knows no such flag.
    name = "set_low_latency_mode"
    refuse = getattr(serialposix.PlatformSpecificBase, name)
    monkeypatch.setattr(serialposix.Serial, name, refuse)

    async def check(opened: Opened) -> None:
        assert opened.link.is_open

    with_link(tmp_path, check)


@pytest.mark.parametrize("name", ["rfcomm0", "ttyUSB0"])
def test_a_port_that_opens_slowly_holds_nothing_else_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """One of Bluetooth waits for its other end, a dead USB adapter for seconds."""
    port = Port(tmp_path / name)
    answered, opened = threading.Event(), threading.Event()
    plain = link._open

    def slow(name: str, baud: int) -> serial.Serial:
        answered.wait(PATIENCE_S)
        found = plain(name, baud)
        opened.set()
        return found

    monkeypatch.setattr(link, "_open", slow)

    async def run() -> None:
        is_open = asyncio.Event()
        first, second = (
            Link(
                str(port.path),
                500_000,
                on_open=is_open.set,
                on_data=lambda *_: None,
                on_fault=lambda _: None,
            )
            for _ in range(2)
        )
        # Nobody waits any more: what is opened then is closed at once.
        left = asyncio.create_task(first.run())
        await asyncio.sleep(0.05)  # both threads have their turn
        left.cancel()
        await asyncio.gather(left, return_exceptions=True)
        answered.set()
        await asyncio.to_thread(opened.wait, PATIENCE_S)
        await asyncio.sleep(0.05)  # both threads have their turn
        serving = asyncio.create_task(second.run())
        await asyncio.wait_for(is_open.wait(), PATIENCE_S)
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)

    asyncio.run(run())
    port.vanish()


def test_a_port_that_sets_its_rate_or_closes_slowly_holds_nothing_else_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on, asked = threading.Event(), queue.SimpleQueue[str]()

    def slow(what: str) -> None:
        asked.put(what)
        go_on.wait(PATIENCE_S)

    monkeypatch.setattr(link, "_set_baud", lambda *_: slow("baud") or True)
    monkeypatch.setattr(link, "_close", lambda port: slow("close") or port.close())
    monkeypatch.setattr(link, "CLOSE_S", 0.0)

    async def check(opened: Opened) -> None:
        opened.link.set_baud(9600)
        assert opened.link.baud == 9600
        assert await asyncio.to_thread(asked.get) == "baud"

    with_link(tmp_path, check)  # ends beside the thread that still waits
    go_on.set()
    assert asked.get() == "close"
