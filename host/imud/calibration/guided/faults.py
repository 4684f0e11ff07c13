# SPDX-License-Identifier: MIT
"""Faults of a guided calibration, each with its remedy: broken modules, an uneven
field, missing poses.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from imud.calibration import gyroscope, poses
from imud.calibration.accelerometer import means
from imud.calibration.algebra import closest_turn
from imud.calibration.earth import Earth, strangeness
from imud.calibration.faults import CalibrationFault, of_field, of_magnets
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.recording import SensorRecording
from imud.calibration.stops import StaticInterval
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

# An axis is dead if it hardly changes while the others do.
ALIVE_M_S2, DEAD_M_S2 = 0.8 * GRAVITY_M_S2, 0.2 * GRAVITY_M_S2
ALIVE_RAD_S, DEAD_RAD_S = math.radians(40.0), math.radians(0.5)
ALIVE_UT, DEAD_UT = 20.0, 1.0

WRONG_RAD = math.radians(10.0)  # rms of gravity after a turn: axes are swapped
BETTER = 4.0  # swapped axes explain the turns better by this factor
SHAKING_CHI = 4.0
STOPS_MIN = 6  # with fewer the module is not judged


BROKEN = "try another module, and check the wires"


def of_module(
    recording: SensorRecording, stops: list[StaticInterval], fit: ModuleFit | None
) -> CalibrationFault | None:
    """The fault of a sensor that the recording shows; None: none."""
    if fit is None or len(stops) < STOPS_MIN:
        return None
    return _stuck(recording, stops, fit) or _swapped(recording, fit)


def _stuck(
    recording: SensorRecording, stops: list[StaticInterval], fit: ModuleFit
) -> CalibrationFault | None:
    rest, _ = means(recording, stops)
    # A live axis may hardly change, too, but then gravity keeps its length.
    acc = np.ptp(rest, axis=0) if fit.acc.chi > SHAKING_CHI else None
    there = recording.mag[np.isfinite(recording.mag[:, 0])]
    sensors = (
        ("accelerometer", acc, ALIVE_M_S2, DEAD_M_S2),
        ("gyroscope", np.ptp(recording.gyr, axis=0), ALIVE_RAD_S, DEAD_RAD_S),
        (
            "magnetometer",
            np.ptp(there, axis=0) if len(there) else None,
            ALIVE_UT,
            DEAD_UT,
        ),
    )
    for name, swing, alive, dead in sensors:
        if swing is None or np.median(swing) < alive:
            continue
        for axis in np.flatnonzero(swing < dead):
            return CalibrationFault(
                "dead_axis",
                f"the {name}'s {'xyz'[axis]} axis does not respond: it is dead or at "
                "the end of its range",
                BROKEN,
            )
    return None


def _swapped(recording: SensorRecording, fit: ModuleFit) -> CalibrationFault | None:
    if fit.gyr.residual_rad > WRONG_RAD:
        axes = _gyro_axes(recording, fit)
        if axes is not None:
            return CalibrationFault(
                "swapped_axes",
                f"the gyroscope's axes do not fit the accelerometer's: x, y, z seem to "
                f"be {axes}",
                "this firmware does not support this orientation of the module's dies",
            )
        return CalibrationFault(
            "gyroscope",
            "the gyroscope disagrees with gravity by "
            f"{math.degrees(fit.gyr.residual_rad):.0f} degrees after a turn",
            BROKEN,
        )
    mag = fit.mag
    if mag is not None:
        turned = closest_turn(mag.matrix) if np.linalg.det(mag.matrix) > 0.0 else None
        if turned is None or np.trace(turned) < 1.0 + 2.0 * math.cos(0.5):
            return CalibrationFault(
                "swapped_axes",
                "the magnetometer's axes do not fit the accelerometer's",
                "this firmware does not support this orientation of the module's dies",
            )
    return None


def _gyro_axes(recording: SensorRecording, fit: ModuleFit) -> str | None:
    """The signed order of axes that explains the turns; None if no other one does."""
    best, found = fit.gyr.residual_rad / BETTER, None
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            gyr = recording.gyr[:, list(order)] * np.array(signs)
            other = replace(recording, gyr=gyr)
            off = gyroscope.mismatch(other, list(fit.stops), fit.up)
            if off < best:
                best = off
                names = ("-" if s < 0 else "" for s in signs)
                found = ", ".join(
                    n + "xyz"[a] for n, a in zip(names, order, strict=True)
                )
    return found


TOO_FEW_FOR_MOUNT = CalibrationFault(
    "too_few",
    "finding the module's mounting takes five poses",
    "lay the remaining ones, or pass --mount",
)


def not_as_asked(error: Exception) -> CalibrationFault:
    """The first poses show the mounting only if they are the requested ones."""
    return CalibrationFault("not_as_asked", str(error), "start again, base down")


def of_room(fit: ModuleFit, earth: Earth | None) -> CalibrationFault | None:
    """An uneven field, or one that differs from the Earth's at this place."""
    mag = fit.mag
    if mag is None:
        return None
    strange = strangeness(earth, mag.norm_ut, mag.dip_deg) if earth else None
    other = (
        CalibrationFault("strange_room", strange, "move away from it")
        if strange
        else None
    )
    return of_field(mag, fit.score.heading_deg) or other


# Faults that more poses cure.
LACKS = frozenset({"too_few", "missing_poses", "weak_heading"})


def of_score(
    fit: ModuleFit | None, stops: int, *, has_mag: bool
) -> CalibrationFault | None:
    """Why a calibration is not good enough; None if it is. `has_mag`: the magnetometer
    is to be calibrated, too.
    """
    if fit is None:
        return CalibrationFault(
            "too_few",
            f"{stops} poses are too few",
            "lay the probe still in nine or more attitudes, for two seconds each",
        )
    if not fit.score.is_level:
        return _weak_level(fit)
    heading = fit.score.heading_deg
    if not has_mag:
        return None
    if fit.mag is not None and fit.score.is_headed:
        return of_magnets(fit.mag.bias, fit.mag.norm_ut)
    if heading is None:
        return CalibrationFault(
            "no_magnetometer",
            "the magnetometer gave too few readings",
            "calibrate the other sensors alone: imud calibrate acc PROBE, then gyro",
        )
    return of_field(fit.mag, heading) or CalibrationFault(
        "weak_heading",
        f"the heading error would be +-{heading:.1f} degrees",
        f"add poses; {_missing(fit)}",
    )


def _weak_level(fit: ModuleFit) -> CalibrationFault:
    found = f"the tilt error would be +-{fit.score.tilt_deg:.2f} degrees"
    if fit.acc.chi > SHAKING_CHI:
        return CalibrationFault(
            "shaking",
            f"{found}: gravity differs between the poses by "
            f"{fit.acc.residual_m_s2 / GRAVITY_M_S2 * 1000:.1f} mg, more than noise "
            "explains",
            "lay the probe on something solid and let go of it",
        )
    return CalibrationFault("missing_poses", found, _missing(fit))


def _missing(fit: ModuleFit) -> str:
    """The pose that would help most."""
    shown: FloatArray = fit.up
    wanted = poses.wanted(fit.acc)
    if wanted.sign[2] < 0 and shown[:, 2].min() > -0.5:
        return "it was never upside down: turn it over"
    return f"lay it {wanted.words}"
