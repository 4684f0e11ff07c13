# SPDX-License-Identifier: MIT
"""Logs as the daemon writes them, made of what a fake probe says."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fakes import FakeProbe
from imud import cli
from imud.errors import FileError
from imud.log.file import Settings
from imud.log.parts import Damage
from imud.log.reader import Logged, LogHead, salvage
from imud.probes.record import Record, Stamp, record_of
from imud.probes.scales import Scales
from imud.sinks.log import LogSink
from imud.wire.messages import Message, decode

PERIOD_NS = 10_000_000
BEGIN_NS = 1_795_000_000_000_000_000


def records(
    count: int, probe: FakeProbe | None = None, name: str = "left"
) -> list[Record]:
    """The daemon's records of a hello, poses, raw samples and an event."""
    probe = probe or FakeProbe()
    hello_content = probe.content("hello")
    hello = decode(hello_content)
    assert isinstance(hello, Message)
    scales = Scales(hello_content, b"")
    made = []
    for number in range(count):
        kind = "event" if number == 2 else "raw" if number % 5 == 4 else "pose"
        content = probe.content(kind)
        message = decode(content)
        assert isinstance(message, Message)
        t_ns = BEGIN_NS + number * PERIOD_NS
        stamp = Stamp(number + 1, 0, number * 5000, t_ns, 1000, t_ns + 2_000_000)
        made.append(record_of(message, content, name, stamp, scales))
    return made


def write(directory: Path, *batches: list[Record], **settings: Any) -> Path:
    sink = LogSink(directory, Settings(**settings))
    sink.open()
    path = sink.path
    assert path is not None
    for batch in batches:
        for record in batch:
            sink.write(record)
        sink.flush()
    sink.close()
    return path


def frames(path: Path) -> list[bytes]:
    items = [each for each in salvage(path) if isinstance(each, Logged)]
    return [each.data for each in items if each.topic == "frame"]


def read_log(path: Path) -> Iterator[LogHead | Logged]:
    """All messages of a log that has to be whole."""
    for item in salvage(path):
        if isinstance(item, Damage):
            raise FileError(f"{path} is truncated, or is damaged at {item.at}")
        yield item


@contextlib.contextmanager
def replaying(path: Path, link: Path) -> Iterator[threading.Thread]:
    """A replay on a pty behind `link`, as fast as it is read."""
    words = ["replay", str(path), "--speed", "max", "--link", str(link)]
    playing = threading.Thread(target=cli.main, args=(words,))
    playing.start()
    while not link.is_symlink():
        assert playing.is_alive()
    yield playing
    playing.join()
