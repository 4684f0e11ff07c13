# SPDX-License-Identifier: MIT
"""Rows on the magnetometer: whether it measures, and whether that can be the field of a
place on Earth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from imud.calibration.earth import strangeness
from imud.check import limits
from imud.check.chips import is_dead
from imud.check.evidence import Evidence, Samples
from imud.check.readings import NOISE_FAULT, rest_of
from imud.check.rows import Row, RowVerdict, graded, skipped, worst
from imud.journal.faults import fault_words
from imud.probes.chip import chip_of
from imud.probes.self_test import AXES
from imud.probes.sensors import NINE_AXES, missing_magnetometer

NAME = "magnetometer"
NORMAL = "AK8963 0x48; LSM9DS0 0x49; LIS3MDL 0x3D"
RATE_MIN_HZ = 40.0  # AK8963 and LSM9DS0 measure 100 times a second, the LIS3MDL 80
CALIBRATED_UT = 1.0  # params move the field by more


def rows(evidence: Evidence, samples: Samples) -> Iterator[Row]:
    """One row alone if there is no sensor: the row of the bus gives the reason."""
    if is_dead(evidence):
        yield skipped(NAME, NORMAL, "no sensor")
        return
    row = _magnetometer(evidence, samples)
    yield row
    mag = samples.mag[np.isfinite(samples.mag[:, 0])]
    if row.verdict is RowVerdict.FAULT or len(mag) < 10:
        yield skipped("field", "20 to 70 uT, and the module's own", "no readings")
        return
    rest = rest_of(evidence, samples)
    if rest.is_enough:
        yield _noise(evidence, rest.mag_noise_ut)
    yield _field(evidence, samples)


def _magnetometer(evidence: Evidence, samples: Samples) -> Row:
    hello = evidence.hello
    identity, second = hello.get("who_am_i") or (0, 0)
    fresh = np.isfinite(samples.mag[:, 0])
    seconds = float(samples.steps_us.sum()) * 1e-6
    rate_hz = float(np.count_nonzero(fresh)) / seconds if seconds > 0 else 0.0
    numbers = {"identity": second, "rate_hz": round(rate_hz, 1)}

    def fault(measured: str, advice: str) -> Row:
        return Row(NAME, measured, NORMAL, RowVerdict.FAULT, advice, numbers)

    causes = evidence.causes_of("sensor_fault")
    if causes["mag_stuck"]:
        words = fault_words("sensor_fault", "mag_stuck", 0)
        return fault("blocks its bus, or sends corrupt answers", words)
    if missing := missing_magnetometer(hello):
        is_there = identity in NINE_AXES or hello["sensor"] == "lsm9ds0"
        return fault("does not answer" if is_there else "none", missing)
    if causes["mag_silent"] or not fresh.any():
        return fault(
            "answers, but measures nothing",
            "power the module off and on; if it stays so, it is broken: no heading",
        )
    still = np.ptp(samples.mag[fresh], axis=0) == 0
    if still.all() and fresh.sum() > 50:
        return fault(
            "its readings never change",
            "the magnetometer has hung: power the module off and on",
        )
    measured = f"0x{second:02X}, {rate_hz:.0f} readings a second"
    if still.any() and fresh.sum() > 50:
        axes = ", ".join(axis for axis, is_so in zip(AXES, still, strict=True) if is_so)
        return fault(f"axis {axes} never changes", "the magnetometer is broken")
    if samples.flags["mag_overflow"]:
        measured += f", {samples.flags['mag_overflow']} overflows"
        advice = "a magnet is too close: remove it"
        return Row(NAME, measured, NORMAL, RowVerdict.LOOK, advice, numbers)
    if seconds > 2 and rate_hz < RATE_MIN_HZ:
        advice = "it measures too rarely: power the module off and on"
        return Row(NAME, measured, NORMAL, RowVerdict.LOOK, advice, numbers)
    return Row(NAME, measured, NORMAL, RowVerdict.GOOD, "", numbers)


def _noise(evidence: Evidence, noise_ut: np.ndarray) -> Row:
    limit = chip_of(evidence.hello).mag_noise_ut
    normal = f"up to {limit:g} uT rms"
    if not np.isfinite(noise_ut).all():
        return skipped("magnetometer noise", normal, "too few readings at rest")
    verdict = worst(
        graded(each / limit, 1.0, NOISE_FAULT) for each in noise_ut.tolist()
    )
    advice = ""
    if verdict is not RowVerdict.GOOD:
        advice = (
            "the field changes: a motor, a loudspeaker or a cable with current is "
            "near, or the magnetometer is bad"
        )
    measured = ", ".join(
        f"{axis} {value:.2f}" for axis, value in zip(AXES, noise_ut, strict=True)
    )
    numbers = {"rms": [round(value, 3) for value in noise_ut.tolist()]}
    return Row(
        "magnetometer noise", f"{measured} uT rms", normal, verdict, advice, numbers
    )


def _field(evidence: Evidence, samples: Samples) -> Row:
    fresh = np.isfinite(samples.mag[:, 0])
    raw_ut = np.median(samples.mag[fresh], axis=0) * evidence.hello["mag_lsb"]
    known = np.isfinite(samples.mag_ut[:, 0])
    found_ut, is_calibrated = raw_ut, False
    if known.any():
        found_ut = np.median(samples.mag_ut[known], axis=0)
        is_calibrated = float(np.linalg.norm(found_ut - raw_ut)) > CALIBRATED_UT
    norm_ut = float(np.linalg.norm(found_ut))
    measured = f"{norm_ut:.0f} uT"
    numbers = {
        "uT": [round(v, 2) for v in found_ut.tolist()],
        "norm": round(norm_ut, 2),
    }
    low, high = limits.EARTH_UT
    if is_calibrated and evidence.earth is not None:
        dip_deg = _dip_deg(found_ut, np.median(samples.acc, axis=0))
        odd = strangeness(evidence.earth, norm_ut, dip_deg)
        normal = (
            f"{evidence.earth.norm_uT:.0f} uT, {evidence.earth.dip_deg:.0f} deg dip"
        )
        measured += f", {dip_deg:.0f} deg dip"
        verdict = RowVerdict.GOOD if odd is None else RowVerdict.LOOK
        advice = "" if odd is None else f"{odd}, or the calibration is old"
        return Row("field", measured, normal, verdict, advice, numbers)
    if is_calibrated:
        normal = f"{low:g} to {high:g} uT, calibrated"
        is_good = low <= norm_ut <= high
    else:
        measured += ", not calibrated"
        own = f"15 to {limits.OWN_UT:g} uT of the module's own"
        normal = f"{low:g} to {high:g} uT, and {own}"
        is_good = 1.0 <= norm_ut <= high + limits.OWN_UT
    if is_good:
        return Row("field", measured, normal, RowVerdict.GOOD, "", numbers)
    advice = (
        "not the Earth's field: a magnet, a loudspeaker or iron is near; move the "
        "probe half a metre away and check again"
    )
    if norm_ut < 1.0:
        advice = "no field at all: the magnetometer is broken, or shielded by iron"
    return Row("field", measured, normal, RowVerdict.LOOK, advice, numbers)


def _dip_deg(field_ut: np.ndarray, up: np.ndarray) -> float:
    """How far the field points below the horizon."""
    share = float(field_ut @ up / np.linalg.norm(field_ut) / np.linalg.norm(up))
    return -math.degrees(math.asin(max(-1.0, min(1.0, share))))
