# SPDX-License-Identifier: MIT
"""The network: every record on its Zenoh key, commands and last status on request."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import zenoh

from imud.errors import ListenFailed
from imud.record import Presence, Record

# Microseconds that a put waits for room towards a slow subscriber before the message
# is dropped for it. Zenoh's own 1 ms loses messages when a machine is busy; the wait
# is this sink's thread's and no one else's.
WAIT_BEFORE_DROP_US = 50_000

# At the end: what a slow subscriber has not taken by then is dropped.
PATIENCE_S = 0.8

# Answers a command: payload and no error, or an error.
Answer = Callable[[bytes, str], None]
OnCommand = Callable[[str, str, dict[str, str], Answer], None]


class ZenohSink:
    """An in-process Zenoh router; `on_command` is called in a thread of Zenoh's."""

    name = "zenoh"
    period_s = 0.0
    patience_s = PATIENCE_S

    def __init__(
        self, endpoints: tuple[str, ...], prefix: str, on_command: OnCommand
    ) -> None:
        self._endpoints = endpoints
        self._prefix = prefix
        self._on_command = on_command
        self._session: zenoh.Session | None = None
        self._publishers: dict[tuple[str, str], zenoh.Publisher] = {}
        self._queryables: dict[str, list[zenoh.Queryable[None]]] = {}
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        self._status: dict[str, bytes] = {}

    def open(self) -> None:
        config = zenoh.Config()
        for key, value in {
            "mode": "router",
            "listen/endpoints": list(self._endpoints),
            "listen/exit_on_failure": True,
            "scouting/multicast/enabled": False,
            "timestamping/enabled": True,
            "transport/link/tx/queue/congestion_control/drop/wait_before_drop": (
                WAIT_BEFORE_DROP_US
            ),
        }.items():
            config.insert_json5(key, json.dumps(value))
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise ListenFailed(
                f"can't listen on {', '.join(self._endpoints)}: it is taken or not an "
                "address of this machine; stop the other imud run or name another "
                "with --listen"
            ) from error

    def take(self, record: Record | Presence) -> None:
        if self._session is None:
            return
        if record.probe not in self._queryables:
            self._declare(self._session, record.probe)
        if isinstance(record, Presence):
            self._set_alive(self._session, record)
            return
        if record.topic == "status" and record.payload:
            self._status[record.probe] = record.payload
        if record.content:
            self._put(self._session, record.probe, "frame", record.content)
        if record.payload:
            self._put(self._session, record.probe, record.topic, record.payload)

    def flush(self) -> None:
        """Nothing waits here: a put is on its way when it returns."""

    def close(self) -> None:
        session, self._session = self._session, None
        self._publishers.clear()
        self._queryables.clear()
        self._tokens.clear()
        if session is not None:
            session.close()

    def _key(self, probe: str, last: str) -> str:
        return f"{self._prefix}/{probe}/{last}"

    def _put(self, session: zenoh.Session, probe: str, topic: str, data: bytes) -> None:
        publisher = self._publishers.get((probe, topic))
        if publisher is None:
            is_frame = topic == "frame"
            # Not express: one batch a message was measured to lose some.
            publisher = session.declare_publisher(
                self._key(probe, topic),
                encoding=zenoh.Encoding.APPLICATION_OCTET_STREAM
                if is_frame
                else zenoh.Encoding.APPLICATION_JSON,
                congestion_control=zenoh.CongestionControl.DROP,
            )
            self._publishers[probe, topic] = publisher
        publisher.put(data)

    def _declare(self, session: zenoh.Session, probe: str) -> None:
        status = self._key(probe, "status")
        command = self._key(probe, "cmd/*")
        self._queryables[probe] = [
            session.declare_queryable(status, lambda q: self._tell_status(probe, q)),
            session.declare_queryable(command, lambda q: self._take_query(probe, q)),
        ]

    def _set_alive(self, session: zenoh.Session, presence: Presence) -> None:
        token = self._tokens.pop(presence.probe, None)
        if presence.is_alive:
            key = self._key(presence.probe, "alive")
            liveliness = session.liveliness()
            self._tokens[presence.probe] = token or liveliness.declare_token(key)
        elif token is not None:
            token.undeclare()

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
