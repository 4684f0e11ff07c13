# SPDX-License-Identifier: MIT
"""The stated errors of poses, as the covariances of ROS 2 messages."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from imud.ros2 import cdr

# Variance of an unknown heading, uniform over a whole turn, rad^2.
FREE_RAD2 = math.pi**2 / 3


def orientation_covariance(pose: Mapping[str, Any]) -> Sequence[float]:
    """3x3, rad^2, row by row, about the fixed axes of the world as in REP 103: tilt is
    about the two level axes, heading about the vertical one. With an origin, about the
    same axes as they were taken when it was set, and of the errors since then.
    """
    tilt_deg, heading_deg = pose["tilt_sigma_deg"], pose["heading_sigma_deg"]
    ends = 1.0
    if "tared" in pose["flags"]:
        since = pose.get("since_origin")
        if since is not None and since.void is None:
            tilt_deg, heading_deg = since.tilt_sigma_deg, since.heading_sigma_deg
        else:
            ends = 2.0  # what the origin was wrong by counts, too
    if tilt_deg is None:
        return cdr.ABSENT
    tilt = ends * math.radians(tilt_deg) ** 2
    heading = FREE_RAD2
    if heading_deg is not None:
        heading = min(FREE_RAD2, ends * math.radians(heading_deg) ** 2)
    return (tilt, 0.0, 0.0, 0.0, tilt, 0.0, 0.0, 0.0, heading)
