# SPDX-License-Identifier: MIT
"""Publishes every record on its Zenoh key; serves commands and the latest status."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import msgspec
import zenoh
import zenoh.ext
from zenoh.handlers import Callback

from imud.config.settings import ZenohSettings
from imud.errors import NetworkError
from imud.net import access, network, refusals
from imud.net.access import BODIES, BODY_STATE
from imud.net.guard_process import GuardProcess
from imud.net.queries import OnCommand, Queries
from imud.probes.record import Presence, Record


class Publisher:
    """Publishes a topic of a probe by its name and by its id, with both attached. Late
    subscribers can get the last `history` poses.
    """

    def __init__(
        self,
        session: zenoh.Session,
        prefix: str,
        probe: tuple[str, str | None],
        topic: str,
        history: int,
    ) -> None:
        """`probe`: its name and its id, None where that is not known."""
        name, probe_id = probe
        self._each: list[Any] = [
            declare_publisher(session, f"{prefix}/{of}/{topic}", history)
            for of in addresses(name, probe_id)
        ]
        self._attached = f"{probe_id} {name}".encode() if probe_id else None

    def put(self, payload: bytes) -> None:
        for each in self._each:
            each.put(payload, attachment=self._attached)

    def undeclare(self) -> None:
        for each in self._each:
            each.undeclare()


def addresses(name: str, probe_id: str | None) -> list[str]:
    """The parts of keys under which a probe is found."""
    return [name, access.address(probe_id)] if probe_id else [name]


# Time to close: what a slow subscriber has not taken by then is dropped.
PATIENCE_S = 0.8

# Topics of which late subscribers can query the last payload.
KEPT = ("status", "params", "marks")

# Gets lines for the journal: the kind, the text, whether it is a warning.
OnNotice = Callable[[object, str, bool], None]

# Gets the states of bodies that other programs publish: their key and payload.
OnBody = Callable[[str, bytes], None]


class ZenohSink:
    """A Zenoh session that is a router, a peer or a client of a router elsewhere, as
    the settings say. Its callbacks run in threads of Zenoh.
    """

    name = "zenoh"
    period_s = 0.0
    patience_s = PATIENCE_S

    def __init__(
        self,
        settings: ZenohSettings,
        on_command: OnCommand,
        on_notice: OnNotice = lambda *_: None,
        on_body: OnBody = lambda *_: None,
        id_of: Callable[[str], str | None] = lambda _: None,
    ) -> None:
        """`id_of`: the id of the probe of a name; None: unknown. Any thread asks."""
        self._id = network.new_id()
        self._settings = settings
        self._prefix = settings.prefix
        self._on_notice = on_notice
        self._on_body = on_body
        self._id_of = id_of
        self._bodies: zenoh.Subscriber[None] | None = None
        self._session: zenoh.Session | None = None
        self._guard: GuardProcess | None = None
        self._is_guest = network.is_guest(settings)
        self._where = ", ".join(settings.connect)
        self._is_joined: bool | None = None  # with `connect`; None: not tried yet
        self._publishers: dict[tuple[str, str], Publisher] = {}
        self._declared: dict[str, list[Any]] = {}
        self._links: zenoh.LinkEventsListener[None] | None = None
        self._tokens: dict[str, list[zenoh.LivelinessToken]] = {}
        self._known: set[str] = (
            set()
        )  # probes whose liveliness is declared or withdrawn
        self._last: dict[tuple[str, str], bytes] = {}  # by probe and topic
        self._queries = Queries(settings.prefix, self._last, on_command)
        self._elsewhere: set[str] = set()  # probes that went to another daemon

    def open(self) -> None:
        # The daemon may start before the router that it connects to: the sink's thread
        # looks for that with the first record.
        if not self._is_guest:
            self._open()

    @property
    def refused(self) -> Mapping[str, int]:
        """Connections that the guard of its TLS port has refused, and how often that
        process was started again.
        """
        guard = self._guard
        if guard is None:
            return {}
        return {"tls": guard.refused, "guard_restarts": guard.restarts}

    def name_of(self, text: str) -> str:
        """The text with the true addresses of who is connected through the guard."""
        return self._guard.name_of(text) if self._guard is not None else text

    def _open(self) -> zenoh.Session:
        session, self._guard = network.open_guarded(
            self._settings, self._id, self._tell_refused, self._tell_restart
        )
        self._session = session
        self._links = session.info.declare_link_events_listener(self._tell_link)
        self._bodies = session.declare_subscriber(
            f"{self._prefix}/{BODIES}/*/{BODY_STATE}", self._tell_body
        )
        if self._is_guest:
            self._tell_whether(is_joined=True)
        return session

    def _tell_body(self, sample: zenoh.Sample) -> None:
        self._on_body(str(sample.key_expr), sample.payload.to_bytes())

    def try_write(self, record: Record | Presence) -> bool:
        """Publishes a record for which all is declared; False: write() has to. It waits
        for nothing but room in the queues of subscribers.
        """
        session = self._session
        if session is None or isinstance(record, Presence):
            return False
        probe, topic = record.probe, record.topic
        if probe in self._elsewhere or (topic == "status" and probe not in self._known):
            return False
        publisher = self._publishers.get((probe, topic))
        frame = self._publishers.get((probe, "frame"))
        if (record.payload and publisher is None) or (record.content and frame is None):
            return False
        if self._is_guest and not network.is_connected(session):
            return False
        if topic in KEPT:
            self._keep(session, record)
        # JSON first: most subscribers wait for that.
        if record.payload and publisher is not None:
            publisher.put(record.payload)
        if record.content and frame is not None:
            frame.put(record.content)
        return True

    def write(self, record: Record | Presence) -> None:
        """Publishes a record, or who is there. NetworkError once the session with a
        router is lost: the lane opens it again.
        """
        session = self._session
        if session is None:
            if not self._is_guest:
                return
            session = self._open()
        elif self._is_guest and not network.is_connected(session):
            # It would reconnect automatically, and then announce the current probes.
            self.close()
            raise NetworkError(
                f"lost the connection to the Zenoh router at {self._where}"
            )
        if isinstance(record, Presence) and record.is_forgotten:
            self._forget(session, record.probe)
            return
        if record.probe in self._elsewhere:
            if not is_probe_here(record):
                self._leave(record.probe)
                return
            self._elsewhere.discard(record.probe)
        if record.probe not in self._declared:
            self._declare(session, record.probe)
        if isinstance(record, Presence):
            self._set_alive(session, record.probe, is_alive=record.is_alive)
            return
        if record.topic in KEPT:
            self._keep(session, record)
        is_known = record.probe in self._known
        if record.topic == "status" and record.payload and not is_known:
            # Its presence was lost if it came or went while there was no network.
            is_there = is_probe_there(record.payload)
            self._set_alive(session, record.probe, is_alive=is_there)
        if record.payload:
            self._put(session, record.probe, record.topic, record.payload)
        if record.content:
            self._put(session, record.probe, "frame", record.content)

    def _keep(self, session: zenoh.Session, record: Record) -> None:
        """For those who ask later. With each status it looks at the network."""
        if record.payload:
            self._last[record.probe, record.topic] = record.payload
        if record.topic == "status" and self._settings.connect:
            self._tell_whether(is_joined=network.is_connected(session))

    def flush(self) -> None:
        """Nothing to do: a put is sent when it returns."""

    def go_on_for(self, _: ZenohSink) -> None:
        """Keeps the daemon's own session: Zenoh can leave a client that connects while
        a router closes on a connection that nobody serves.
        """
        if self._is_guest:
            self.close()
            return
        own: list[Any] = [*self._publishers.values()]
        own += [each for tokens in self._tokens.values() for each in tokens]
        own += [each for declared in self._declared.values() for each in declared]
        for each in own:
            each.undeclare()
        self._forget_all()

    def close(self) -> None:
        session, self._session = self._session, None
        self._is_joined = self._links = self._bodies = None
        self._forget_all()
        if session is not None:
            session.close()
        if self._guard is not None:
            self._guard.close()
            self._guard = None

    def _forget_all(self) -> None:
        """What is declared for probes."""
        self._publishers.clear()
        self._declared.clear()
        self._tokens.clear()
        self._known.clear()
        self._elsewhere.clear()
        # A status comes again within a second, params only when they change.
        for key in [each for each in self._last if each[1] == "status"]:
            del self._last[key]

    def _key(self, probe: str, last: str) -> str:
        return f"{self._prefix}/{probe}/{last}"

    def _put(self, session: zenoh.Session, probe: str, topic: str, data: bytes) -> None:
        publisher = self._publishers.get((probe, topic))
        if publisher is None:
            both = probe, self._id_of(probe)
            publisher = Publisher(
                *(session, self._prefix, both, topic, self._settings.history)
            )
            self._publishers[probe, topic] = publisher
        publisher.put(data)

    def _declare(self, session: zenoh.Session, probe: str) -> None:
        served: dict[str, Callable[[str, Any], None]] = {
            "status": lambda of, q: self._queries.tell(probe, of, "status", q),
            "params": lambda of, q: self._queries.tell_params(probe, of, q),
            "marks": lambda of, q: self._queries.tell(probe, of, "marks", q),
            "cmd/*": lambda of, q: self._queries.take(probe, of, q),
        }
        self._declared[probe] = [
            session.declare_queryable(self._key(of, end), _direct(partial(serve, of)))
            for of in addresses(probe, self._id_of(probe))
            for end, serve in served.items()
        ]
        self._declared[probe].append(
            # No other program should publish there.
            session.declare_subscriber(
                self._key(probe, "*"),
                _direct(self._tell_other),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        )

    def _leave(self, probe: str) -> None:
        """Withdraws from the keys of a probe that another daemon serves."""
        for each in self._declared.pop(probe, []):
            each.undeclare()
        for key in [each for each in self._last if each[0] == probe]:
            del self._last[key]

    def _forget(self, session: zenoh.Session, probe: str) -> None:
        """Removes everything of a probe that has left permanently."""
        self._set_alive(session, probe, is_alive=False)
        self._leave(probe)
        for key in [each for each in self._publishers if each[0] == probe]:
            self._publishers.pop(key).undeclare()
        self._known.discard(probe)
        self._elsewhere.discard(probe)

    def _tell_other(self, sample: zenoh.Sample) -> None:
        if self._session is None:
            return
        key = str(sample.key_expr)
        probe, topic = key.split("/")[-2:]
        if probe in self._known and probe not in self._tokens:
            # It was unplugged here: from now on it is the other's.
            if probe not in self._elsewhere:
                self._elsewhere.add(probe)
                text = f"network: probe {probe} is now at another imud"
                self._on_notice(("elsewhere", probe), text, False)
            return
        if topic == "status" and is_probe_gone(sample.payload.to_bytes()):
            return  # the last words of the daemon that it has left
        text = (
            f"network: another program also publishes on {key}: don't trust that key; "
            "a second imud may have a probe of this name. docs/security.md explains "
            "how to keep others out"
        )
        # One kind for all keys: invented keys cause only a few lines.
        self._on_notice("other", text, True)

    def _tell_whether(self, *, is_joined: bool) -> None:
        """Tells once that the router is there, or that it is not."""
        if is_joined != self._is_joined:
            lost = (
                "can't reach" if self._is_joined is None else "lost the connection to"
            )
            text = f"{'connected to' if is_joined else lost} {self._where}"
            self._is_joined = is_joined
            self._on_notice(("joined", text), f"network: {text}", not is_joined)

    def _tell_link(self, event: zenoh.LinkEvent) -> None:
        """Tells who connected and with which certificate, where keys are in use."""
        if self._session is None or not self._settings.keys:
            return
        what = "came" if event.kind == zenoh.SampleKind.PUT else "left"
        link = event.link
        if what == "came" and self._guard is not None:
            self._guard.opened(str(link.dst))
        name = link.auth_identifier
        where = self.name_of(str(link.dst))
        refusals.know(str(link.zid), f"{where} ({name})" if name else where)
        by = f" with the certificate of {name}" if name else ""
        self._on_notice(("link", what), f"network: {where} {what}{by}", False)

    def _tell_refused(self, name: str, why: str) -> None:
        text = f"network: refused {name}: TLS: {why}"
        self._on_notice("refused", text, True)

    def _tell_restart(self, why: str) -> None:
        text = (
            f"network: the process that guards the TLS port {why}: it is started "
            "again, and its clients reconnect by themselves"
        )
        self._on_notice("guard", text, True)

    def _set_alive(self, session: zenoh.Session, probe: str, *, is_alive: bool) -> None:
        self._known.add(probe)
        if not is_alive:
            for token in self._tokens.pop(probe, []):
                token.undeclare()
        elif probe not in self._tokens:
            self._tokens[probe] = [
                session.liveliness().declare_token(self._key(of, "alive"))
                for of in addresses(probe, self._id_of(probe))
            ]


def _direct(tell: Callable[[Any], None]) -> Callable[[Any], None]:
    """Called by Zenoh's own threads: it waits for nothing, so it needs none itself."""
    return Callback(tell, indirect=False)


def is_probe_there(status: bytes) -> bool:
    """Whether the status is of a probe that is on a port and speaks our schema."""
    found = msgspec.json.decode(status)
    return found["port"] is not None and found["state"] != "other schema"


def is_probe_here(record: Record | Presence) -> bool:
    """Whether a record says that its probe is on a port of this daemon."""
    if isinstance(record, Presence):
        return record.is_alive
    return record.topic == "status" and is_probe_there(record.payload)


def is_probe_gone(payload: bytes) -> bool:
    """Whether it is the status of a probe that was unplugged."""
    try:
        return bool(msgspec.json.decode(payload)["state"] == "gone")
    except (msgspec.DecodeError, KeyError, TypeError):
        return False


def declare_publisher(
    session: zenoh.Session, key: str, history: int
) -> zenoh.Publisher | zenoh.ext.AdvancedPublisher:
    """A publisher of a topic, the last part of `key`. Late subscribers can get the last
    `history` poses.

    Without `express`: one batch for each message was measured to lose some.
    """
    topic = key.rpartition("/")[2]
    encoding = zenoh.Encoding.APPLICATION_JSON
    if topic == "frame":
        encoding = zenoh.Encoding.APPLICATION_OCTET_STREAM
    drop = zenoh.CongestionControl.DROP
    if topic == "pose" and history:
        return zenoh.ext.declare_advanced_publisher(
            session,
            key,
            encoding=encoding,
            congestion_control=drop,
            cache=zenoh.ext.CacheConfig(max_samples=history),
        )
    return session.declare_publisher(key, encoding=encoding, congestion_control=drop)
