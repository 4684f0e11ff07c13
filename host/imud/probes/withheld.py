# SPDX-License-Identifier: MIT
"""Why a pose states no error of its tilt or its heading, or a stroke no length, and
what to do.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

LASTING_S = 5  # a shorter reason is not reported

# By the flag that has the reason, the first that a pose has counts.
OF_BOTH = {
    "force_impossible": "the accelerometer does not measure gravity: switch the "
    "probe off and on; if that does not help, its sensor is defective",
}
OF_TILT = OF_BOTH | {
    "starting": "it is still levelling; wait a few seconds",
}
OF_HEADING = OF_BOTH | {
    "mag_off": "the magnetometer is switched off: imud magnetometer PROBE on",
    "mag_absent": "no magnetometer, or one with a constant reading",
    "field_impossible": "the magnetic field can't be the Earth's: remove the magnet, "
    "or move away from steel",
    "field_unlike": "the magnetic field differs from that of its calibration: turn "
    "it about each axis once; if that does not help, remove the magnet",
    "starting": "it is still learning the local magnetic field; wait a few seconds",
    "heading_free": "its own magnetic field is not known well enough yet: turn it "
    "about each axis once more",
}
NO_ERRORS = "the filter that runs states no errors"
# Reasons that pass without action.
PASSING = frozenset({OF_TILT["starting"], OF_HEADING["starting"], NO_ERRORS})

# What to do where a stroke, or a press for one, has measured nothing, by its end.
STROKE_ADVICE = {
    "moving": "hold it still before and after",
    "too_long": "end it within 5 s",
    "clipped": "move it more gently",
    "gap": "samples are missing: run imud check",
    "too_fast": "move it more slowly",
    "lost": "lay it still first",
    "no_rest": "lay it still first",
    "too_near": "wait half a second between presses",
    "no_filter": "run imud restart --filter fuse",
    "changed": "the params have changed: press again",
}


def withheld_of(pose: Mapping[str, Any]) -> dict[str, str | None]:
    """Why the `tilt` and the `heading` of a published pose have no error, and what to
    do; None: they have one, or there is no pose.
    """
    return {
        "tilt": _reason(pose, "tilt_sigma_deg", OF_TILT),
        "heading": _reason(pose, "heading_sigma_deg", OF_HEADING),
    }


def _reason(
    pose: Mapping[str, Any], sigma: str, reasons: Mapping[str, str]
) -> str | None:
    if not pose or pose.get(sigma) is not None:
        return None
    flags = pose.get("flags") or ()
    return next((words for flag, words in reasons.items() if flag in flags), NO_ERRORS)


def sentences(withheld: Mapping[str, str | None]) -> list[str]:
    """Problems for the user to solve, as sentences: not those that pass without
    action."""
    found: dict[str, list[str]] = {}
    for name in ("tilt", "heading"):
        reason = withheld.get(name)
        if reason and reason not in PASSING:
            found.setdefault(reason, []).append(name)
    return [f"no {' and no '.join(names)}: {why}" for why, names in found.items()]


class WithheldWatch:
    """Tells once what has been withheld for some seconds, and once that it is over."""

    def __init__(self) -> None:
        self._told: list[str] = []
        self._seen: list[str] = []
        self._lasted = 0

    def follow(self, withheld: Mapping[str, str | None]) -> list[str]:
        """Once a second: lines to tell."""
        now = sentences(withheld)
        self._lasted = self._lasted + 1 if now == self._seen else 0
        self._seen = now
        if self._lasted < LASTING_S or now == self._told:
            return []
        self._told = now
        return now or ["its errors are available again"]
