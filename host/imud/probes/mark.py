# SPDX-License-Identifier: MIT
"""A mark: a user's note or measurement at a moment, with where the tip of the probe
was then, its normal, and how far that may be wrong.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from imud.probes.aim import Sigmas, sigmas_of
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
    sigmas = sigmas_of(pose) if pose else Sigmas(None, None, None, None)
    return {
        "value": value,
        "text": text,
        **{key: pose.get(key) for key in POSE},
        "t_pose_ns": pose.get("t_ns"),
        "tilt_sigma_deg": sigmas.tilt,
        "heading_sigma_deg": sigmas.heading,
        "position_sigma_m": position_sigma_m(pose, sigmas, params, path_sigma_m),
    }


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
