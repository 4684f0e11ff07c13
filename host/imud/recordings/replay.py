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
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeGuard

import zenoh
from mcap.records import Channel

from imud import _core
from imud.client import Client
from imud.errors import ConfigError, FileError, ProbeUnknown
from imud.log.reader import (
    Damage,
    Logged,
    LogHead,
    channels_of,
    salvage,
    size_of,
    split,
)
from imud.net import network
from imud.progress import Progress
from imud.wire import schema
from imud.wire.frame import encode_frame

# How often it looks whether somebody has opened a pty.
LOOK_S = 0.02

# A reader flushes what came while it opened the port. imud takes HUPCL away when it has
# done so; others have had the time to.
SETTLE_S = 0.3

# At the end a reader has so long to take what is still in the pty: it is lost with it.
DRAIN_S = 5.0

# Where that can't be seen, since the reader lets none open it beside.
LINGER_S = 0.5

# Looks in a row that find nothing left: the kernel moves bytes in two steps.
EMPTY_LOOKS = 3

_CFLAG = 2  # its place in what tcgetattr returns

# Of a log, what imud run does not publish.
NOT_PUBLISHED = frozenset({"hello", "pose_in_frame"})


class PortGone(Exception):
    """Whoever read the pty has closed it: an end, not an error."""


class PtyPort:
    """A serial port on which one probe speaks; what it is told is not heard."""

    def __init__(self, link: Path | None) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)
        attributes = termios.tcgetattr(slave)
        attributes[_CFLAG] |= termios.HUPCL
        termios.tcsetattr(slave, termios.TCSANOW, attributes)
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
        until_s = time.monotonic() + SETTLE_S
        while self._is_settling() and time.monotonic() < until_s:
            time.sleep(LOOK_S)

    def _is_settling(self) -> bool:
        return bool(termios.tcgetattr(self._master)[_CFLAG] & termios.HUPCL)

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


@dataclass(frozen=True, slots=True)
class Recording:
    """Logs in the order in which they were begun, and who speaks in them."""

    paths: list[Path]
    probes: list[str]
    prefix: str  # of their keys
    others: tuple[Path, ...] = ()  # whose frames are of another schema


def recording(paths: Sequence[Path], probe: str | None = None) -> Recording:
    """What is to be played: of all the probes in these logs, or of that one."""
    begins: dict[Path, int] = {}
    others = []
    prefixes: dict[str, str] = {}
    for path in paths:
        begin_ns, speakers, is_ours = _contents(path)
        begins[path] = begin_ns
        prefixes |= speakers
        if not is_ours:
            others.append(path)
    where = ", ".join(map(str, paths))
    if not prefixes:
        raise FileError(f"{where}: no messages of a probe")
    if probe is not None and probe not in prefixes:
        raise ProbeUnknown(
            f"{where}: no probe {probe}; there is {', '.join(sorted(prefixes))}"
        )
    names = [probe] if probe is not None else sorted(prefixes)
    ordered = sorted(begins, key=begins.__getitem__)
    return Recording(ordered, names, prefixes[names[0]], tuple(others))


def _contents(path: Path) -> tuple[int, dict[str, str], bool]:
    """When a log begins; its probes, with what their keys begin with; whether it is of
    this schema.
    """
    size = size_of(path)
    known = [each for each in channels_of(path) if isinstance(each, Channel)]
    parts = [split(channel.topic) for channel in known]
    speakers = {probe: prefix for prefix, probe, topic in parts if topic == "frame"}
    is_known = bool(speakers)
    begin_ns = None
    is_ours = True
    bar = Progress("reading", size)
    try:
        for item in salvage(path, bar.update):
            if isinstance(item, LogHead):
                is_ours = item.fingerprint == schema.FINGERPRINT
            if not isinstance(item, Logged) or item.topic == "hello":
                continue
            if begin_ns is None:
                begin_ns = item.t_ns
            if is_known:
                break
            if item.topic == "frame":
                speakers[item.probe] = item.prefix
    finally:
        bar.end()
    return begin_ns or 0, speakers, is_ours


class _Player:
    """Hands out what was logged, when its time comes; tells how far it is."""

    def __init__(self, what: Recording, speed: float | None) -> None:
        self._what = what
        self._pace = Pace(speed)
        self._sizes = {path: size_of(path) for path in what.paths}
        self._bar = Progress("replaying", sum(self._sizes.values()))
        self._begun = 0  # bytes of the files before
        self.count = 0

    def __enter__(self) -> _Player:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._bar.end()
        if kind is None:
            _say(f"replayed {self._messages()}")
        elif issubclass(kind, KeyboardInterrupt):
            _say(f"stopped after {self._messages()}")
        elif issubclass(kind, PortGone):
            _say(f"whoever read it has gone, after {self._messages()}")

    def items(self) -> Iterator[Logged]:
        for path in self._what.paths:
            for item in salvage(path, self._show):
                if isinstance(item, Damage):
                    if item.size:
                        self._bar.wipe()
                        _say(f"{path}: {item.size} damaged bytes are left out")
                elif self._is_played(item):
                    self._pace.wait(item.t_ns)
                    yield item
            self._begun += self._sizes[path]

    def _show(self, at: int) -> None:
        self._bar.update(self._begun + at)

    def _is_played(self, item: LogHead | Logged) -> TypeGuard[Logged]:
        return (
            isinstance(item, Logged)
            and item.probe in self._what.probes
            and item.topic not in NOT_PUBLISHED
        )

    def _messages(self) -> str:
        return "1 message" if self.count == 1 else f"{self.count} messages"


def to_ports(what: Recording, link: Path | None, speed: float | None) -> int:
    """The frames of each probe on a pty of its own, from when all are opened on."""
    if link is not None and len(what.probes) > 1:
        raise ProbeUnknown(
            f"there are {', '.join(what.probes)} and --link is one port: choose one "
            "with --probe, or leave --link out"
        )
    if what.others:
        raise FileError(
            f"{what.others[0]} is of another schema than this imud; take the imud that "
            "wrote it, or replay what it said with --connect"
        )
    ports: dict[str, PtyPort] = {}
    strange = 0
    try:
        with _Player(what, speed) as player:
            for name in what.probes:
                ports[name] = PtyPort(link)
                port = ports[name].name
                _say(f"probe {name} is on {port}; read it with imud run {port}")
            for each in ports.values():
                each.wait_open()
            for item in player.items():
                if item.topic != "frame":
                    continue
                if not 1 <= len(item.data) <= _core.CONTENT_MAX:
                    strange += 1
                    continue
                ports[item.probe].write(encode_frame(item.data))
                player.count += 1
            for each in ports.values():
                each.drain()
    except PortGone:
        pass
    finally:
        for each in ports.values():
            each.close()
    if strange:
        sys.stderr.write(f"{strange} that are no messages of a probe were left out\n")
    return 0


class NetworkProbe:
    """What a daemon has of one probe on the network: liveliness, the last status for
    who asks, and a refusal for who commands.
    """

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._key = key
        self._status = b""
        self._declared: list[object] = [
            session.declare_queryable(f"{key}/status", self._tell_status),
            session.declare_queryable(f"{key}/cmd/*", self._refuse),
        ]
        self._token = session.liveliness().declare_token(f"{key}/alive")

    def take(self, item: Logged) -> None:
        if item.topic == "status":
            self._status = item.data

    def close(self) -> None:
        self._token.undeclare()
        self._declared.clear()

    def _tell_status(self, query: zenoh.Query) -> None:
        with query:
            if self._status:
                query.reply(f"{self._key}/status", self._status, encoding=_JSON)

    def _refuse(self, query: zenoh.Query) -> None:
        with query:
            query.reply_err(
                "it is a log that is replayed, which takes no commands",
                encoding=zenoh.Encoding.TEXT_PLAIN,
            )


_JSON = zenoh.Encoding.APPLICATION_JSON


def connected(what: Recording, endpoint: str | None, keys: Path | None) -> Client:
    """The network, as one who may publish in it."""
    if keys is not None and network.read_credentials(keys).role != "daemon":
        raise ConfigError(
            f"{keys}: only a daemon may publish; imud keys add DIR daemon NAME makes "
            "its file"
        )
    if endpoint is None:
        return Client(prefix=what.prefix, keys=keys)
    return Client(endpoint, what.prefix, keys)


def to_network(what: Recording, client: Client, speed: float | None) -> int:
    """All that was published, on the same keys, into a network that is there."""
    session = client.session
    for name in sorted({*what.probes} & {*client.alive()}):
        raise ProbeUnknown(
            f"a probe {name} is there already, and two on one key can't be told apart; "
            "replay where it is not, or choose others with --probe"
        )
    probes: dict[str, NetworkProbe] = {}
    try:
        with _Player(what, speed) as player:
            for item in player.items():
                key = f"{item.prefix}/{item.probe}"
                if item.probe not in probes:
                    probes[item.probe] = NetworkProbe(session, key)
                probes[item.probe].take(item)
                is_frame = item.topic == "frame"
                # One that waits: at any speed the network sets the pace and drops
                # nothing.
                session.put(
                    f"{key}/{item.topic}",
                    item.data,
                    encoding=zenoh.Encoding.APPLICATION_OCTET_STREAM
                    if is_frame
                    else _JSON,
                    congestion_control=zenoh.CongestionControl.BLOCK,
                )
                player.count += 1
    finally:
        for each in probes.values():
            each.close()
    return 0


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
