# SPDX-License-Identifier: MIT
"""A mark: a user's note or measurement at a moment, with where the tip of the probe
was then, its normal, and how far that may be wrong; and the marks of each probe.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from imud.probes.aim import Sigmas, sigmas_of
from imud.wire.params import parts_of

MARKS = "marks"  # topic: all marks of a probe, as they are now
KEPT_MAX = 200  # marks of a probe
POSE = ("number", "t_device_us", "q", "position_m", "normal", "flags", "since_origin")


def mark_of(
    pose: Mapping[str, Any],
    params: bytes | None,
    path_sigma_m: Sequence[float],
    noted: Mapping[str, Any],
) -> dict[str, Any]:
    """The mark at a published pose; without one the place is not known. `params`: the
    records in force; `path_sigma_m`: one-sigma errors of the strokes since the origin;
    `noted`: value, unit and text.
    """
    sigmas = sigmas_of(pose) if pose else Sigmas(None, None, None, None)
    return {
        "state": "new",
        **noted,
        **{key: pose.get(key) for key in POSE},
        "no_position": _no_position(pose, params),
        "t_pose_ns": pose.get("t_ns"),
        "tilt_sigma_deg": sigmas.tilt,
        "heading_sigma_deg": sigmas.heading,
        "position_sigma_m": position_sigma_m(pose, sigmas, params, path_sigma_m),
    }


def _no_position(pose: Mapping[str, Any], params: bytes | None) -> str | None:
    """Why it has none, and what gives the next mark one; None: it has one."""
    if not pose:
        return "no pose at this moment; start the stream"
    if pose["position_m"] is not None:
        return None
    if "offset" not in parts_of(params or b"").get("tip", {}):
        return "the position of its tip is unknown; calibrate the tip"
    if "tared" not in pose["flags"]:
        return "it has no origin; set one"
    return "a stroke since the origin has no length; set the origin again"


class MarkBook:
    """The marks of each probe by its id, as they are now. A mark is known by its `id`,
    the UTC in ns at which it was made.
    """

    def __init__(self) -> None:
        self._marks: dict[str, dict[str, dict[str, Any]]] = {}

    def of(self, probe_id: str) -> list[dict[str, Any]]:
        """The latest of them, the oldest first."""
        return sorted(self._marks.get(probe_id, {}).values(), key=lambda e: e["id"])

    def find(self, probe_id: str, mark_id: str) -> dict[str, Any] | None:
        return self._marks.get(probe_id, {}).get(mark_id)

    def take(self, mark: Mapping[str, Any]) -> None:
        """One that was made, corrected or taken back, as it is published."""
        marks = self._marks.setdefault(mark["probe_id"], {})
        marks[mark["id"]] = {**mark}
        if mark["state"] == "withdrawn":
            del marks[mark["id"]]
        elif len(marks) > KEPT_MAX:
            del marks[min(marks)]


def position_sigma_m(
    pose: Mapping[str, Any],
    sigmas: Sigmas,
    params: bytes | None,
    path_sigma_m: Sequence[float],
) -> float | None:
    """One-sigma error of an axis of the tip's place since the origin: that of the
    strokes, of where the tip is on the probe, and what the error of the attitude turns
    that lever by. None: one of them is not known.
    """
    tip = parts_of(params or b"").get("tip", {})
    offset, sigma = tip.get("offset"), tip.get("sigma")
    if pose.get("position_m") is None or not isinstance(sigma, float):
        return None
    if not isinstance(offset, tuple) or sigmas.tilt is None or sigmas.heading is None:
        return None
    turned = math.radians(math.hypot(sigmas.tilt, sigmas.heading))
    lever = math.hypot(*offset)
    strokes = max(path_sigma_m, default=0.0)
    return math.hypot(sigma, lever * turned, strokes)
