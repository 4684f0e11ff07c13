# SPDX-License-Identifier: MIT
"""A daemon with a configuration file, a fake probe and its port."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Iterator
from pathlib import Path

import zenoh

from fakes import DaemonProcess, FakeProbe, Port


@contextlib.contextmanager
def running(
    folder: Path, text: str, *, log: bool | None = True
) -> Iterator[tuple[DaemonProcess, FakeProbe, Port]]:
    port, probe = Port(folder / "port"), FakeProbe()
    file = folder / "imud.toml"
    file.write_text(f"[ports]\nfind = false\nnamed = ['{port.path}']\n{text}")
    with DaemonProcess("--config", file, directory=folder, log=log) as daemon:
        port.wait_open()
        port.write(probe.say("hello"))
        daemon.expect("found on")
        try:
            yield daemon, probe, port
        finally:
            port.vanish()


@contextlib.contextmanager
def bare_session(daemon: DaemonProcess) -> Iterator[zenoh.Session]:
    """A Zenoh client without ours around it, once the probe's commands answer it."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([daemon.endpoint]))
    with zenoh.open(config) as session:
        # Until the client has been told who answers, its queries have no reply at all.
        while not list(session.get("imud/*/cmd/unknown")):
            time.sleep(0.05)
        yield session
