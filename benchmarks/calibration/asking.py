# SPDX-License-Identifier: MIT
"""The result of a recording that lacks poses: a guide asks for them,
and the hand lays those that it asks for until both errors are good enough.
"""

from __future__ import annotations

from typing import Any

from benchmarks.calibration import simulated
from benchmarks.calibration.cases import Laid
from imud.calibration import poses
from imud.calibration.faults import CalibrationFault
from imud.calibration.guided import faults, whole
from imud.calibration.guided.procedure import POSES_MAX
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.recording import SensorRecording
from imud.calibration.stops import find_stops
from imud.rotation import FloatArray

Judged = tuple[ModuleFit | None, CalibrationFault | None]


def judged(recording: SensorRecording) -> Judged:
    """Its fit, and the reason for refusing it."""
    fit, stops = whole.fit(recording), find_stops(recording)
    fault = faults.of_module(recording, stops, fit)
    fault = fault or faults.of_score(fit, len(stops), has_mag=True)
    return fit, fault


def laid_as_asked(laid: Laid, first: Judged) -> dict[str, Any]:
    """The result: the number of requested poses, the reason if it is still refused, and
    the errors if it is accepted. `first`: of its recording without those.
    """
    more: list[FloatArray] = []
    fit, fault = first
    while fault is not None and fault.kind in faults.LACKS:
        if len(laid.ups) + len(more) >= POSES_MAX:
            break
        more.append(poses.wanted(fit.acc if fit is not None else None).up)
        fit, fault = judged(laid.recording(more))
    row: dict[str, Any] = {"more": len(more)}
    row["refused"] = fault.kind if fault is not None else None
    if fit is None:
        return row
    row |= {"stated_tilt": fit.score.tilt_deg, "stated": fit.score.heading_deg}
    return row | simulated.errors(laid.module, fit)
