# SPDX-License-Identifier: MIT
"""Whether a probe is there, from its status as published."""

from __future__ import annotations

import msgspec


def says_there(status: bytes) -> bool:
    """Whether the status is of a probe that is on a port and speaks our schema."""
    said = msgspec.json.decode(status)
    return said["port"] is not None and said["state"] != "other schema"


def says_gone(payload: bytes) -> bool:
    """Whether it is the status of a probe that was unplugged."""
    try:
        return bool(msgspec.json.decode(payload)["state"] == "gone")
    except (msgspec.DecodeError, KeyError, TypeError):
        return False
