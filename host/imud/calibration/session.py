# SPDX-License-Identifier: MIT
"""A calibration of any kind as a screen follows it: samples in, a state of JSON values
out. It does no I/O and has no clock.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import msgspec
import numpy as np

from imud.calibration import poses
from imud.calibration.affine import affine_of
from imud.calibration.earth import Earth
from imud.calibration.faults import CalibrationFault
from imud.calibration.guided.events import Event, Finished, FitRefused, MountFound
from imud.calibration.guided.procedure import POSES as POSES_WANTED
from imud.calibration.guided.procedure import Procedure
from imud.calibration.guided.result import result_of_fit, result_of_wave
from imud.calibration.guided.verify import Verify
from imud.calibration.guided.wave import Wave, Waving
from imud.calibration.mounting import ASKED, of_calibration, result_of_mount, through
from imud.calibration.papers.extremes import Extremes
from imud.calibration.recording import Sample, Scale
from imud.calibration.result import CalibrationResult
from imud.calibration.score import stated_tilt_deg
from imud.calibration.tip.guide import Dimpling
from imud.calibration.tip.result import result_of_tip
from imud.calibration.tip.score import INSIDE
from imud.calibration.tip_found import TipFound
from imud.errors import ImudError
from imud.params.value import Params

Kind = Literal["all", "acc", "gyro", "mag", "mount", "tip", "verify"]
SENSORS = {"all": ("acc", "gyr", "mag"), "acc": ("acc",), "gyro": ("gyr",)}

POSES = {pose.name: pose for pose in poses.ALL}


@dataclass(frozen=True, slots=True)
class Subject:
    """The probe and its data."""

    scale: Scale
    params: Params  # active
    has_mag: bool
    earth: Earth | None = None  # the field of the place, if it is known


@dataclass(slots=True)
class CalibrationSession:
    """Runs one kind of calibration until it ends. `day` goes into the params."""

    kind: Kind
    subject: Subject
    day: datetime.date
    phase: Literal["running", "done", "refused"] = "running"
    outcome: CalibrationResult | None = None
    _guide: Procedure | Waving | Verify | Dimpling = field(init=False)
    _bar: Extremes = field(default_factory=Extremes)
    _findings: list[dict[str, Any]] = field(default_factory=list)
    _why: str | None = None
    _last_us: int = -1

    def __post_init__(self) -> None:
        subject, kind = self.subject, self.kind
        scale, params = subject.scale, subject.params
        if kind == "verify":
            self._guide = Verify(scale, params, subject.has_mag)
        elif kind == "tip":
            self._guide = Dimpling(scale, params)
        elif kind == "mag":
            acc = affine_of(params.acc, scale.acc_m_s2)
            gyr = affine_of(params.gyr, scale.gyr_rad_s)
            mount = of_calibration(params.acc)
            self._guide = Waving(scale, acc, gyr, stated_tilt_deg(params.acc), mount)
            if not subject.has_mag:
                self._refuse("this probe has no magnetometer")
        else:
            self._guide = Procedure(
                scale,
                count=len(ASKED) if kind == "mount" else POSES_WANTED,
                wants_housing=kind == "all",
                has_mag=subject.has_mag and kind == "all",
                earth=subject.earth,
                mount=None,
                is_mount_alone=kind == "mount",
            )

    @property
    def is_over(self) -> bool:
        """Whether it has ended, with or without a result."""
        return self.phase != "running"

    def feed(self, sample: Sample) -> None:
        """Takes the next sample."""
        if self.is_over:
            return
        if sample.t_us < self._last_us:
            self._refuse("the probe restarted; start again")
            return
        self._last_us = sample.t_us
        if sample.mag is not None:
            self._bar.add_reading(np.array(sample.mag) * self.subject.scale.mag_ut)
        guide = self._guide
        if isinstance(guide, Procedure):
            self._guided(guide.feed(sample))
        elif isinstance(guide, Waving):
            self._waved(guide, guide.feed(sample))
        elif isinstance(guide, Dimpling):
            self._wobbled(guide.feed(sample))
        elif (report := guide.feed(sample)) is not None:
            self._findings = [msgspec.to_builtins(each) for each in report.findings]
            self.phase = "done"

    def end(self) -> None:
        """The user ends it early: evaluates the samples so far."""
        if self.is_over:
            return
        guide = self._guide
        if isinstance(guide, Procedure):
            self._guided(guide.end())
        elif isinstance(guide, Waving):
            self._waved(guide, guide.end())
        elif isinstance(guide, Dimpling):
            self._wobbled(guide.end())
        else:
            self._refuse("it was stopped too early; start again")

    def _guided(self, events: list[Event]) -> None:
        for event in events:
            if isinstance(event, FitRefused):
                self._refuse(str(event.fault))
            elif isinstance(event, Finished):
                self._make(partial(self._of_fit, event))
            elif isinstance(event, MountFound):
                self._make(partial(result_of_mount, event.mount, self.subject.params))

    def _of_fit(self, event: Finished) -> CalibrationResult:
        subject = self.subject
        return through(
            event.mount,
            subject.params,
            lambda before: result_of_fit(
                event.fit,
                subject.scale,
                before,
                event.turn,
                self.day,
                sensors=SENSORS[self.kind],
                earth=subject.earth,
            ),
        )

    def _waved(self, guide: Waving, found: Wave | CalibrationFault | None) -> None:
        if isinstance(found, CalibrationFault):
            self._refuse(str(found))
        elif found is not None:
            scale, params = self.subject.scale, self.subject.params
            warmth = guide.temperature_c

            def make(before: Params) -> CalibrationResult:
                return result_of_wave(found, scale, before, warmth, self.day)

            self._make(partial(through, guide.mount, params, make))

    def _wobbled(self, found: TipFound | CalibrationFault | None) -> None:
        if isinstance(found, CalibrationFault):
            self._refuse(str(found))
        elif found is not None:
            self._make(partial(result_of_tip, found, self.subject.params, self.day))

    def _make(self, outcome: Callable[[], CalibrationResult]) -> None:
        try:
            self.outcome = outcome()
        except ImudError as error:
            self._refuse(str(error))
        else:
            self.phase = "done"

    def _refuse(self, why: str) -> None:
        self.phase, self._why = "refused", why

    def state(self) -> dict[str, Any]:
        """The state for a screen."""
        state: dict[str, Any] = {
            "kind": self.kind,
            "phase": self.phase,
            "why": self._why,
            "quality_percent": self._bar.quality_percent,
            "findings": self._findings,
            "ellipsoid": self._ellipsoid(),
            "outcome": _told(self.outcome) if self.outcome is not None else None,
        }
        guide = self._guide
        if isinstance(guide, Dimpling):
            shown: dict[str, Any] = msgspec.to_builtins(guide.status())
            shown["step"] = shown.pop("phase")
            return shown | state
        if isinstance(guide, Procedure):
            status: dict[str, Any] = msgspec.to_builtins(guide.status())
            pose = POSES.get(status["wanted"] or "")
            status["step"] = status.pop("phase")
            status["wanted"] = None if pose is None else pose.up.tolist()
            return status | state
        state |= {"says": guide.instruction, "seconds": guide.seconds}
        if isinstance(guide, Waving) and guide.wave is not None:
            state["heading_deg"] = guide.wave.heading_deg
        return state

    def _ellipsoid(self) -> dict[str, Any] | None:
        """The magnetometer's fit so far, for readings in uT."""
        guide = self._guide
        fit = None
        if isinstance(guide, Procedure) and guide.fit is not None:
            fit = guide.fit.mag
        elif isinstance(guide, Waving) and guide.wave is not None:
            fit = guide.wave.mag
        if fit is None:
            return None
        return {
            "matrix": fit.matrix.tolist(),
            "bias_uT": fit.bias.tolist(),
            "norm_uT": fit.norm_ut,
        }


def _told(found: CalibrationResult) -> dict[str, Any]:
    """The result, and the params that have it."""
    left = {}
    for name in found.sensors:
        of = found.params.calibration(name)
        left[name] = of.residual if of is not None else None
    return {
        "sensors": list(found.sensors),
        "residuals": left,  # m/s2, rad, uT
        "poses": found.poses,
        "seconds": found.seconds,
        "temperature_c": found.temperature_c,
        "tilt_deg": found.tilt_deg,
        "heading_deg": found.heading_deg,
        "level_uT": found.level_ut,
        "housing_deg": found.housing_deg,
        "note": found.note,
        "mount": msgspec.to_builtins(found.mount),
        "tip": _tip(found.tip) if found.tip is not None else None,
        "records": found.params.encode().hex(),
        "digest": f"{found.params.digest:08x}",
    }


def _tip(found: TipFound) -> dict[str, Any]:
    """Where the tip is, and within which distance 95 % of such tips are."""
    return {
        "offset_m": found.offset_m.tolist() if found.offset_m is not None else None,
        "error_m": INSIDE * found.sigma_m if found.sigma_m is not None else None,
    }
