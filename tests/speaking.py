# SPDX-License-Identifier: MIT
"""A daemon and a probe that streams and answers, whatever is asked when."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from pathlib import Path

from fakes import DaemonProcess, FakeProbe, Port
from streaming import Streaming


@contextlib.contextmanager
def speaking(directory: Path, *, page: bool = False) -> Iterator[DaemonProcess]:
    """Poses come 100 times a second, all alike, from when it is entered."""
    probe, port = FakeProbe(), Port(directory / "port")
    names = itertools.cycle(("hello", *["pose"] * 49))

    def say() -> bytes:
        return probe.say(next(names)) + port.answers(probe)

    with DaemonProcess(port.path, directory=directory, log=False, page=page) as daemon:
        daemon.expect("listens on")
        port.wait_open()
        with Streaming(port, probe, 0.01, say):  # 100 poses a second
            daemon.expect("found on")
            yield daemon
    port.vanish()
