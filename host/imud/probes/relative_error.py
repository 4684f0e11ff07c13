# SPDX-License-Identifier: MIT
"""The error of a pose relative to an earlier one, from what the probe did meanwhile.
Much of what makes a pose wrong stays the same, and is not in it. The equations were
found on simulated motions: docs/pose.md, benchmarks/honesty/since_origin.py. A page
without a daemon has them, and those of references.py, in web/site/usb/since.js.
"""

from __future__ import annotations

import math

import msgspec

from imud._core import LEVEL_SIGMA_G, TILT_FLOOR_DEG
from imud.gravity import GRAVITY_M_S2
from imud.wire.params import parts_of

LEVEL_MAX_RAD = LEVEL_SIGMA_G  # of the stated tilt, the most by the accelerometer

# Where the params do not tell how good a calibration is.
GYR_UNKNOWN = 0.01  # share of the rate
SETTLING_UNKNOWN_DEG = 0.25  # by which the heading settles after a motion
ACC_UNKNOWN_M_S2 = 0.06 * GRAVITY_M_S2
MAG_UNKNOWN_UT = 21.0
# The least horizontal field of countries between the polar circles.
HORIZONTAL_UNKNOWN_UT = 15.0

# A pause of the poses after which it is not known how far the probe has turned: more
# than two poses are missing at 10 Hz. It counts as turned at a rate that a hand rarely
# keeps up.
PAUSE_US = 250_000
PAUSE_DPS = 180.0
# It moves while it turns by more than this from one of these poses to the next: by 2
# deg/s, or the tremor of a hand at 10 Hz.
MOVING_DEG = 0.1

# Where the field changes with the place of the probe the heading follows it, and the
# stated sigma rises above its least one. In the mean of a minute its square does so by
# 0.14 in a room of 6 uT/m, by 0.65 in one of 12, by 2.5 in one of 24.
EVEN_DEG2 = 0.2
UNEVEN_S, UNEVEN_MAX_DEG2 = 60.0, 10.0
# After a start each motion raises the sigma, too. Once the least one has fallen to this
# share the mean restarts; in an uneven room it falls by a quarter.
SETTLING = 0.5

LOST_DEG = 1e9  # beside which an absolute error is small

Quat = tuple[float, float, float, float]


class Quality(msgspec.Struct, frozen=True):
    """How good the sensors are, in the units of the equations."""

    gyr_share: float = GYR_UNKNOWN  # error of its scale
    settling_deg: float = SETTLING_UNKNOWN_DEG
    # What the error of the field turns the heading by, and that of gravity the level.
    mag_deg: float = math.degrees(MAG_UNKNOWN_UT / HORIZONTAL_UNKNOWN_UT)
    acc_deg: float = math.degrees(ACC_UNKNOWN_M_S2 / GRAVITY_M_S2)
    level2_deg2: float = math.degrees(LEVEL_MAX_RAD) ** 2  # in the stated tilt's square


def quality_of(params: bytes | None) -> Quality:
    """The accuracy of a probe with these params; conservative if they lack it."""
    known = parts_of(params or b"")
    gyr, acc, mag = (known.get(name, {}) for name in ("gyr", "acc", "mag"))
    acc_rad = _or(acc.get("sigma"), ACC_UNKNOWN_M_S2) / GRAVITY_M_S2
    norm, dip = mag.get("norm"), mag.get("dip")
    horizontal = HORIZONTAL_UNKNOWN_UT
    if isinstance(norm, float) and isinstance(dip, float):
        horizontal = max(1.0, norm * math.cos(math.radians(dip)))
    gyr_share = gyr.get("sigma")
    return Quality(
        gyr_share=_or(gyr_share, GYR_UNKNOWN),
        settling_deg=0.0 if isinstance(gyr_share, float) else SETTLING_UNKNOWN_DEG,
        mag_deg=math.degrees(_or(mag.get("sigma"), MAG_UNKNOWN_UT) / horizontal),
        acc_deg=math.degrees(acc_rad),
        level2_deg2=math.degrees(min(math.sqrt(2.0) * acc_rad, LEVEL_MAX_RAD)) ** 2,
    )


def _or(value: object, unknown: float) -> float:
    return value if isinstance(value, float) else unknown


class Turned:
    """How far a probe has turned since it is followed, in degrees."""

    __slots__ = ("about_any", "about_up", "net_up", "unheard")

    def __init__(self) -> None:
        self.about_any = 0.0  # sums of magnitudes, while it moves
        self.about_up = 0.0
        self.net_up = 0.0  # a sum with signs
        self.unheard = 0.0  # by how much `net_up` may be off

    def lose_heading(self) -> None:
        """The heading is not known for a while: it has nothing to do with the one
        before, as after many turns.
        """
        self.about_up += LOST_DEG

    def add(self, before: Quat, q: Quat, elapsed_us: int) -> None:
        """The turn between two attitudes, world_from_body."""
        w0, x0, y0, z0 = before
        w1, x1, y1, z1 = q
        # q times the inverse of before.
        w = w1 * w0 + x1 * x0 + y1 * y0 + z1 * z0
        x = x1 * w0 - w1 * x0 - y1 * z0 + z1 * y0
        y = y1 * w0 - w1 * y0 - z1 * x0 + x1 * z0
        z = z1 * w0 - w1 * z0 - x1 * y0 + y1 * x0
        sine = math.sqrt(x * x + y * y + z * z)
        if sine == 0.0:
            turned = up = 0.0
        else:
            turned = math.degrees(2.0 * math.atan2(sine, abs(w)))
            up = math.copysign(turned * z / sine, z * w)
        self.net_up += up
        if elapsed_us > PAUSE_US:
            most = max(turned, PAUSE_DPS * elapsed_us * 1e-6)
            self.about_any += most
            self.about_up += most
            self.unheard += most
        elif turned > MOVING_DEG:
            self.about_any += turned
            self.about_up += abs(up)


class Unevenness:
    """By how much the square of the stated heading's sigma is above that of its least
    one, in the mean of the last minute, degrees^2. It restarts while the heading is
    still settling: when the least one has fallen to a half.
    """

    __slots__ = ("_begun_at", "_t_us", "least", "mean")

    def __init__(self) -> None:
        self.least: float | None = None  # of the stated headings, degrees
        self.mean = 0.0
        self._begun_at = math.inf  # the least one when the mean began
        self._t_us = 0

    def add(self, sigma: float | None, t_us: int) -> None:
        """A pose as published, with its device time."""
        elapsed_s = min(1.0, max(0.0, (t_us - self._t_us) * 1e-6))
        self._t_us = t_us
        if sigma is None:
            return
        if self.least is None or sigma < self.least:
            self.least = sigma
        if sigma < SETTLING * self._begun_at:
            self._begun_at, self.mean = sigma, 0.0
        above = sigma * sigma - self.least * self.least
        self.mean += (min(above, UNEVEN_MAX_DEG2) - self.mean) * elapsed_s / UNEVEN_S


def heading_variance(
    *,
    age_s: float,
    on_s: float,
    about_up: float,
    about_any: float,
    net_up: float,
    half_sine: float,
    quality: Quality,
    unsure: float,
    uneven: float,
) -> float:
    """Square of the one-sigma error of the heading since a moment, in degrees^2.

    `age_s`: since then; `on_s`: since power-on; `half_sine`: twice the sine of half the
    angle between both attitudes; `unsure`: by how much the squares of the stated sigmas
    of both moments, together, exceed twice the least one, degrees^2; `uneven`: what
    Unevenness has found by now, degrees^2.
    """
    warmth = math.exp(-(on_s - age_s) / 30.0) - math.exp(-on_s / 30.0)
    scale = 2.0 * quality.gyr_share * net_up
    field = half_sine * quality.mag_deg * -math.expm1(-age_s / 20.0)
    room = 3.0 * max(0.0, uneven - EVEN_DEG2) * min(1.0, about_any / 20.0)
    return (
        0.02**2
        + 6e-5 * age_s
        + quality.settling_deg**2 * -math.expm1(-age_s / 5.0)
        + 0.3 * warmth * warmth
        + (5e-4 + 30.0 * quality.gyr_share**2) * about_up
        + 8e-4 * min(60.0, about_any)
        + scale * scale
        + 2.0 * field * field
        + 0.05 * min(1.0, about_any / 90.0) * unsure
        + room * -math.expm1(-age_s / 10.0)
    )


def tilt_variance(
    tilt2: float, tilt2_then: float, half_sine: float, quality: Quality
) -> float:
    """Square of the one-sigma error of the tilt since a moment, degrees^2, from the
    squares of both stated sigmas.
    """
    known = TILT_FLOOR_DEG**2 + quality.level2_deg2
    levelling = max(0.0, tilt2_then - known) + max(0.0, tilt2 - known)
    force = half_sine * quality.acc_deg
    return 0.02**2 + 0.17 * levelling + 80.0 * force * force


def capped(variance: float, most: float) -> float:
    """The sigma, at most that of two errors that have nothing in common."""
    return math.sqrt(variance * most / (variance + most))
