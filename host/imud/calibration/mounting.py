# SPDX-License-Identifier: MIT
"""How a module is mounted in its housing, found from poses and kept in its params. The
small turn that is left is housing.py's.

The turn is in the matrices of all three sensors (docs/params.md), so that firmware and
filter know of the housing's axes alone: x ahead, y to the left, z to the top.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from imud.calibration.mount import ALL, PLAIN, ModuleMount, MountError, of_matrix
from imud.calibration.result import CalibrationResult
from imud.gravity import GRAVITY_M_S2
from imud.params.value import Calibration, Params
from imud.rotation import FloatArray

SENSORS = ("acc", "gyr", "mag")
# The poses that show a mounting, in the order of the guide's requests. Three are
# enough; the others verify that the requests were followed.
ASKED = ((0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0))
# The residual of the forces for the best mounting, in g: a hand misses a face by
# 10 degrees, a scale is off by 5 %. A wrong pose leaves 0.7.
LEFT_MAX_G = 0.4


def of_calibration(of: Calibration | None) -> ModuleMount:
    """The calibration of a sensor; the identity if it has none."""
    found = None if of is None else of_matrix(np.array(of.matrix))
    return found or PLAIN


def mounted(params: Params, mount: ModuleMount) -> Params:
    """The params with all three sensors mounted so; everything else is kept."""
    for name in SENSORS:
        before = params.calibration(name)
        old = of_calibration(before)
        if (old.turn == mount.turn).all():
            continue
        values: dict[str, Any] = {"bias_counts": (0.0, 0.0, 0.0), "method": "typed"}
        matrix = mount.turn
        if before is not None:
            values = params.plain(name) or {}
            matrix = mount.turn @ old.turn.T @ np.array(before.matrix)
        params = params.replaced(name, {**values, "matrix": matrix.tolist()})
    return params


def result_of_mount(mount: ModuleMount, before: Params) -> CalibrationResult:
    """The params before with all sensors mounted so."""
    params = mounted(before, mount)
    params.check()
    return CalibrationResult(params, (), len(ASKED), mount=mount.told())


def through(
    mount: ModuleMount, before: Params, make: Callable[[Params], CalibrationResult]
) -> CalibrationResult:
    """The result of `make` for turned readings, converted to the module's own.
    It gets the params before as they would be of a module with the housing's axes.
    """
    turned = _turned(mounted(before, mount), mount.turn)
    found = make(turned)
    params = _turned(found.params, mount.turn.T)
    params.check()
    return replace(found, params=params, mount=mount.told())


def _turned(params: Params, turn: FloatArray) -> Params:
    """Calibrations of readings that were turned before."""
    for name in SENSORS:
        of = params.calibration(name)
        if of is not None:
            own = {
                "matrix": (np.array(of.matrix) @ turn.T).tolist(),
                "bias_counts": (turn @ of.bias_counts).tolist(),
            }
            params = params.replaced(name, {**(params.plain(name) or {}), **own})
    return params


@dataclass(slots=True)
class MountFinder:
    """Finds how a module is mounted from the first poses of a guide."""

    forces_g: list[FloatArray] = field(default_factory=list)
    failures: int = 0

    @property
    def asked(self) -> tuple[int, int, int]:
        """Where up should be in the housing now."""
        return ASKED[min(len(self.forces_g), len(ASKED) - 1)]

    def add(self, force_m_s2: FloatArray) -> ModuleMount | None:
        """The mean reading of a stop in the pose that was asked for; the mounting once
        it is known. MountError if the poses contradict it: then it starts again.
        """
        self.forces_g.append(force_m_s2 / GRAVITY_M_S2)
        count = len(self.forces_g)
        if count < 2:
            return None
        best, left = self._best()
        if left > LEFT_MAX_G:
            self.forces_g.clear()
            self.failures += 1
            raise MountError("these poses match no possible mounting of a module")
        return best if count == len(ASKED) else None

    def _best(self) -> tuple[ModuleMount, float]:
        """The mounting that explains the forces best with an offset of the sensor, and
        the largest residual force, g.
        """
        forces = np.array(self.forces_g)
        asked = np.array(ASKED[: len(forces)], dtype=float)
        centred, ups = forces - forces.mean(axis=0), asked - asked.mean(axis=0)

        def left(mount: ModuleMount) -> float:
            return float(np.linalg.norm(centred - ups @ mount.turn, axis=1).max())

        best = min(ALL, key=left)
        return best, left(best)
