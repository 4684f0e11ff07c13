# SPDX-License-Identifier: MIT
"""Whether a probe is there, from its status as published."""

from __future__ import annotations

import msgspec

from imud.probes.record import Presence, Record


def is_probe_there(status: bytes) -> bool:
    """Whether the status is of a probe that is on a port and speaks our schema."""
    found = msgspec.json.decode(status)
    return found["port"] is not None and found["state"] != "other schema"


def is_probe_here(record: Record | Presence) -> bool:
    """Whether a record says that its probe is on a port of this daemon."""
    if isinstance(record, Presence):
        return record.is_alive
    return record.topic == "status" and is_probe_there(record.payload)


def is_probe_gone(payload: bytes) -> bool:
    """Whether it is the status of a probe that was unplugged."""
    try:
        return bool(msgspec.json.decode(payload)["state"] == "gone")
    except (msgspec.DecodeError, KeyError, TypeError):
        return False
