# SPDX-License-Identifier: MIT
"""A probe made of Python."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fakes.messages import EXAMPLES, HELLO
from fakes.params import FakeParams
from imud.wire import kept, schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode, encode

# Commands that a probe also reports as an event, and that event.
CHANGES = {"restart": "restarted", "tare": "tared"}


class FakeProbe:
    """Makes a probe's messages, with one sequence count for all of them.

    Keyword arguments replace fields of its hello.
    """

    def __init__(self, **hello: Any) -> None:
        self.hello_fields = HELLO | hello
        self.sequence = 0
        self.time_us = 0
        self.results: dict[str, str] = {}
        self.commands: list[Mapping[str, Any]] = []
        self.params = FakeParams()
        self._decoder = FrameDecoder(self.hello_fields["schema_fingerprint"])
        self._replied: tuple[int, dict[str, Any]] | None = None

    @property
    def name(self) -> str:
        return str(self.hello_fields["probe_id"].hex())

    def content(self, name: str, **fields: Any) -> bytes:
        # One that a test made up stands while none were put in force.
        digest = self.params.digest or self.hello_fields["params_digest"]
        hello = self.hello_fields | {"params_digest": digest}
        example = hello if name == "hello" else EXAMPLES[name]
        content = encode(name, example | fields, self.sequence, self.time_us)
        self.sequence = (self.sequence + 1) & 0xFFFFFFFF
        self.time_us = (self.time_us + 5000) & 0xFFFFFFFF
        return content

    def say(self, name: str, **fields: Any) -> bytes:
        speaks = kept.find(self.hello_fields["schema_fingerprint"])
        return encode_frame(self.content(name, **fields), speaks)

    def poses(self, count: int) -> bytes:
        return b"".join(self.say("pose") for _ in range(count))

    def restart(self) -> None:
        self.sequence = self.time_us = 0
        boots = self.hello_fields["boot_count"] + 1
        self.hello_fields = self.hello_fields | {"boot_count": boots}
        self._replied = None
        self.params.restart()

    def hear(self, data: bytes) -> bytes:
        """The answers to the commands in these bytes."""
        sent = b""
        for content in self._decoder.feed(data):
            message = decode(content)
            if isinstance(message, Message) and message.name == "command":
                sent += self._obey(message.fields)
        return sent

    def _obey(self, fields: Mapping[str, Any]) -> bytes:
        sent = b""
        token = fields["token"]
        if self._replied is None or self._replied[0] != token:
            # Not recorded: the daemon asks for the time at any moment.
            if fields["command"] != "time":
                self.commands.append(fields)
            result = self.results.get(fields["command"], "ok")
            reply = {
                "replied_command": fields["command"],
                "replied_token": token,
                "result": result,
                "value": fields["arguments"],
            }
            if result == "ok" and fields["command"].startswith("params_"):
                answer = self.params.obey(fields["command"], *fields["arguments"])
                reply["result"], reply["value"] = answer
                sent = self._tell_params()
            self._replied = token, reply
            if fields["command"] == "hello":
                sent = self.say("hello")
            if result == "ok" and fields["command"] in CHANGES:
                is_same = fields["command"] == "restart" and not fields["arguments"][0]
                detail = schema.Filter.FUSE if is_same else fields["arguments"][0]
                what = {"event": CHANGES[fields["command"]], "cause": "command"}
                sent = self.say("event", **what, detail=detail)
        return sent + self.say("reply", **self._replied[1])

    def _tell_params(self) -> bytes:
        """The messages about params that are due."""
        sent = b"".join(self.say("params", **part) for part in self.params.tells)
        self.params.tells.clear()
        if self.params.has_changed:
            self.params.has_changed = False
            what = {"event": "params_changed", "cause": "command"}
            signed = self.params.digest - (self.params.digest >> 31 << 32)
            sent += self.say("event", **what, detail=signed) + self.say("hello")
        return sent
