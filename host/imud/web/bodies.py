# SPDX-License-Identifier: MIT
"""States of bodies, which `imud body` publishes on PREFIX/body/NAME/state: any program
of the network may, so what comes is looked at before it goes to browsers.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from imud.web.feed import BODY, Key

STATE_MAX = 64 * 1024  # bytes: a body of 20 segments takes 10 KiB


class _Head(msgspec.Struct, frozen=True):
    type: Literal["body"]
    body: str


_decode = msgspec.json.Decoder(_Head).decode


def line_of(key: str, payload: bytes) -> tuple[Key, bytes] | None:
    """The line for browsers of a state by its Zenoh key; None: it is not a state."""
    name = key.split("/")[-2]
    if len(payload) > STATE_MAX or b"\n" in payload:
        return None
    try:
        is_its_own = _decode(payload).body == name
    except msgspec.MsgspecError:
        return None
    return ((name, BODY), payload) if is_its_own else None
