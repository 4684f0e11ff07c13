# SPDX-License-Identifier: MIT
"""Whether a probe measures a known turn (turn.py).

Three measurements of it are independent of each other: that of its poses, that of its
gyroscope, and that of gravity and the magnetic field at both rests. Each is judged by
its own stated error. Gravity's length at both rests shows an accelerometer's bias that
the turn itself hardly shows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.calibration.affine import affine_of
from imud.calibration.algebra import integrated, units
from imud.calibration.recording import Scale
from imud.check.rows import Row, RowVerdict
from imud.check.turn import MOVED_DEG, TIMEOUT_S, TurnGuide, TurnSeen, degrees_of
from imud.gravity import GRAVITY_M_S2
from imud.params.condition import DRIFT_M_S2_K
from imud.params.value import Calibration, Params
from imud.rotation import FloatArray

SIGMAS = 3.0  # of stated error and laying together; 99.7 % of good turns are within
# A stated error above the accuracy of the thesis with these tests, section 4, can't
# show whether the probe is good.
USEFUL_DEG = 2.0
LAID_DEG = 0.2  # one sigma of how exactly a hand lays it against a stop

# Gravity is 9.780 to 9.832 m/s2 between equator and poles: so much from the mean, at
# most, as a standard deviation of places (WGS 84).
PLACES_M_S2 = 0.015
ROOM_UT = 0.3  # 3 uT/m over the way of a hand
GYR_FLOOR_DEG = 0.05
MISSING = 2.5  # of a period: longer steps have samples missing in them


@dataclass(frozen=True, slots=True)
class TurnMeasured:
    """A turn, degrees, and its one-sigma error. None: that is not known."""

    turned_deg: float
    sigma_deg: float | None
    unknown: str = ""  # why there is no error


def rows(
    seen: TurnSeen, scale: Scale, params: Params, wanted_deg: float, laid_deg: float
) -> list[Row]:
    """The table of a turn."""
    tilt_deg = _level_sigma(seen, params)
    turns = {
        "turn by its poses": by_poses(seen),
        "turn by the gyroscope": by_gyroscope(seen, scale, params),
    }
    mags = [rest.mag for rest in seen.rests if rest.mag is not None]
    if len(mags) == len(seen.rests):
        found = by_field(seen, mags, scale, params, tilt_deg)
        turns["turn by gravity and field"] = found
    else:
        turns["turn by gravity"] = by_gravity(seen, scale, params, tilt_deg)
    judged = [_row(name, of, wanted_deg, laid_deg) for name, of in turns.items()]
    if why := _laid_otherwise(list(turns.values()), judged):
        judged = [
            Row(r.name, r.measured, r.normal, r.verdict, why, r.numbers) for r in judged
        ]
    return [*judged, _gravity_row(seen, scale, params)]


def _row(name: str, of: TurnMeasured, wanted_deg: float, laid_deg: float) -> Row:
    numbers = {
        "turned_deg": round(of.turned_deg, 3),
        "wanted_deg": wanted_deg,
        "sigma_deg": None if of.sigma_deg is None else round(of.sigma_deg, 3),
        "laid_sigma_deg": laid_deg,
    }
    measured = f"{of.turned_deg:.2f} degrees, error unknown"
    normal = f"{wanted_deg:g} degrees"
    if of.sigma_deg is None:
        return Row(name, measured, normal, RowVerdict.LOOK, of.unknown, numbers)
    measured = f"{of.turned_deg:.2f} degrees, 1 sigma {of.sigma_deg:.2f}"
    # Both rests are laid by hand.
    limit_deg = SIGMAS * math.hypot(of.sigma_deg, math.sqrt(2.0) * laid_deg)
    normal = f"{wanted_deg:g} ± {limit_deg:.2f} degrees"
    if of.sigma_deg > USEFUL_DEG:
        advice = "the stated error is too large to judge a turn: imud calibrate"
        return Row(name, measured, normal, RowVerdict.LOOK, advice, numbers)
    if abs(of.turned_deg - wanted_deg) <= limit_deg:
        return Row(name, measured, normal, RowVerdict.GOOD, "", numbers)
    return Row(name, measured, normal, RowVerdict.FAULT, _ADVICE[name], numbers)


_ADVICE = {
    "turn by its poses": "the error exceeds the stated one: repeat the turn, and "
    "calibrate again if it remains so (imud calibrate)",
    "turn by the gyroscope": "its scale differs from the calibration, or the "
    "module was replaced: imud calibrate",
    "turn by gravity and field": "repeat the turn away from iron; if the error "
    "remains, accelerometer or magnetometer need a new calibration: imud calibrate",
    "turn by gravity": "the accelerometer needs a new calibration: imud calibrate acc",
}


def _laid_otherwise(turns: Sequence[TurnMeasured], judged: Sequence[Row]) -> str:
    """The advice if all measurements agree on another turn; else empty."""
    known = [(of.turned_deg, of.sigma_deg) for of in turns if of.sigma_deg is not None]
    if len(known) < 3 or any(row.verdict is not RowVerdict.FAULT for row in judged):
        return ""
    weights = np.array([1.0 / max(sigma, 0.01) ** 2 for _, sigma in known])
    values = np.array([turned for turned, _ in known])
    mean = float(values @ weights / weights.sum())
    if any(abs(turned - mean) > SIGMAS * max(sigma, 0.1) for turned, sigma in known):
        return ""
    return f"all sensors measured {mean:.1f} degrees: was it laid against the stops?"


def by_poses(seen: TurnSeen) -> TurnMeasured:
    """The turn between both poses; its error is the second one's (docs/pose.md)."""
    turn = _turn_of(seen)
    since = seen.since
    if since is None or since.void is not None:
        why = since.void if since is not None else "starting"
        return TurnMeasured(
            degrees_of(turn), None, f"its orientation was lost ({why}): repeat it"
        )
    share = _share_about_up(turn)
    heading, tilt = since.heading_sigma_deg, since.tilt_sigma_deg
    # Errors that do not affect this turn may be unknown.
    if (heading is None and share > 0.1) or (tilt is None and share < 0.99):
        return TurnMeasured(
            degrees_of(turn),
            None,
            "its poses have no stated error: see imud list; calibrate it first "
            "(imud calibrate)",
        )
    return TurnMeasured(degrees_of(turn), _about(share, heading or 0.0, tilt or 0.0))


def _turn_of(seen: TurnSeen) -> FloatArray:
    """From the first pose to the second, in the world."""
    first, second = (np.array(rest.q) for rest in seen.rests)
    return rotation.multiply(second, rotation.inverse(first))


def _share_about_up(turn: FloatArray) -> float:
    """Of the axis of a turn in the world: square of its part along the vertical."""
    xyz = turn[1:]
    length2 = float(xyz @ xyz)
    return float(xyz[2] ** 2) / length2 if length2 > 0.0 else 1.0


def _about(share: float, heading: float, tilt: float) -> float:
    return math.sqrt(share * heading * heading + (1.0 - share) * tilt * tilt)


def by_gyroscope(seen: TurnSeen, scale: Scale, params: Params) -> TurnMeasured:
    """The integral of the rates. Their bias is that of the rests, on a line between."""
    first, second = seen.rests
    middles = np.array([(first.last - first.first), 2 * len(seen.gyr)]) / 2.0
    middles[1] -= (second.last - second.first) / 2.0
    at = np.arange(len(seen.gyr))
    bias = np.column_stack(
        [np.interp(at, middles, [first.gyr[i], second.gyr[i]]) for i in range(3)]
    )
    affine = affine_of(params.gyr, scale.gyr_rad_s)
    start, end = round(middles[0]), round(middles[1])
    rate = (seen.gyr - bias) * scale.gyr_rad_s @ affine.matrix.T
    steps_s = seen.steps_s[start:end]
    # A step turns at the mean of the rates at both of its ends.
    turns = (rate[start:end] + rate[start + 1 : end + 1]) / 2.0 * steps_s[:, None]
    turned_deg = degrees_of(rotation.from_matrix(integrated(turns, 1.0)[-1]))
    if steps_s.max() > MISSING * np.median(steps_s):
        return TurnMeasured(turned_deg, None, "samples were lost: repeat the turn")
    sigma = params.gyr.sigma if params.gyr is not None else None
    if sigma is None:
        return TurnMeasured(turned_deg, None, "not calibrated: imud calibrate")
    drift = float(np.linalg.norm(second.gyr - first.gyr)) * scale.gyr_rad_s / 4.0
    drift_deg = math.degrees(drift) * float(steps_s.sum())
    return TurnMeasured(
        turned_deg, math.hypot(sigma * turned_deg, drift_deg, GYR_FLOOR_DEG)
    )


def by_field(
    seen: TurnSeen,
    mags: Sequence[FloatArray],
    scale: Scale,
    params: Params,
    tilt_deg: float | None,
) -> TurnMeasured:
    """From the triads of gravity and field at both rests."""
    acc = affine_of(params.acc, scale.acc_m_s2)
    mag = affine_of(params.mag, scale.mag_ut)
    frames, levels, dips = [], [], []
    for rest, counts in zip(seen.rests, mags, strict=True):
        up = units(acc.apply(rest.acc * scale.acc_m_s2))
        field_ut = mag.apply(counts * scale.mag_ut)
        level = field_ut - up * (up @ field_ut)
        levels.append(float(np.linalg.norm(level)))
        dips.append(-float(up @ field_ut) / max(levels[-1], 1e-6))
        north = level / max(levels[-1], 1e-6)
        frames.append(np.stack([north, np.cross(up, north), up]))
    # Rows are world axes in the body: each is body_to_world.
    turn = rotation.from_matrix(frames[1] @ frames[0].T)
    sigma = params.mag.sigma if params.mag is not None else None
    if sigma is None or tilt_deg is None:
        return TurnMeasured(degrees_of(turn), None, "not calibrated: imud calibrate")
    across = math.degrees(math.hypot(sigma, ROOM_UT) / max(min(levels), 1.0))
    heading_deg = math.sqrt(2.0) * across
    heading_deg = math.hypot(heading_deg, max(map(abs, dips)) * tilt_deg)
    return TurnMeasured(
        degrees_of(turn), _about(_share_about_up(turn), heading_deg, tilt_deg)
    )


def by_gravity(
    seen: TurnSeen, scale: Scale, params: Params, tilt_deg: float | None
) -> TurnMeasured:
    """The angle between both directions of gravity, in which a turn about the vertical
    does not show.
    """
    acc = affine_of(params.acc, scale.acc_m_s2)
    first, second = (units(acc.apply(rest.acc * scale.acc_m_s2)) for rest in seen.rests)
    turned = math.atan2(float(np.linalg.norm(np.cross(first, second))), first @ second)
    if tilt_deg is None:
        return TurnMeasured(
            math.degrees(turned), None, "not calibrated: imud calibrate"
        )
    turn = _turn_of(seen)
    if _share_about_up(turn) > 0.01 and degrees_of(turn) > MOVED_DEG:
        return TurnMeasured(
            math.degrees(turned),
            None,
            "without a magnetometer it measures only turns about a level axis",
        )
    return TurnMeasured(math.degrees(turned), tilt_deg)


def _level_sigma(seen: TurnSeen, params: Params) -> float | None:
    """Of the difference of two levels by the accelerometer, degrees."""
    sigma = _acc_sigma(params.acc, seen.temperature_c)
    if sigma is None:
        return None
    return math.degrees(math.sqrt(2.0) * sigma / GRAVITY_M_S2)


def _acc_sigma(acc: Calibration | None, now_c: float | None) -> float | None:
    """Of an axis, m/s2; more where it is warmer or colder than when calibrated."""
    if acc is None or acc.sigma is None:
        return None
    apart_k = 0.0
    if acc.temperature_c is not None and now_c is not None:
        apart_k = abs(now_c - acc.temperature_c)
    return math.hypot(acc.sigma, (acc.drift_m_s2_k or DRIFT_M_S2_K) * apart_k)


def _gravity_row(seen: TurnSeen, scale: Scale, params: Params) -> Row:
    """The length of gravity at both rests."""
    acc = affine_of(params.acc, scale.acc_m_s2)
    lengths = [
        float(np.linalg.norm(acc.apply(rest.acc * scale.acc_m_s2)))
        for rest in seen.rests
    ]
    measured = " and ".join(f"{length:.3f}" for length in lengths) + " m/s2"
    numbers = {"gravity_m_s2": [round(length, 4) for length in lengths]}
    sigma = _acc_sigma(params.acc, seen.temperature_c)
    if sigma is None:
        advice = "not calibrated: imud calibrate"
        normal = f"{GRAVITY_M_S2:.3f} m/s2"
        return Row("gravity", measured, normal, RowVerdict.LOOK, advice, numbers)
    limit = SIGMAS * math.hypot(sigma, PLACES_M_S2)
    normal = f"{GRAVITY_M_S2:.3f} ± {limit:.3f} m/s2"
    if max(abs(length - GRAVITY_M_S2) for length in lengths) <= limit:
        return Row("gravity", measured, normal, RowVerdict.GOOD, "", numbers)
    advice = "the accelerometer needs a new calibration: imud calibrate acc"
    return Row("gravity", measured, normal, RowVerdict.FAULT, advice, numbers)


def timed_out(guide: TurnGuide) -> Row:
    """The row if a rest did not come in time."""
    what = "turn it, lay it down" if guide.has_first else "lay it down"
    return Row(
        "turn by its poses",
        f"it did not lie still within {TIMEOUT_S:g} s",
        f"{guide.wanted_deg:g} degrees",
        RowVerdict.LOOK,
        f"start again: {what} and let go",
    )
