# SPDX-License-Identifier: MIT
"""`imud replay`: plays logs as if their probes were there, on ptys or over Zenoh."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeGuard

import zenoh
from mcap.records import Channel

from imud import _core
from imud.client import Client
from imud.errors import ConfigError, FileError, ProbeUnknown
from imud.log.parts import Damage, channels_of
from imud.log.reader import METADATA_OF_PROBES, Logged, LogHead, salvage, size_of, split
from imud.net import network
from imud.progress import Progress
from imud.recordings.opening import Opening
from imud.recordings.pty import PortGone, PtyPort
from imud.wire import kept
from imud.wire.frame import encode_frame
from imud.wire.kept import as_ours

# What the metadata say, and topics of a log that `imud run` does not publish.
METADATA = frozenset(METADATA_OF_PROBES.values())
NOT_PUBLISHED = METADATA | {"pose_in_frame"}

# Topics of which late subscribers can query the last payload.
KEPT = ("status", "params")


class Pacer:
    """Holds each message back until its time; a `speed` of None plays without waits."""

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
        """Sleeps until a message of that time is due; the first one is due at once."""
        if self._speed is None:
            return
        if self._begin is None:
            self._begin = t_ns, self._now()
        first_ns, begin_s = self._begin
        due_s = begin_s + (t_ns - first_ns) / 1e9 / self._speed
        if (left_s := due_s - self._now()) > 0:
            self._sleep(left_s)


@dataclass(frozen=True, slots=True)
class LogSet:
    """Logs, ordered by their first message, and the probes in them."""

    paths: list[Path]
    probes: list[str]
    prefix: str  # of their keys
    others: tuple[Path, ...] = ()  # logs with frames of a schema that is not kept


def log_set(paths: Sequence[Path], probe: str | None = None) -> LogSet:
    """The source of a replay: all probes of these logs, or only `probe`.

    Raises FileError for logs without messages, ProbeUnknown for a probe not in them.
    """
    begins: dict[Path, int] = {}
    others = []
    prefixes: dict[str, str] = {}
    for path in paths:
        begin_ns, speakers, is_read = _contents(path)
        begins[path] = begin_ns
        prefixes |= speakers
        if not is_read:
            others.append(path)
    where = ", ".join(map(str, paths))
    if not prefixes:
        raise FileError(f"{where}: no messages of a probe")
    if probe is not None and probe not in prefixes:
        raise ProbeUnknown(
            f"{where}: no probe {probe}; available: {', '.join(sorted(prefixes))}"
        )
    names = [probe] if probe is not None else sorted(prefixes)
    ordered = sorted(begins, key=begins.__getitem__)
    return LogSet(ordered, names, prefixes[names[0]], tuple(others))


def _contents(path: Path) -> tuple[int, dict[str, str], bool]:
    """A log's first time (ns), its probes with the prefix of their keys, and whether
    its frames are of a kept schema.
    """
    size = size_of(path)
    known = [each for each in channels_of(path) if isinstance(each, Channel)]
    parts = [split(channel.topic) for channel in known]
    speakers = {probe: prefix for prefix, probe, topic in parts if topic == "frame"}
    is_known = bool(speakers)
    begin_ns = None
    is_read = True
    bar = Progress("reading", size)
    try:
        for item in salvage(path, bar.update):
            if isinstance(item, LogHead):
                is_read = kept.find(item.fingerprint) is not None
            if not isinstance(item, Logged) or item.topic in NOT_PUBLISHED:
                continue
            if begin_ns is None:
                begin_ns = item.t_ns
            if is_known:
                break
            if item.topic == "frame":
                speakers[item.probe] = item.prefix
    finally:
        bar.end()
    return begin_ns or 0, speakers, is_read


class _Player:
    """Yields logged messages when they are due, and shows the progress."""

    def __init__(self, what: LogSet, speed: float | None) -> None:
        self._what = what
        self._pace = Pacer(speed)
        self._sizes = {path: size_of(path) for path in what.paths}
        self._bar = Progress("replaying", sum(self._sizes.values()))
        self._begun = 0  # bytes of the files before
        self.count = 0
        self.openings = {name: Opening() for name in what.probes}

    def __enter__(self) -> _Player:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._bar.end()
        if kind is None:
            _say(f"replayed {self._messages()}")
        elif issubclass(kind, KeyboardInterrupt):
            _say(f"stopped after {self._messages()}")
        elif issubclass(kind, PortGone):
            _say(f"the reader closed the port after {self._messages()}")

    def items(self) -> Iterator[Logged]:
        for path in self._what.paths:
            for item in salvage(path, self._show):
                if isinstance(item, Damage):
                    if item.size:
                        self._bar.wipe()
                        _say(f"{path}: skipped {item.size} damaged bytes")
                elif isinstance(item, Logged) and item.topic in METADATA:
                    if item.probe in self.openings:
                        self.openings[item.probe].add(item.topic, item.data)
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


def to_ports(what: LogSet, link: Path | None, speed: float | None) -> int:
    """Plays the frames of each probe on its own pty, once all ptys have a reader.

    `speed` is a factor of real time, None: as fast as the readers take it. Returns 0.
    """
    if link is not None and len(what.probes) > 1:
        raise ProbeUnknown(
            f"there are {', '.join(what.probes)} but --link is one port: choose one "
            "with --probe, or leave out --link"
        )
    if what.others:
        raise FileError(
            f"{what.others[0]} has another schema than this imud; use the version "
            "that wrote it, or replay its published messages with --connect"
        )
    ports: dict[str, PtyPort] = {}
    strange = 0
    try:
        with _Player(what, speed) as player:
            for name in what.probes:
                ports[name] = PtyPort(link)
                port = ports[name].name
                _say(f"probe {name} is on {port}; it waits for imud run {port}")
            for each in ports.values():
                each.wait_open()
            for item in player.items():
                if item.topic != "frame":
                    continue
                if not 1 <= len(item.data) <= _core.CONTENT_MAX:
                    strange += 1
                    continue
                opening = player.openings.pop(item.probe, None)
                if opening is not None:
                    for content in opening.contents(item.data):
                        ports[item.probe].write(encode_frame(as_ours(content)))
                ports[item.probe].write(encode_frame(as_ours(item.data)))
                player.count += 1
            left = sum(each.drain() for each in ports.values())
            if left:
                sys.stderr.write(f"the reader did not read the last {left} bytes\n")
    except PortGone:
        pass
    finally:
        for each in ports.values():
            each.close()
    if strange:
        sys.stderr.write(f"left out {strange} invalid frames\n")
    return 0


class NetworkProbe:
    """A replayed probe on the network: its liveliness, its last status and params on
    request, and a refusal for every command. `params`: those of before the log.
    """

    def __init__(self, session: zenoh.Session, key: str, params: bytes) -> None:
        self._key = key
        self._last = {"params": params}
        self._declared: list[object] = [
            session.declare_queryable(
                f"{key}/status", lambda q: self._tell("status", q)
            ),
            session.declare_queryable(f"{key}/params", self._tell_params),
            session.declare_queryable(f"{key}/cmd/*", self._refuse),
        ]
        self._token = session.liveliness().declare_token(f"{key}/alive")

    def keep(self, item: Logged) -> None:
        if item.topic in KEPT:
            self._last[item.topic] = item.data

    def close(self) -> None:
        self._token.undeclare()
        self._declared.clear()

    def _tell(self, topic: str, query: zenoh.Query) -> None:
        with query:
            if payload := self._last.get(topic):
                query.reply(f"{self._key}/{topic}", payload, encoding=_JSON)

    def _tell_params(self, query: zenoh.Query) -> None:
        if str(query.parameters):
            self._refuse(query)  # the history
        else:
            self._tell("params", query)

    def _refuse(self, query: zenoh.Query) -> None:
        with query:
            query.reply_err(
                "this is a replay of a log, which accepts no commands and has no "
                "history",
                encoding=zenoh.Encoding.TEXT_PLAIN,
            )


_JSON = zenoh.Encoding.APPLICATION_JSON


def connected(what: LogSet, endpoint: str | None, keys: Path | None) -> Client:
    """A client that may publish; ConfigError for keys that are not a daemon's."""
    if keys is not None and network.read_credentials(keys).role != "daemon":
        raise ConfigError(
            f"{keys}: only the role daemon may publish; create its file with imud "
            "keys add DIR daemon NAME"
        )
    if endpoint is None:
        return Client(prefix=what.prefix, keys=keys)
    return Client(endpoint, what.prefix, keys)


def to_network(what: LogSet, client: Client, speed: float | None) -> int:
    """Publishes all that the daemon had published, on the same keys.

    `speed` is a factor of real time, None: as fast as the network takes it. Raises
    ProbeUnknown if a probe of that name is alive there. Returns 0.
    """
    session = client.session
    for name in sorted({*what.probes} & {*client.alive()}):
        raise ProbeUnknown(
            f"a probe {name} already exists on this network, and two on one key can't "
            "be distinguished; replay on another network, or choose another probe "
            "with --probe"
        )
    probes: dict[str, NetworkProbe] = {}
    try:
        with _Player(what, speed) as player:
            for item in player.items():
                key = f"{item.prefix}/{item.probe}"
                if item.probe not in probes:
                    opening = player.openings[item.probe]
                    params = opening.payload(item.probe, item.t_ns)
                    probes[item.probe] = NetworkProbe(session, key, params)
                probes[item.probe].keep(item)
                is_frame = item.topic == "frame"
                # BLOCK: a slow network slows the replay down and drops nothing.
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
