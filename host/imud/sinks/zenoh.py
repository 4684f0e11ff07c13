# SPDX-License-Identifier: MIT
"""The network: every record on its Zenoh key, commands and last status on request."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import zenoh
import zenoh.ext

from imud import network
from imud.config import Zenoh
from imud.errors import NetworkError
from imud.record import Presence, Record

# At the end: what a slow subscriber has not taken by then is dropped.
PATIENCE_S = 0.8

# Answers a command: payload and no error, or an error.
Answer = Callable[[bytes, str], None]
OnCommand = Callable[[str, str, dict[str, str], Answer], None]

# Takes what is worth a line: of which kind it is, the line, whether it is a warning.
OnNotice = Callable[[object, str, bool], None]


class ZenohSink:
    """A Zenoh session of the daemon's own, or a part of a network there is. Callbacks
    are called in threads of Zenoh's.
    """

    name = "zenoh"
    period_s = 0.0
    patience_s = PATIENCE_S

    def __init__(
        self,
        settings: Zenoh,
        on_command: OnCommand,
        on_notice: OnNotice = lambda *_: None,
    ) -> None:
        self._settings = settings
        self._prefix = settings.prefix
        self._on_command = on_command
        self._on_notice = on_notice
        self._session: zenoh.Session | None = None
        self._is_client = settings.mode == "client"
        self._has_begun = False
        self._publishers: dict[
            tuple[str, str], zenoh.Publisher | zenoh.ext.AdvancedPublisher
        ] = {}
        self._declared: dict[str, list[object]] = {}
        self._links: zenoh.LinkEventsListener[None] | None = None
        self._alive: set[str] = set()
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        self._status: dict[str, bytes] = {}

    def open(self) -> None:
        # The daemon begins before the router of which it is to be a client: that is
        # looked for by the sink's thread, with the first record.
        if self._is_client and not self._has_begun:
            self._has_begun = True
            return
        self._open()

    def _open(self) -> zenoh.Session:
        session = network.open_daemon(self._settings)
        self._session = session
        self._links = session.info.declare_link_events_listener(self._tell_link)
        for probe in self._alive:
            self._declare_token(session, probe)
        if self._is_client:
            text = f"network: connected to {', '.join(self._settings.connect)}"
            self._on_notice("connected", text, False)
        return session

    def take(self, record: Record | Presence) -> None:
        if isinstance(record, Presence):
            # Remembered for a session that is opened later.
            (self._alive.add if record.is_alive else self._alive.discard)(record.probe)
        session = self._session
        if session is None:
            if not self._is_client:
                return
            session = self._open()
        elif self._is_client and not session.info.routers_zid():
            where = ", ".join(self._settings.connect)
            raise NetworkError(f"the Zenoh router at {where} is gone")
        if record.probe not in self._declared:
            self._declare(session, record.probe)
        if isinstance(record, Presence):
            self._set_alive(session, record)
            return
        if record.topic == "status" and record.payload:
            self._status[record.probe] = record.payload
        if record.content:
            self._put(session, record.probe, "frame", record.content)
        if record.payload:
            self._put(session, record.probe, record.topic, record.payload)

    def flush(self) -> None:
        """Nothing waits here: a put is on its way when it returns."""

    def close(self) -> None:
        session, self._session = self._session, None
        self._publishers.clear()
        self._declared.clear()
        self._tokens.clear()
        self._links = None
        if session is not None:
            session.close()

    def _key(self, probe: str, last: str) -> str:
        return f"{self._prefix}/{probe}/{last}"

    def _put(self, session: zenoh.Session, probe: str, topic: str, data: bytes) -> None:
        publisher = self._publishers.get((probe, topic))
        if publisher is None:
            publisher = self._publisher(session, probe, topic)
            self._publishers[probe, topic] = publisher
        publisher.put(data)

    def _publisher(
        self, session: zenoh.Session, probe: str, topic: str
    ) -> zenoh.Publisher | zenoh.ext.AdvancedPublisher:
        """Not express: one batch a message was measured to lose some."""
        key = self._key(probe, topic)
        encoding = zenoh.Encoding.APPLICATION_JSON
        if topic == "frame":
            encoding = zenoh.Encoding.APPLICATION_OCTET_STREAM
        drop = zenoh.CongestionControl.DROP
        if topic == "pose" and self._settings.history:
            return zenoh.ext.declare_advanced_publisher(
                session,
                key,
                encoding=encoding,
                congestion_control=drop,
                cache=zenoh.ext.CacheConfig(max_samples=self._settings.history),
            )
        return session.declare_publisher(
            key, encoding=encoding, congestion_control=drop
        )

    def _declare(self, session: zenoh.Session, probe: str) -> None:
        status = self._key(probe, "status")
        command = self._key(probe, "cmd/*")
        self._declared[probe] = [
            session.declare_queryable(status, lambda q: self._tell_status(probe, q)),
            session.declare_queryable(command, lambda q: self._take_query(probe, q)),
            # Nobody else has anything to say there.
            session.declare_subscriber(
                self._key(probe, "*"),
                self._tell_other,
                allowed_origin=zenoh.Locality.REMOTE,
            ),
        ]

    def _tell_other(self, sample: zenoh.Sample) -> None:
        if self._session is not None:
            key = str(sample.key_expr)
            text = (
                f"network: another publishes on {key}, too; don't trust it: is there a "
                "second imud with this probe's name? docs/security.md keeps others out"
            )
            self._on_notice(("other", key), text, True)

    def _tell_link(self, event: zenoh.LinkEvent) -> None:
        """On record where keys rule: who came, by which certificate."""
        if self._session is None or not self._settings.keys:
            return
        what = "came" if event.kind == zenoh.SampleKind.PUT else "left"
        link = event.link
        shown = f" with the certificate of {link.auth_identifier}"
        by = shown if link.auth_identifier else ""
        self._on_notice(("link", what), f"network: {link.dst} {what}{by}", False)

    def _set_alive(self, session: zenoh.Session, presence: Presence) -> None:
        if presence.is_alive:
            self._declare_token(session, presence.probe)
        elif (token := self._tokens.pop(presence.probe, None)) is not None:
            token.undeclare()

    def _declare_token(self, session: zenoh.Session, probe: str) -> None:
        if probe not in self._tokens:
            key = self._key(probe, "alive")
            self._tokens[probe] = session.liveliness().declare_token(key)

    def _tell_status(self, probe: str, query: zenoh.Query) -> None:
        with query:
            payload = self._status.get(probe)
            if payload is not None:
                query.reply(
                    self._key(probe, "status"),
                    payload,
                    encoding=zenoh.Encoding.APPLICATION_JSON,
                )

    def _take_query(self, probe: str, query: zenoh.Query) -> None:
        name = str(query.key_expr).rpartition("/")[2]
        parameters = dict(_pairs(str(query.parameters)))

        def answer(payload: bytes, error: str) -> None:
            with query:
                if error:
                    query.reply_err(error, encoding=zenoh.Encoding.TEXT_PLAIN)
                else:
                    query.reply(
                        self._key(probe, f"cmd/{name}"),
                        payload,
                        encoding=zenoh.Encoding.APPLICATION_JSON,
                    )

        self._on_command(probe, name, parameters, answer)


def _pairs(parameters: str) -> list[tuple[str, Any]]:
    """`a=1;b=2`, as a selector carries it after its question mark."""
    parts = [part.partition("=") for part in parameters.split(";") if part]
    return [(name, value) for name, _, value in parts]
