# SPDX-License-Identifier: MIT
"""Checks the path of a probe's data from data-ready to each sink: at each step, what
goes in comes out or is counted as lost.

Each check compares counts from two different places, so that a message lost without
being counted makes them differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from imud.probes.ledger import totals

# The probe's counters are 32 bits and wrap.
_MASK = (1 << 32) - 1


class SinkCounts(msgspec.Struct, frozen=True):
    """The outcome of one probe's records at one sink, all at the same moment."""

    taken: int = 0
    dropped: int = 0
    waiting: int = 0
    earlier: int = 0  # put before a reload added the sink


def balance(
    account: Mapping[str, Any],
    counters: Mapping[str, Any],
    numbered: int,
    received: int,
    put: int,
    sinks: Mapping[str, SinkCounts],
) -> dict[str, Any]:
    """`account` is Account.counts(); `counters` the probe's latest status message and
    `numbered` its sequence number; `received` the good messages taken up; `put` the
    records made of them and about the probe.
    """
    differs = []
    sensor = _sensor(counters)
    if sensor is not None and (sensor["unread"] < 0 or sensor["unfused"] < 0):
        differs.append("sensor")
    probe = _probe(counters, numbered)
    if probe is not None and probe["unexplained"]:
        differs.append("probe")
    if totals(account).received != received:
        differs.append("wire")
    differs += [
        name
        for name, counts in sinks.items()
        if counts.taken + counts.dropped + counts.waiting + counts.earlier != put
    ]
    return {
        "adds_up": not differs,
        "differs": differs,
        "sensor": sensor,
        "probe": probe,
        "put": put,
        "sinks": {
            name: msgspec.structs.asdict(counts) for name, counts in sinks.items()
        },
    }


def _sensor(counters: Mapping[str, Any]) -> dict[str, int] | None:
    """Each data-ready is read, counted as an overrun, or `unread`: not read yet, before
    the first read, or lost to a fault of the bus.
    """
    if "samples_ready" not in counters:
        return None
    ready, read = counters["samples_ready"], counters["samples_read"]
    fused, overruns = counters["samples_fused"], counters["overruns"]
    return {
        "ready": ready,
        "read": read,
        "overruns": overruns,
        "unread": _difference(ready, read + overruns),
        "fused": fused,
        "unfused": _difference(read, fused),
    }


def _probe(counters: Mapping[str, Any], numbered: int) -> dict[str, int] | None:
    """Each sequence number of a probe is of a message that was sent or dropped."""
    if "messages_sent" not in counters:
        return None
    sent, dropped = counters["messages_sent"], counters["messages_dropped"]
    return {
        "numbers": (numbered + 1) & _MASK,
        "sent": sent,
        "dropped": dropped,
        "unexplained": _difference(numbered + 1, sent + dropped),
    }


def _difference(a: int, b: int) -> int:
    """a - b of two counts that wrap."""
    return ((a - b + (1 << 31)) & _MASK) - (1 << 31)
