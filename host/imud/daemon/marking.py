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


def mark(entry: ProbeEntry, parameters: Mapping[str, str]) -> dict[str, Any]:
    """The mark at the last pose of a probe; CommandRefused if it is no mark."""
    value, text = _value(parameters.get("value")), parameters.get("text", "")
    is_known = not parameters.keys() - MARK.argument_names
    if not is_known or (value is None and not text) or len(text) > TEXT_MAX:
        raise CommandRefused(MARK.usage)
    scales = entry.probe.scales
    return mark_of(entry.pose, scales.params, entry.closer.sigma_m, value, text)


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
