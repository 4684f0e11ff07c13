# SPDX-License-Identifier: MIT
"""Serves to Foxglove live what the log has for it: the same topics, schemas and JSON,
by foxglove-sdk, whose server runs in threads of its own.
"""

from __future__ import annotations

import json
import logging
import threading
from typing import TYPE_CHECKING

from imud.errors import ConfigError
from imud.log.channels import payload_on, topics_of
from imud.log.schemas import schema_of
from imud.probes.record import Presence, Record
from imud.serving import listen

if TYPE_CHECKING:
    from foxglove import Channel, Context
    from foxglove.websocket import WebSocketServer

CLOSE_S = 0.5

logger = logging.getLogger("imud")


class FoxgloveSink:
    """One channel for each topic of each probe. A client that is too slow loses its
    oldest messages.
    """

    name = "foxglove"
    period_s = 0.0
    patience_s = 0.8

    def __init__(self, address: tuple[str, int], prefix: str) -> None:
        self._address = address
        self._prefix = prefix
        self._context: Context | None = None
        self._server: WebSocketServer | None = None
        self._channels: dict[tuple[str, str], Channel] = {}

    def open(self) -> None:
        """Starts the server; ConfigError without the library, ListenFailed if the
        address is taken.
        """
        try:
            import foxglove
        except ImportError as error:
            raise ConfigError(
                "[foxglove] needs a library: pip install 'imu-probe[foxglove]'"
            ) from error
        host, port = self._address
        # Why one can't listen: the library does not say.
        listen(self._address, "Foxglove", "[foxglove] listen").close()
        self._context = foxglove.Context()
        self._server = foxglove.start_server(
            name="imud", host=host, port=port, context=self._context
        )
        logger.info("Foxglove connects to ws://%s:%s", host, self._server.port)

    def write(self, record: Record | Presence) -> None:
        if not isinstance(record, Record):
            return
        for topic in topics_of(record):
            channel = self._channel(record.probe, topic)
            if channel.has_sinks():
                channel.log(payload_on(record, topic), log_time=record.t_received_ns)

    def flush(self) -> None:
        """Nothing to do: the server sends without this."""

    def close(self) -> None:
        """Ends the server, which gets CLOSE_S for it."""
        server, self._server = self._server, None
        for channel in self._channels.values():
            channel.close()
        self._channels.clear()
        if server is not None:
            # It would wait for a client that does not read.
            ending = threading.Thread(target=server.stop, daemon=True)
            ending.start()
            ending.join(CLOSE_S)

    def _channel(self, probe: str, topic: str) -> Channel:
        known = self._channels.get((probe, topic))
        if known is not None:
            return known
        from foxglove import Channel, Schema

        name, body = schema_of(topic)
        data = json.dumps(body).encode()
        schema = Schema(name=name, encoding="jsonschema", data=data)
        made = Channel(
            f"{self._prefix}/{probe}/{topic}",
            schema=schema,
            message_encoding="json",
            context=self._context,
        )
        self._channels[probe, topic] = made
        return made
