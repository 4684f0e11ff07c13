# SPDX-License-Identifier: MIT
"""The smallest possible daemon, to compare with: it decodes what ptys deliver and
publishes it, in one thread, without ledger, clock, log or commands.

relay.py ENDPOINT PORT...
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from typing import Any

import zenoh

from imud.wire import messages
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message


class Relay:
    """Decodes what one port delivers and publishes its poses."""

    def __init__(self, session: zenoh.Session, port: str) -> None:
        self._session = session
        self._decoder = FrameDecoder()
        self._file = os.open(port, os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)
        self._probe = ""
        self._publisher: Any = None
        asyncio.get_running_loop().add_reader(self._file, self._read)

    def _read(self) -> None:
        for content in self._decoder.feed(os.read(self._file, 65536)):
            message = messages.decode(content)
            if not isinstance(message, Message):
                continue
            if message.name == "hello" and isinstance(
                message.fields["probe_id"], bytes
            ):
                self._probe = message.fields["probe_id"].hex()
                key = f"imud/{self._probe}/pose"
                self._publisher = self._session.declare_publisher(key)
            elif self._publisher is not None:
                pose = {"probe": self._probe, "seq": message.sequence, **message.fields}
                self._publisher.put(json.dumps(pose).encode())


async def serve(endpoint: str, ports: list[str]) -> None:
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        relays = [Relay(session, port) for port in ports]
        sys.stderr.write(f"listens on {endpoint}, {len(relays)} ports\n")
        await asyncio.get_running_loop().create_future()


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1], sys.argv[2:]))
