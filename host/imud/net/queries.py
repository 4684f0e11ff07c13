# SPDX-License-Identifier: MIT
"""Answers what others ask the daemon over Zenoh: the latest status and params of a
probe, and commands.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import zenoh

from imud.commands import HISTORY

# Answers a command: payload and no error, or an error.
Answer = Callable[[bytes, str], None]
# Probe, command, parameters, where the answer goes, and who asks.
OnCommand = Callable[[str, str, dict[str, str], Answer, str], None]

# A query does not tell whose key it had.
BY_NETWORK = "network"


class Queries:
    """Its calls come from threads of Zenoh. `last` has payloads by probe and topic.
    `of` is the part of a key by which the probe was asked.
    """

    def __init__(
        self,
        prefix: str,
        last: Mapping[tuple[str, str], bytes],
        on_command: OnCommand,
    ) -> None:
        self._prefix = prefix
        self._last = last
        self._on_command = on_command

    def _key(self, of: str, last: str) -> str:
        return f"{self._prefix}/{of}/{last}"

    def tell(self, probe: str, of: str, topic: str, query: zenoh.Query) -> None:
        """Answers a query with the last payload of a topic; not at all if there is
        none.
        """
        with query:
            payload = self._last.get((probe, topic))
            if payload is not None:
                query.reply(
                    self._key(of, topic),
                    payload,
                    encoding=zenoh.Encoding.APPLICATION_JSON,
                )

    def tell_params(self, probe: str, of: str, query: zenoh.Query) -> None:
        """The last payload; with parameters, something of the history."""
        if str(query.parameters):
            self.pass_on(probe, HISTORY, self._key(of, "params"), query)
        else:
            self.tell(probe, of, "params", query)

    def take(self, probe: str, of: str, query: zenoh.Query) -> None:
        name = str(query.key_expr).rpartition("/")[2]
        self.pass_on(probe, name, self._key(of, f"cmd/{name}"), query)

    def pass_on(self, probe: str, name: str, key: str, query: zenoh.Query) -> None:
        """Has a command carried out; the answer is on `key`."""
        parameters = dict(_pairs(str(query.parameters)))

        def answer(payload: bytes, error: str) -> None:
            with query:
                if error:
                    query.reply_err(error, encoding=zenoh.Encoding.TEXT_PLAIN)
                else:
                    query.reply(key, payload, encoding=zenoh.Encoding.APPLICATION_JSON)

        self._on_command(probe, name, parameters, answer, BY_NETWORK)


def _pairs(parameters: str) -> list[tuple[str, Any]]:
    """Splits `a=1;b=2`, the parameters of a Zenoh selector."""
    parts = [part.partition("=") for part in parameters.split(";") if part]
    return [(name, value) for name, _, value in parts]
