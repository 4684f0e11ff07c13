# SPDX-License-Identifier: MIT
"""What came of a calibration, in words."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from imud.calibration.outcome import Outcome
from imud.calibration.verify import Report
from imud.cli.params_text import TITLES, differences
from imud.params.value import Params


def outcome(probe: str, found: Outcome, before: Params) -> None:
    """Prints the report, and what changes in the params."""
    for line in _lines(probe, found):
        sys.stdout.write(f"{line}\n")
    for line in differences(before, found.params):
        sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _lines(probe: str, found: Outcome) -> Iterator[str]:
    how = f" from {found.poses} stops in {found.seconds:.0f} s" if found.poses else ""
    warm = ""
    if found.temperature_c is not None:
        warm = f", at {found.temperature_c:.1f} degC"
    yield f"{probe}: calibrated{how}{warm}"
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
        yield f"  the room       {found.note}"
    if found.housing_deg is not None:
        turned = f"the sensor is turned by {found.housing_deg:.2f} degrees"
        yield f"  housing        {turned}"


def _left(params: Params, name: str) -> str:
    """What the fit of a sensor leaves over."""
    of = params.calibration(name)
    if of is None or of.residual is None:
        return "calibrated"
    if name == "acc":
        return f"{1000.0 * of.residual / 9.80665:.2f} mg left over at the stops"
    if name == "gyr":
        sure = f"; scale +-{100.0 * of.sigma:.2f} %" if of.sigma is not None else ""
        return f"{57.29578 * of.residual:.2f} degrees left over after a turn{sure}"
    words = f"{of.residual:.2f} uT left over"
    if of.norm_ut is not None and of.dip_deg is not None:
        words += f"; field {of.norm_ut:.1f} uT, {of.dip_deg:.1f} degrees down"
    return words


def verified(probe: str, report: Report) -> int:
    """Prints the verdict on a calibration; the exit code is 1 unless it is good."""
    for finding in report.findings:
        title = TITLES[finding.sensor]
        sys.stdout.write(f"  {title:<14} {finding.verdict}: {finding.words}\n")
    if report.is_good:
        sys.stdout.write(f"{probe}: the calibration is good\n")
        return 0
    sys.stdout.write(f"{probe}: calibrate what is not good: imud calibrate {probe}\n")
    return 1
