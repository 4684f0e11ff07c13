# SPDX-License-Identifier: MIT
"""A mark: what somebody notes or measures at a moment, with where the tip of the probe
was then, its normal, and how far that may be wrong.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from imud.wire.params import parts_of

POSE = ("number", "t_device_us", "q", "position_m", "normal", "flags", "since_origin")


def mark_of(
    pose: Mapping[str, Any],
    params: bytes | None,
    path_sigma_m: Sequence[float],
    value: float | None,
    text: str,
) -> dict[str, Any]:
    """The mark at a published pose; without one the place is not known. `params`: the
    records in force; `path_sigma_m`: one-sigma errors of the strokes since the origin.
    """
    errors = errors_of(pose)
    return {
        "value": value,
        "text": text,
        **{key: pose.get(key) for key in POSE},
        "t_pose_ns": pose.get("t_ns"),
        **errors,
        "position_sigma_m": position_sigma_m(pose, errors, params, path_sigma_m),
    }


def errors_of(pose: Mapping[str, Any]) -> dict[str, float | None]:
    """One-sigma errors by which a pose is judged: those since its origin, where they
    hold.
    """
    since = pose.get("since_origin")
    names = "tilt_sigma_deg", "heading_sigma_deg"
    if since is not None and since.void is None:
        return {name: getattr(since, name) for name in names}
    return {name: pose.get(name) for name in names}


def position_sigma_m(
    pose: Mapping[str, Any],
    errors: Mapping[str, float | None],
    params: bytes | None,
    path_sigma_m: Sequence[float],
) -> float | None:
    """One-sigma error of an axis of the tip's place since the origin: that of the
    strokes, of where the tip is on the probe, and what the error of the attitude turns
    that lever by. None: one of them is not known.
    """
    tip = parts_of(params or b"").get("tip", {})
    offset, sigma = tip.get("offset"), tip.get("sigma")
    angles = [*errors.values()]
    if pose.get("position_m") is None or not isinstance(sigma, float):
        return None
    if not isinstance(offset, tuple) or None in angles:
        return None
    turned = math.radians(math.hypot(*(each or 0.0 for each in angles)))
    lever = math.hypot(*offset)
    strokes = max(path_sigma_m, default=0.0)
    return math.hypot(sigma, lever * turned, strokes)
