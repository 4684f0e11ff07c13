# SPDX-License-Identifier: MIT
"""Names of transforms, FromToTo as PLUS has them, in the 20 bytes of a header."""

from __future__ import annotations

import re

REFERENCE = "Reference"
NAME_MAX = 20
PROBE_MAX = NAME_MAX - len(f"To{REFERENCE}")

# PLUS splits a name at "To" with no small letter behind it, which must occur once.
_FRAME = re.compile(rf"(?!To(?![a-z]))[A-Z][a-z0-9]{{0,{PROBE_MAX - 1}}}")
_PROBE_ID = re.compile(r"[0-9a-f]{16}")
_NO_NAME = re.compile(r"[^A-Za-z0-9]+")
_DIGITS = 4  # of an id


def frame_of(probe: str) -> str:
    """The frame of a probe by its name or id: Leftfoot of left_foot, Probe5173 of an
    id. Empty: the name does not fit.
    """
    if _PROBE_ID.fullmatch(probe):
        return f"Probe{probe[:_DIGITS]}"
    frame = _NO_NAME.sub("", probe).capitalize()
    return frame if _FRAME.fullmatch(frame) else ""


def to_reference(frame: str) -> str:
    """The name of the transform from a probe's frame to that of the world."""
    return f"{frame}To{REFERENCE}"


def tip_to(frame: str) -> str:
    """The name of the transform from the tip's frame to that of its probe."""
    return f"TipTo{frame}"


def status_of(frame: str) -> str:
    """The name of the message that says in words what is known of a probe."""
    return f"{frame}Status"
