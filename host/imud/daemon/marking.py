# SPDX-License-Identifier: MIT
"""The command `mark`: a value or a note from outside, with the pose of that moment."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from imud.commands import COMMANDS
from imud.daemon.registry import ProbeEntry
from imud.errors import CommandRefused
from imud.probes.mark import mark_of

MARK = COMMANDS["mark"]
TEXT_MAX = MARK.argument("text").length_max or 0


# An older pose does not tell where the probe is now.
AGE_MAX_NS = 1_000_000_000


def mark(
    entry: ProbeEntry, parameters: Mapping[str, str], now_ns: int
) -> dict[str, Any]:
    """The mark at the pose of a probe at the host's time `now_ns`; CommandRefused if
    it is none.
    """
    value, text = _value(parameters.get("value")), parameters.get("text", "")
    is_known = not parameters.keys() - MARK.argument_names
    if not is_known or (value is None and not text) or len(text) > TEXT_MAX:
        raise CommandRefused(MARK.usage)
    scales = entry.probe.scales
    pose = _pose_now(entry, now_ns)
    return mark_of(pose, scales.params, entry.closer.sigma_m, value, text)


def _pose_now(entry: ProbeEntry, now_ns: int) -> Mapping[str, Any]:
    """Empty: there is none, or the last one is too old."""
    return entry.pose if now_ns - entry.pose_ns < AGE_MAX_NS else {}


def _value(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError as error:
        raise CommandRefused(MARK.usage) from error
    if not math.isfinite(value):
        raise CommandRefused(MARK.usage)
    return value
