# SPDX-License-Identifier: MIT
"""A probe in the metadata of a log: its hello and params, which it may have
told before the log began.
"""

from __future__ import annotations

import msgspec

from imud.log.reader import METADATA_OF_PROBES
from imud.params.value import payload_of
from imud.wire import messages
from imud.wire.messages import Message
from imud.wire.params import digest_of, messages_of

HELLO, PARAMS = (METADATA_OF_PROBES[name] for name in ("hello", "params"))


class Opening:
    """The state of one probe when a log begins."""

    def __init__(self) -> None:
        self._hello: Message | None = None
        self._sets: dict[int, bytes] = {}

    def add(self, topic: str, data: bytes) -> None:
        """Adds metadata. Those of later changes come ahead of them: the first hello
        says which params are in force.
        """
        if topic == PARAMS:
            self._sets[digest_of(data)] = data
        elif topic == HELLO and self._hello is None:
            message = messages.decode(data)
            if isinstance(message, Message) and message.name == "hello":
                self._hello = message

    @property
    def records(self) -> bytes | None:
        """The records of the params in force; None: the metadata do not tell them."""
        if self._hello is None:
            return None
        digest = self._hello.fields["params_digest"]
        if not isinstance(digest, int):
            return None
        return b"" if digest == 0 else self._sets.get(digest)

    def payload(self, probe: str, t_ns: int) -> bytes:
        """The params as a daemon publishes them, known since `t_ns` UTC; empty: not
        known.
        """
        records = self.records
        if self._hello is None or records is None:
            return b""
        probe_id = self._hello.fields["probe_id"]
        if not isinstance(probe_id, bytes):
            return b""
        head = {"type": "params", "probe": probe, "probe_id": probe_id.hex()}
        return msgspec.json.encode(head | {"t_ns": t_ns} | payload_of(records))

    def contents(self, first: bytes) -> list[bytes]:
        """Hello and params as messages, with the numbers ahead of `first`, which begins
        the log. None where there are no params, and after a boot, which tells them.
        """
        message, records = messages.decode(first), self.records
        if self._hello is None or not records or not isinstance(message, Message):
            return []
        due = [
            ("hello", self._hello.fields),
            *(("params", fields) for fields in messages_of(records)),
        ]
        begin = message.sequence - len(due)
        if begin < 0:
            return []
        return [
            messages.encode(name, fields, begin + number, message.time_us)
            for number, (name, fields) in enumerate(due)
        ]
