# SPDX-License-Identifier: MIT
"""Logs of what no host has dated as it came: recordings of a card, captures of a UART.
Their times are the probe's own, from 1970 on.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path

from msgspec.structs import replace

from imud.log.file import LogFile, Settings
from imud.probes.first_hello import probe_of
from imud.probes.record import Record, record_of
from imud.probes.session import Event, Probe, Received, Session


def record_by_device(event: Received, started_ns: int = 0) -> Record:
    """The record of a message, `started_ns` UTC after the device's time."""
    t_ns = max(0, event.stamp.t_device_us * 1000 + started_ns)
    return record_of(
        event.message,
        event.content,
        event.probe.probe_id,
        replace(event.stamp, t_ns=t_ns, t_received_ns=t_ns),
        event.scales,
        references=event.probe.references,
    )


def write_capture(chunks: Iterable[bytes], probe: Probe, path: Path) -> int:
    """Writes what a UART said as a log; `probe` has said what comes before a hello. How
    many messages that were.
    """
    probes = {probe.probe_id: probe}
    session = Session(partial(probe_of, probes), presumed=probe)
    with path.open("wb") as file:
        log = LogFile(file, Settings())
        received = (session.receive(data, None) for data in chunks)
        count = sum(_add(events, log) for events in received)
        count += _add(session.close(), log)
        log.finish()
    return count


def _add(events: Iterable[Event], log: LogFile) -> int:
    count = 0
    for event in events:
        if isinstance(event, Received):
            count += 1
            log.add(record_by_device(event))
    return count
