# SPDX-License-Identifier: MIT
"""The result of a calibration, in words."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from imud.calibration.guided.verify import Report
from imud.calibration.result import CalibrationResult
from imud.calibration.tip.score import INSIDE
from imud.calibration.tip_found import TipFound
from imud.cli.params_text import differences, drift_words
from imud.gravity import GRAVITY_M_S2
from imud.params.condition import TITLES
from imud.params.value import Params

AROUND = 2.45  # of two axes' sigma: 95 % of directions are nearer


def outcome(probe: str, found: CalibrationResult, before: Params) -> None:
    """Prints the report, and what changes in the params."""
    for line in _lines(probe, found):
        sys.stdout.write(f"{line}\n")
    for line in differences(before, found.params):
        sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _lines(probe: str, found: CalibrationResult) -> Iterator[str]:
    if not found.sensors and found.mount is not None and found.tip is None:
        yield f"{probe}: {found.mount.words}"
        return
    how = f" from {found.poses} stops in {found.seconds:.0f} s" if found.poses else ""
    if found.tip is not None and found.seconds:
        how = f" from {found.seconds:.0f} s of wobbling"
    elif found.seconds and not found.poses:
        how = f" from {found.seconds:.0f} s of motion"
    warm = ""
    if found.temperature_c is not None:
        warm = f", at {found.temperature_c:.1f} degC"
    yield f"{probe}: calibrated{how}{warm}"
    if found.tip is not None:
        yield from _tip(found.tip)
    if found.tilt_deg is not None:
        yield f"  tilt           +-{found.tilt_deg:.2f} degrees"
    if found.heading_deg is not None and found.level_ut is not None:
        yield (
            f"  heading        +-{found.heading_deg:.2f} degrees here, where "
            f"{found.level_ut:.1f} uT of the field are level"
        )
    for name in found.sensors:
        yield f"  {TITLES[name]:<14} {_left(found.params, name)}"
    if found.note is not None:
        yield f"  surroundings   {found.note}"
    if found.mount is not None:
        yield f"  mounting       {found.mount.words}"
    if found.housing_deg is not None:
        turned = f"the sensor is turned by {found.housing_deg:.2f} degrees"
        yield f"  housing        {turned}"
    yield from (f"  missing        {words}" for words in found.missing)


def _tip(found: TipFound) -> Iterator[str]:
    if found.offset_m is not None:
        x, y, z = 1000.0 * found.offset_m
        sure = ""
        if found.sigma_m is not None:
            sure = f", +-{INSIDE * 1000.0 * found.sigma_m:.1f} mm (95 %)"
        yield f"  tip            {x:.1f} {y:.1f} {z:.1f} mm from the sensor{sure}"
    if found.axis is not None:
        x, y, z = found.axis
        sure = ""
        if found.axis_sigma_deg is not None:
            sure = f", +-{AROUND * found.axis_sigma_deg:.2f} degrees (95 %)"
        yield f"  axis           {x:.3f} {y:.3f} {z:.3f}{sure}"
    if found.note is not None:
        yield f"  note           {found.note}"


def changed(probe: str, params: Params) -> int:
    """Reports the active params."""
    sys.stdout.write(
        f"{probe}: params {params.digest:08x} are active; "
        f"imud calibrate undo {probe} restores the previous ones\n"
    )
    return 0


def not_changed(probe: str, params: Params) -> int:
    """Reports params that were not activated."""
    sys.stdout.write(f"{probe}: params {params.digest:08x} were not activated\n")
    return 0


def _left(params: Params, name: str) -> str:
    """The residual of the fit of a sensor."""
    of = params.calibration(name)
    if of is None or of.residual is None:
        return "calibrated"
    if name == "acc":
        left = f"{1000.0 * of.residual / GRAVITY_M_S2:.2f} mg residual at the stops"
        drift = of.drift_m_s2_k
        return left if drift is None else f"{left}; {drift_words(drift)}"
    if name == "gyr":
        sure = f"; scale +-{100.0 * of.sigma:.2f} %" if of.sigma is not None else ""
        return f"{57.29578 * of.residual:.2f} degrees residual after a turn{sure}"
    words = f"{of.residual:.2f} uT residual"
    if of.norm_ut is not None and of.dip_deg is not None:
        words += f"; field {of.norm_ut:.1f} uT, dip {of.dip_deg:.1f} degrees"
    return words


def verified(probe: str, report: Report) -> int:
    """Prints the verdict on a calibration; the exit code is 1 unless it is good."""
    for finding in report.findings:
        title = TITLES[finding.sensor]
        sys.stdout.write(f"  {title:<14} {finding.verdict}: {finding.words}\n")
    if report.is_good:
        sys.stdout.write(f"{probe}: the calibration is good\n")
        return 0
    sys.stdout.write(
        f"{probe}: recalibrate the sensors that are not good: imud calibrate {probe}\n"
    )
    return 1
