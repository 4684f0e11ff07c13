# SPDX-License-Identifier: MIT
"""A daemon with keys, and what a session hears from it."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec
import zenoh
import zenoh.ext

from fakes import DaemonProcess, FakeProbe, Port, free_endpoint
from imud.errors import DaemonNotFound
from imud.net import keys, network
from imud.net.network import Credentials
from streaming import Streaming

PROBE = "00112233445566aa"
# Longer than anything allowed was seen to take on a busy machine.
WHILE_S = 1.0
DENIED = r"warning: network: \S+ requested something that its role does not allow"


def tls_endpoint() -> str:
    return free_endpoint().replace("tcp/", "tls/")


class Guarded:
    """A daemon with keys, whose probe streams without end."""

    def __init__(self, directory: Path, *, is_mutual: bool = False) -> None:
        self.keys = directory / "keys"
        keys.initialise(self.keys, ["localhost"], 1)
        for role in ("operator", "recorder"):
            keys.add(self.keys, role, f"other-{role}")
        self.probe, self.port = FakeProbe(), Port(directory / "probe")
        settings = directory / "imud.toml"
        settings.write_text(
            f'[zenoh]\nkeys = "{self.keys}"\nmutual_tls = {json.dumps(is_mutual)}\n'
            f"history = 20\n[journal]\nburst = 100000\n[ros2]\nenabled = true\n"
        )
        self.daemon = DaemonProcess(
            self.port.path,
            "--config",
            settings,
            directory=directory,
            log=False,
            endpoint=tls_endpoint(),
        )
        self.daemon.expect("listens on tls")
        self.endpoint = self.daemon.endpoint
        self.port.wait_open()
        self.port.write(self.probe.say("hello"))
        self.daemon.expect("found on")
        self._stream = Streaming(self.port, self.probe, 0.03, self._said)

    def _said(self) -> bytes:
        pose = self.probe.say("pose", position=(0.1, 0.2, 0.3))
        return pose + self.probe.say("raw") + self.probe.say("event")

    def credentials(self, user: str) -> Credentials:
        path = self.keys / "clients" / f"{user}.toml"
        return msgspec.structs.replace(
            network.read_credentials(path), endpoint=self.endpoint
        )

    @contextmanager
    def session(self, user: str) -> Iterator[zenoh.Session]:
        session = network.open_client(self.endpoint, self.credentials(user))
        try:
            yield session
        finally:
            session.close()

    def welcome(self) -> None:
        """Logs in, which ends this address's row of failures: after five it waits."""
        while True:
            with suppress(DaemonNotFound), self.session("viewer"):
                return

    def expect_denied(self) -> None:
        """A line of each test's own: those that came by now are not it."""
        self.daemon.expect(DENIED)

    def hush(self) -> None:
        """While there is a reader: a full pty would hold the thread for ever."""
        self._stream.stop()

    def close(self) -> None:
        self.hush()
        self.daemon.__exit__(None, None, None)
        self.port.vanish()


def received_on(
    session: zenoh.Session, *keys: str, wanted: Collection[str] = ()
) -> Counter[str]:
    """Messages on these keys for some time, and until all wanted ones have arrived."""
    count: Counter[str] = Counter()

    def on_sample(sample: zenoh.Sample) -> None:
        count[str(sample.key_expr)] += 1

    remote = zenoh.Locality.REMOTE
    held = [
        session.declare_subscriber(key, on_sample, allowed_origin=remote)
        for key in keys
    ]
    time.sleep(WHILE_S)  # nothing more comes
    while not set(wanted) <= count.keys():
        time.sleep(0.02)
    for subscriber in held:
        subscriber.undeclare()
    return count
