# SPDX-License-Identifier: MIT
"""A daemon and a probe that streams and answers, whatever is asked when."""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Iterator
from pathlib import Path

from fakes import DaemonProcess, FakeProbe, Port


@contextlib.contextmanager
def speaking(directory: Path, *, page: bool = False) -> Iterator[DaemonProcess]:
    """Poses come 100 times a second, all alike, from when it is entered."""
    probe, port = FakeProbe(), Port(directory / "port")
    ended = threading.Event()

    def speak() -> None:
        for count in itertools.count():
            if ended.wait(0.01):  # 100 poses a second
                return
            port.write(probe.say("hello" if count % 50 == 0 else "pose"))
            port.write(port.answers(probe))

    with DaemonProcess(port.path, directory=directory, log=False, page=page) as daemon:
        daemon.expect("listens on")
        port.wait_open()
        speaker = threading.Thread(target=speak)
        speaker.start()
        try:
            daemon.expect("found on")
            yield daemon
        finally:
            ended.set()
            speaker.join()
    port.vanish()
