# SPDX-License-Identifier: MIT
"""The output of a guided calibration: events, and a status for a screen."""

from __future__ import annotations

from typing import Literal

import msgspec

from imud.calibration.faults import CalibrationFault
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.mount import PLAIN, ModuleMount, MountTold
from imud.rotation import FloatArray

Phase = Literal["poses", "base_down", "half_turn", "done", "refused"]
OVER = ("done", "refused")


class PoseTaken(msgspec.Struct, frozen=True):
    """A stop counts; `is_new` is False for a repeated attitude."""

    count: int
    up: tuple[float, float, float]
    is_new: bool


class Troubled(msgspec.Struct, frozen=True):
    """Something went wrong; the procedure continues."""

    fault: CalibrationFault


class Finished(msgspec.Struct, frozen=True):
    """The calibration is good. The fit is for readings along the housing's axes;
    `mount` is the module's mounting.
    """

    fit: ModuleFit
    turn: FloatArray | None  # from the sensor's frame to the housing's, if known
    mount: ModuleMount = PLAIN


class FitRefused(msgspec.Struct, frozen=True):
    """The calibration is refused."""

    fault: CalibrationFault


class MountFound(msgspec.Struct, frozen=True):
    """The module's mounting, which was all that was asked for."""

    mount: ModuleMount


Event = MountFound | PoseTaken | Troubled | Finished | FitRefused


class ProcedureStatus(msgspec.Struct, frozen=True):
    """The status for a screen."""

    phase: Phase
    instruction: str = msgspec.field(name="says")  # what to do now
    poses: int
    of: int
    ups: tuple[tuple[float, float, float], ...]  # of the poses that count
    wanted: str | None  # name of the pose to lay it in
    mount: MountTold | None  # how the module is mounted; None: not known yet
    is_still: bool
    still_share: float  # of the time that a pose takes, 0 to 1
    tilt_deg: float | None
    is_level: bool  # the tilt is good enough
    heading_deg: float | None
    is_headed: bool  # so is the heading
    trouble: str | None
    seconds: float
