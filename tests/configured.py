# SPDX-License-Identifier: MIT
"""A daemon with a configuration file, a fake probe and its port."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

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
