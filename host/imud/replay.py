# SPDX-License-Identifier: MIT
"""`imud replay`: a log once more, as if its probes were there: ptys or Zenoh."""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import zenoh

from imud.client import Client
from imud.errors import FileError, ProbeUnknown
from imud.frame import encode_frame
from imud.logs import Damage, Logged, salvage
from imud.sinks.log import JSON_SCHEMAS

# How often it looks whether somebody has opened a pty.
LOOK_S = 0.02

# At the end a reader has so long to take what is still in the pty: it is lost with it.
DRAIN_S = 5.0

# Where that can't be seen, since the reader lets none open it beside.
LINGER_S = 0.5

# Looks in a row that find nothing left: the kernel moves bytes in two steps.
EMPTY_LOOKS = 3


class PortGone(Exception):
    """Whoever read the pty has closed it: an end, not an error."""


class PtyPort:
    """A serial port on which one probe speaks; what it is told is not heard."""

    def __init__(self, link: Path | None) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self.name = self._tty = os.ttyname(slave)
        self._link = link
        # Held open by none, it tells by its hang-up whether anybody listens.
        os.close(slave)
        if link is not None:
            try:
                if link.is_symlink():
                    link.unlink()
                link.symlink_to(self.name)
            except OSError as error:
                os.close(self._master)
                raise FileError(f"can't make {link}: {error.strerror}") from error
            self.name = str(link)

    def wait_open(self) -> None:
        while self._events(select.POLLOUT, 0) & select.POLLHUP:
            time.sleep(LOOK_S)

    def write(self, data: bytes) -> None:
        """Waits for room: the pace is the reader's where that is slower."""
        while data:
            events = self._events(select.POLLOUT | select.POLLIN, 1000)
            if events & select.POLLHUP:
                raise PortGone
            if events & select.POLLIN:
                with contextlib.suppress(OSError):
                    os.read(self._master, 4096)
            if events & select.POLLOUT:
                with contextlib.suppress(BlockingIOError):
                    data = data[os.write(self._master, data) :]

    def drain(self) -> None:
        """Waits until the reader has taken all."""
        try:
            slave = os.open(self._tty, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:
            time.sleep(LINGER_S)
            return
        try:
            until_s = time.monotonic() + DRAIN_S
            looks = 0
            while looks < EMPTY_LOOKS and time.monotonic() < until_s:
                waiting = fcntl.ioctl(slave, termios.FIONREAD, bytes(4))
                looks = looks + 1 if waiting == bytes(4) else 0
                time.sleep(LOOK_S)
        finally:
            os.close(slave)

    def close(self) -> None:
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        os.close(self._master)

    def _events(self, mask: int, timeout_ms: int) -> int:
        poll = select.poll()
        poll.register(self._master, mask)
        found = poll.poll(timeout_ms)
        return found[0][1] if found else 0


class Pace:
    """Holds messages back until their time; `speed` None: never."""

    def __init__(
        self,
        speed: float | None,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._speed = speed
        self._now = now
        self._sleep = sleep
        self._begin: tuple[int, float] | None = None

    def wait(self, t_ns: int) -> None:
        if self._speed is None:
            return
        if self._begin is None:
            self._begin = t_ns, self._now()
        first_ns, begin_s = self._begin
        due_s = begin_s + (t_ns - first_ns) / 1e9 / self._speed
        if (left_s := due_s - self._now()) > 0:
            self._sleep(left_s)


def _chosen(path: Path, probe: str | None) -> list[str]:
    """The probes of a log that are to speak."""
    names = {
        item.probe
        for item in salvage(path)
        if isinstance(item, Logged) and item.topic == "frame"
    }
    if probe is not None and probe not in names:
        raise ProbeUnknown(
            f"{path} holds no probe {probe}; it holds {', '.join(sorted(names))}"
        )
    if not names:
        raise FileError(f"{path} holds no messages of a probe")
    return [probe] if probe is not None else sorted(names)


def _items(path: Path, names: list[str], pace: Pace) -> Iterator[Logged]:
    for item in salvage(path):
        if isinstance(item, Damage):
            if item.size:
                _say(f"{item.size} bytes of it are damaged and left out")
        elif isinstance(item, Logged) and item.probe in names and item.topic != "hello":
            pace.wait(item.t_ns)
            yield item


def to_ports(
    path: Path, probe: str | None, link: Path | None, speed: float | None
) -> int:
    """The frames of each probe on a pty of its own, from when all are opened on."""
    names = _chosen(path, probe)
    if link is not None and len(names) > 1:
        raise ProbeUnknown(
            f"{path} holds {', '.join(names)} and --link is one port: choose one with "
            "--probe, or leave --link out"
        )
    ports: dict[str, PtyPort] = {}
    count = 0
    try:
        for name in names:
            ports[name] = PtyPort(link)
            port = ports[name].name
            _say(f"probe {name} is on {port}; read it with imud run {port}")
        for each in ports.values():
            each.wait_open()
        for item in _items(path, names, Pace(speed)):
            if item.topic == "frame":
                ports[item.probe].write(encode_frame(item.data))
                count += 1
        for each in ports.values():
            each.drain()
    except PortGone:
        _say(f"whoever read it has gone, after {count} messages")
        return 0
    finally:
        for each in ports.values():
            each.close()
    _say(f"replayed {count} messages")
    return 0


def to_network(
    path: Path, probe: str | None, client: Client, speed: float | None
) -> int:
    """All that was published, on the same keys, into a network that is there."""
    names = _chosen(path, probe)
    session = client.session
    tokens: dict[str, zenoh.LivelinessToken] = {}
    count = 0
    for item in _items(path, names, Pace(speed)):
        key = f"{item.prefix}/{item.probe}"
        if item.probe not in tokens:
            tokens[item.probe] = session.liveliness().declare_token(f"{key}/alive")
        if item.topic in JSON_SCHEMAS:
            encoding = zenoh.Encoding.APPLICATION_JSON
        elif item.topic == "frame":
            encoding = zenoh.Encoding.APPLICATION_OCTET_STREAM
        else:
            continue
        # One that waits: at any speed the network sets the pace and drops nothing.
        session.put(
            f"{key}/{item.topic}",
            item.data,
            encoding=encoding,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        count += 1
    for token in tokens.values():
        token.undeclare()
    _say(f"replayed {count} messages")
    return 0


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
