# SPDX-License-Identifier: MIT
"""Moments to which the poses of a probe are related: its origin, and when targets were
captured. Each pose states its errors since then; relative_error.py has the equations.
"""

from __future__ import annotations

import math
import secrets
from collections.abc import Mapping
from typing import Any

from imud.probes.relative_error import (
    Quality,
    Quat,
    Turned,
    Unevenness,
    capped,
    heading_variance,
    quality_of,
    tilt_variance,
)
from imud.published import SinceOrigin

# Poses are compared over this time, whatever their rate. Below 10 Hz, from each to the
# next.
STEP_US = 45_000

# In a longer pause of the poses the attitude may have been lost and found again, with
# nothing left that tells it. Poses come once a second at least.
PAUSE_MAX_US = 1_500_000

CAPTURES_MAX = 64

UNTURNED: Quat = (1.0, 0.0, 0.0, 0.0)

# The detail of the event `tared`.
ORIGIN_ALL, ORIGIN_HEADING = 0, 1

# Events after which errors have nothing to do with those before.
ENDINGS = frozenset({"restarted", "params_changed"})


class ReferencePose:
    """The moment to which errors are related: when, how the probe was held, how sure
    its pose was, and how far it had turned by then.
    """

    __slots__ = (
        "about_any",
        "about_up",
        "heading2",
        "is_heading_only",
        "net_up",
        "q",
        "t_us",
        "tilt2",
        "unheard",
        "void",
    )

    def __init__(
        self,
        q: Quat,
        t_us: int,
        pose: Mapping[str, Any],
        turning: Turned,
        *,
        is_heading_only: bool = False,
    ) -> None:
        self.q = q
        self.t_us = t_us
        self.heading2 = _square(pose["heading_sigma_deg"])
        self.tilt2 = _square(pose["tilt_sigma_deg"])
        self.about_any, self.about_up = turning.about_any, turning.about_up
        self.net_up, self.unheard = turning.net_up, turning.unheard
        self.is_heading_only = is_heading_only
        self.void: str | None = None


def _square(sigma: float | None) -> float | None:
    return None if sigma is None else sigma * sigma


class References:
    """The origin of one probe and the targets that were captured, since it started.
    Follows its poses and events; works only while there is one of them.
    """

    def __init__(self) -> None:
        self.quality = Quality()
        self._params: bytes | None = None
        self._followed: tuple[int, bytes | None] = (0, None)  # boot and params
        self._captures: dict[str, ReferencePose] = {}
        self._ended: dict[str, str] = {}  # captures that are void, and why
        self._forget()

    def _forget(self) -> None:
        self._origin: ReferencePose | None = None
        self._awaited: tuple[int, int] | None = None  # detail and time of an event
        self._pose: Mapping[str, Any] | None = None
        self._turning = Turned()
        self._before: tuple[Quat, int] | None = None  # pose up to which it was added
        self._unevenness = Unevenness()

    def tell(self, params: bytes | None) -> None:
        """Takes up what the params say of the sensors. None: that is not known now."""
        self.quality = quality_of(params)
        if params is None:
            return
        if self._params is not None and params != self._params:
            self._end("params_changed")
        self._params = params

    def follow(self, boot: int, params: bytes | None) -> None:
        """Takes up the boot and the params of the message that comes next. Neither is
        asked of the probe, whose later messages may have been read already.
        """
        if (boot, params) == self._followed:
            return
        if boot != self._followed[0]:
            self._forget()
            self._void_captures("restarted")
        self._followed = boot, params
        self.tell(params)

    def on_pose(self, pose: Mapping[str, Any]) -> SinceOrigin | None:
        """Follows a pose as it is published. Its errors since the origin; None: there
        is no origin.
        """
        self._follow(pose)
        return None if self._origin is None else self._since(self._origin)

    def on_event(self, event: Mapping[str, Any], t_device_us: int) -> None:
        """Follows an event as it is published."""
        name = event["event"]
        if name == "tared":
            self._awaited = event["detail"], t_device_us
            self._void_captures("origin_changed")
            if event["detail"] not in (ORIGIN_ALL, ORIGIN_HEADING):
                self._origin = self._awaited = None
        elif name in ENDINGS:
            self._end(name)
            if name == "restarted":
                self._unevenness = Unevenness()

    def capture(self) -> str | None:
        """Keeps the last pose as a reference, and returns its name; None: there is no
        pose, or its attitude is not known.
        """
        pose = self._pose
        if pose is None or pose["tilt_sigma_deg"] is None:
            return None
        name = secrets.token_hex(8)
        q, t_us = pose["q"], pose["t_device_us"]
        self._add(q, t_us)
        self._captures[name] = ReferencePose(q, t_us, pose, self._turning)
        while len(self._captures) > CAPTURES_MAX:
            del self._captures[next(iter(self._captures))]
        return name

    def since_capture(self, name: str) -> SinceOrigin | None:
        """Errors of the last pose since that was captured; None: unknown."""
        reference = self._captures.get(name)
        if reference is not None:
            return self._since(reference)
        why = self._ended.get(name)
        return None if why is None else SinceOrigin(None, None, None, why)

    def _end(self, why: str) -> None:
        if self._origin is not None and self._origin.void is None:
            self._origin.void = why
        self._void_captures(why)

    def _void_captures(self, why: str) -> None:
        self._ended |= dict.fromkeys(self._captures, why)
        self._captures.clear()
        while len(self._ended) > CAPTURES_MAX:
            del self._ended[next(iter(self._ended))]

    def _follow(self, pose: Mapping[str, Any]) -> None:
        self._pose = pose
        sigma = pose["heading_sigma_deg"]
        self._unevenness.add(sigma, pose["t_device_us"])
        flags = pose["flags"]
        is_tared = "tared" in flags
        if is_tared or self._origin is not None:
            self._follow_origin(pose, is_tared=is_tared)
        origin = self._origin
        if (origin is None or origin.void is not None) and not self._captures:
            self._before = None
            return
        if flags:
            if "starting" in flags:
                self._end("starting")
            elif "gap" in flags and "at_rest" not in flags:
                self._end("gap")
        if sigma is None:
            self._turning.lose_heading()
        before, t_us = self._before, pose["t_device_us"]
        if before is None or t_us - before[1] >= STEP_US:
            if before is not None and t_us - before[1] > PAUSE_MAX_US:
                self._end("pause")
            self._add(pose["q"], t_us)

    def _add(self, q: Quat, t_us: int) -> None:
        """Adds what it has turned since the last time, and continues from here."""
        before = self._before
        if before is not None and t_us > before[1]:
            self._turning.add(before[0], q, t_us - before[1])
        self._before = q, t_us

    def _follow_origin(self, pose: Mapping[str, Any], *, is_tared: bool) -> None:
        awaited, self._awaited = self._awaited, None
        if not is_tared:
            self._origin, self._before = None, None
        elif awaited is not None:
            detail, t_us = awaited
            # Relative to an origin of all, the probe was not turned at the event.
            is_heading_only = detail == ORIGIN_HEADING
            q = pose["q"] if is_heading_only else UNTURNED
            self._before = q, t_us
            self._origin = ReferencePose(
                q, t_us, pose, self._turning, is_heading_only=is_heading_only
            )
        elif self._origin is None:
            self._origin = ReferencePose(UNTURNED, 0, pose, self._turning)
            self._origin.void = "unheard"

    def _since(self, then: ReferencePose) -> SinceOrigin:
        pose = self._pose
        if pose is None:
            return SinceOrigin(None, None, None, then.void)
        t_us: int = pose["t_device_us"]
        age_s = max(0.0, (t_us - then.t_us) * 1e-6)
        if then.void is not None:
            age = None if then.void == "unheard" else age_s
            return SinceOrigin(None, None, age, then.void)
        (w0, x0, y0, z0), (w1, x1, y1, z1) = then.q, pose["q"]
        cosine = min(1.0, abs(w0 * w1 + x0 * x1 + y0 * y1 + z0 * z1))
        half_sine = 2.0 * math.sqrt(1.0 - cosine * cosine)
        tilt, heading = pose["tilt_sigma_deg"], pose["heading_sigma_deg"]
        if tilt is not None and not then.is_heading_only:
            tilt2, tilt2_then = tilt * tilt, then.tilt2
            tilt = None
            if tilt2_then is not None:
                least = tilt_variance(tilt2, tilt2_then, half_sine, self.quality)
                tilt = round(capped(least, tilt2 + tilt2_then), 3)
        if heading is not None:
            heading = self._heading(then, heading * heading, age_s, half_sine)
        return SinceOrigin(heading, tilt, age_s)

    def _heading(
        self, then: ReferencePose, heading2: float, age_s: float, half_sine: float
    ) -> float | None:
        heading2_then, now = then.heading2, self._turning
        least = self._unevenness.least
        if heading2_then is None or least is None or self._pose is None:
            return None
        most = heading2_then + heading2
        unheard = now.unheard - then.unheard
        variance = heading_variance(
            age_s=age_s,
            on_s=self._pose["t_device_us"] * 1e-6,
            about_up=now.about_up - then.about_up,
            about_any=now.about_any - then.about_any,
            net_up=abs(now.net_up - then.net_up) + unheard,
            half_sine=half_sine,
            quality=self.quality,
            unsure=most - 2.0 * least * least,
            uneven=self._unevenness.mean,
        )
        return round(capped(variance, most), 3)
