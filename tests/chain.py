# SPDX-License-Identifier: MIT
"""A probe, its port, a daemon that found it, and a client of that daemon."""

from __future__ import annotations

import contextlib
import json
import queue
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from fakes import PATIENCE_S, DaemonProcess, FakeProbe, Port
from imud.client import Client


class Chain:
    """A probe, its port, a daemon that found it, and a client of that daemon."""

    def __init__(
        self,
        directory: Path,
        *arguments: object,
        prefix: str = "imud",
        program: tuple[str, ...] = ("-m", "imud"),
        page: bool | None = False,
        log: bool = True,
    ) -> None:
        self.probe = FakeProbe()
        self.port = Port(directory / "port")
        self.daemon = DaemonProcess(
            *(self.port.path, *arguments),
            directory=directory,
            program=program,
            page=page,
            log=log,
        )
        self.daemon.find(self.port, self.probe)
        self.client = Client(self.daemon.endpoint, prefix)
        self.client.wait_for(seconds=PATIENCE_S)

    def hear(self, topic: str) -> queue.Queue[bytes]:
        """What is published on a topic from here on, surely from its next message."""
        heard: queue.Queue[bytes] = queue.Queue()
        self.client.subscribe(topic, None, lambda _, payload: heard.put(payload))
        # A query follows the declaration on the same link: once it is answered, the
        # daemon knows the subscriber.
        self.client.statuses()
        return heard

    @contextlib.contextmanager
    def serving(self) -> Iterator[None]:
        """The probe answers one command meanwhile."""
        server = threading.Thread(target=self.port.serve, args=(self.probe, 1))
        server.start()
        try:
            yield
        finally:
            server.join()

    def command(self, name: str, **arguments: str) -> dict[str, Any]:
        """A command, while the probe answers it on its side."""
        with self.serving():
            return self.client.command(self.probe.name, name, **arguments)

    def status_when(self, is_so: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first status from here on of which that is true."""
        heard = self.hear("status")
        while True:
            status: dict[str, Any] = json.loads(heard.get())
            if is_so(status):
                return status

    def close(self) -> None:
        self.client.close()
        self.daemon.__exit__(None, None, None)
        self.port.vanish()
