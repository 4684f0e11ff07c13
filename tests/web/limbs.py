# SPDX-License-Identifier: MIT
"""States of a leg, as `imud body` publishes them: docs/limb.md."""

from __future__ import annotations

import time
from typing import Any

ANGLES = ("flexion", "abduction", "rotation")
JOINTS = (("thigh", "shank", "knee"), ("shank", "foot", "ankle"))
SAYS = {"standing": "Stand still for 3 s.", "moving": "Squat, then raise the knee."}


PLACES = {
    "thigh": ((0.0, 0.0, 0.0), (0.11, 0.0, -0.40)),
    "shank": ((0.11, 0.0, -0.40), (-0.02, 0.0, -0.81)),
    "foot": ((-0.02, 0.0, -0.81), (-0.03, 0.0, -0.89)),
}
PARENTS = {"thigh": None, "shank": "thigh", "foot": "shank"}


def leg(
    number: int,
    *,
    stage: str = "running",
    flexion: float = 30.0,
    is_down: bool = True,
    missing: tuple[str, ...] = (),
) -> dict[str, Any]:
    """A state; without alignment, and where a segment is missing, nothing of it."""
    is_aligned = stage == "running"
    return {
        "type": "body",
        "body": "right-leg",
        "side": "right",
        "number": number,
        "t_ns": time.time_ns(),
        "t_bound_us": 900,
        "age_us": 152000,
        "stage": stage,
        "says": SAYS.get(stage),
        "still_s": None if is_aligned else 1.2,
        "still_of_s": None if is_aligned else 3.0,
        "aligned": "motion" if is_aligned else None,
        "missing": missing,
        "remarks": (),
        "segments": [
            segment(name, is_aligned, is_down=is_down, is_missing=name in missing)
            for name in PLACES
        ],
        "joints": [
            joint(*each, flexion, is_known=is_aligned and not {*each} & {*missing})
            for each in JOINTS
        ],
    }


def segment(
    name: str, is_aligned: bool, *, is_down: bool, is_missing: bool
) -> dict[str, Any]:
    is_drawn = is_aligned and not is_missing
    is_foot = is_drawn and name == "foot"
    start, end = PLACES[name]
    contact = {
        "is_down": is_down,
        "rests": 3,
        "stride_m": 1.15,
        "place_m": (15.2, 0.1, 0.0),
    }
    return {
        "name": name,
        "parent": PARENTS[name],
        "probe": f"probe-{name}",
        "presence": "missing" if is_missing else "ok",
        "age_us": None if is_missing else 12000,
        "q": (0.7, 0.7, 0.0, 0.05) if is_drawn else None,
        "start_m": start if is_drawn else None,
        "end_m": end if is_drawn else None,
        "marks_m": {"toe": (0.14, 0.0, -0.92)} if is_foot else {},
        "contact": contact if is_foot else None,
    }


def joint(
    parent: str, child: str, kind: str, flexion: float, *, is_known: bool
) -> dict[str, Any]:
    return {
        "parent": parent,
        "child": child,
        "kind": kind,
        "bends": 2,
        "at_m": PLACES[child][0] if is_known else None,
        "angles_deg": {name: flexion for name in ANGLES} if is_known else None,
        "sigmas_deg": {name: 1.6 for name in ANGLES} if is_known else None,
    }
