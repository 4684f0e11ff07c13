# SPDX-License-Identifier: MIT
"""How near a probe is to a desired orientation, pose by pose, computed by quaternions:
the same definitions as in web/site/aim/target.js and hold.js.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import msgspec
import numpy as np

from imud import rotation
from imud.published import SinceOrigin
from imud.rotation import FloatArray

Axis = Literal["x", "y", "z", "all"]
DIRECTIONS: dict[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "all": (1.0, 0.0, 0.0),
}
# An axis this close to the vertical (its sine) does not depend on the heading.
UPRIGHT = 0.01


class Target(msgspec.Struct, frozen=True):
    """A desired orientation. What has to agree is one axis, or all of the attitude."""

    q: tuple[float, float, float, float]  # world_from_body
    target: str = "target"  # its name
    axis: Axis = "x"
    tolerance_deg: float = 2.0
    hold_s: float = 2.0
    # The reference that was kept when it was captured; empty: it was not captured.
    capture: str = ""


class Sigmas(msgspec.Struct, frozen=True):
    """One-sigma errors by which a pose is judged, in degrees."""

    tilt: float | None
    heading: float | None
    since: Literal["origin", "capture"] | None  # None: absolute ones
    void: str | None  # why those since the capture or the origin are not


class Aim:
    """Follows the poses of one probe towards a target."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self._wanted = np.array(target.q)
        self._direction = np.array(DIRECTIONS[target.axis])
        self._since_us: int | None = None
        self._last_us = 0
        self._bound_deg = 0.0
        self._is_reached = False

    @property
    def capture(self) -> str:
        """The reference of its target; empty: there is none."""
        return self._target.capture

    def measure(
        self, pose: Mapping[str, Any], captured: SinceOrigin | None = None
    ) -> dict[str, Any]:
        """A published pose as plain values. `captured`: its errors since
        the target was captured; None: it was not, or that is not known any more.
        """
        target = self._target
        sigmas = sigmas_of(pose, captured)
        error = self._error_deg(np.array(pose["q"]))
        sigma = self._sigma_deg(pose, sigmas)
        is_sure = sigma is not None and error + 2.0 * sigma <= target.tolerance_deg
        state = "off" if error > target.tolerance_deg else "unsure"
        held_s = self._hold(pose["t_device_us"], error, sigma if is_sure else None)
        mine = rotation.angles_deg(pose["q"], "nautical")
        wanted = rotation.angles_deg(target.q, "nautical")
        return {
            "number": pose["number"],
            "t_device_us": pose["t_device_us"],
            "t_ns": pose["t_ns"],
            "target": target.target,
            "target_q": target.q,
            "axis": target.axis,
            "tolerance_deg": target.tolerance_deg,
            "hold_s": target.hold_s,
            "error_deg": error,
            "sigma_deg": sigma,
            "since": sigmas.since,
            "void": sigmas.void,
            "state": "sure" if is_sure else state,
            "difference_deg": [
                _wrapped(is_ - should) for is_, should in zip(mine, wanted, strict=True)
            ],
            "held_s": held_s,
            "bound_deg": self._bound_deg if is_sure else None,
            "is_reached": self._is_reached,
        }

    def _error_deg(self, q: FloatArray) -> float:
        if self._target.axis == "all":
            w, *v = rotation.multiply(q, rotation.inverse(self._wanted))
            half = math.atan2(math.hypot(*v), abs(w))
            return math.degrees(2.0 * half)
        is_ = rotation.rotate(q, self._direction)
        should = rotation.rotate(self._wanted, self._direction)
        across = float(np.linalg.norm(np.cross(is_, should)))
        return math.degrees(math.atan2(across, float(is_ @ should)))

    def _sigma_deg(self, pose: Mapping[str, Any], sigmas: Sigmas) -> float | None:
        """One sigma of the error, from those of tilt and heading."""
        tilt, turn = sigmas.tilt, sigmas.heading
        if tilt is None:
            return None
        # An origin of its own may mix the absolute errors of tilt and heading: then all
        # of both counts.
        is_mixed = self._target.axis == "all" or (
            sigmas.since is None and "tared" in pose["flags"]
        )
        east, north, _ = rotation.rotate(np.array(pose["q"]), self._direction)
        share = 1.0 if is_mixed else math.hypot(east, north)
        if share < UPRIGHT:
            return float(tilt)
        return None if turn is None else math.hypot(tilt, share * turn)

    def _hold(self, time_us: int, error: float, sigma: float | None) -> float:
        """Seconds that it has surely been within the tolerance."""
        if sigma is None or time_us < self._last_us:
            self._since_us, self._bound_deg = None, 0.0
            self._last_us = time_us
            return 0.0
        self._last_us = time_us
        if self._since_us is None:
            self._since_us = time_us
        self._bound_deg = max(self._bound_deg, error + 2.0 * sigma)
        held_s = (time_us - self._since_us) / 1e6
        self._is_reached = self._is_reached or held_s >= self._target.hold_s
        return held_s


def sigmas_of(pose: Mapping[str, Any], captured: SinceOrigin | None = None) -> Sigmas:
    """By what a pose is judged: its errors since the target was captured, else since
    the origin, else the absolute ones.
    """
    origin: SinceOrigin | None = pose.get("since_origin")
    if captured is not None and captured.void is None:
        return Sigmas(
            captured.tilt_sigma_deg, captured.heading_sigma_deg, "capture", None
        )
    if origin is not None and origin.void is None:
        turn = origin.heading_sigma_deg
        return Sigmas(origin.tilt_sigma_deg, turn, "origin", _void(captured))
    tilt, turn = pose["tilt_sigma_deg"], pose["heading_sigma_deg"]
    if "tared" in pose["flags"]:
        # The error of the origin also counts, and is about as large.
        tilt, turn = _both_ends(tilt), _both_ends(turn)
    return Sigmas(tilt, turn, None, _void(captured) or _void(origin))


def _void(found: SinceOrigin | None) -> str | None:
    return None if found is None else found.void


def _both_ends(sigma: float | None) -> float | None:
    return None if sigma is None else math.sqrt(2.0) * sigma


def _wrapped(degrees: float) -> float:
    return degrees - 360.0 * math.floor((degrees + 180.0) / 360.0)
