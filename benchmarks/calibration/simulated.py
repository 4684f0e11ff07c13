# SPDX-License-Identifier: MIT
"""Simulated modules in simulated hands: recordings to calibrate from, and the true
errors of a calibration.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from imud import rotation
from imud.calibration.accelerometer import AccFit
from imud.calibration.affine import Affine
from imud.calibration.algebra import closest_turn, spread, units
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.gyroscope import GyrFit
from imud.calibration.magnetometer import MagFit
from imud.calibration.poses import TWELVE
from imud.calibration.recording import Gatherer, Sample, SensorRecording
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.calibrating import (
    PROBE,
    RECORDS_HZ,
    SCALE,
    CalibratingHand,
    Manners,
    Sampler,
)
from imud.virtual.motions.module import Module, SensorSimulator
from imud.virtual.sensors import NO_ERRORS, World, stream

# 48 uT, dip 65.4 degrees, as in the study.
FIELD = np.array([0.0, 20.0, -43.6])
EARTH = World(
    field_ut=float(np.linalg.norm(FIELD)),
    dip_deg=float(np.degrees(np.arctan2(43.6, 20.0))),
    tip_m=PROBE.tip_m,
)
UNEVEN_OVER_M = 0.15  # a field is uneven by so many uT over this distance
ATTITUDES = spread(np.random.default_rng(7), 300)  # world_from_body
UPS = [pose.up for pose in TWELVE]


def samples(
    module: Module,
    seed: int,
    ups: Iterable[FloatArray | None] = UPS,
    manners: Manners | None = None,
    world: World = EARTH,
) -> list[Sample]:
    """The readings of a module while a hand lays it with each of `ups` up."""
    sensor = SensorSimulator(module, RECORDS_HZ, np.random.default_rng([seed, 1]))
    sampler = Sampler()
    exact = stream(
        seed,
        RECORDS_HZ,
        world,
        NO_ERRORS,
        lambda random, hz: CalibratingHand(random, hz, ups, manners or Manners()),
    )
    return list(
        itertools.chain.from_iterable(
            sampler.samples(sensor.feel(piece)) for piece in exact
        )
    )


def uneven(amount_ut: float, random: np.random.Generator) -> World:
    """The same place with a field that changes by so much over UNEVEN_OVER_M."""
    matrix = random.standard_normal((3, 3))
    # Symmetric without a trace: no currents and no charges.
    matrix = matrix + matrix.T
    matrix -= np.eye(3) * np.trace(matrix) / 3.0
    matrix *= 1.2 * amount_ut / UNEVEN_OVER_M / np.linalg.norm(matrix)
    rows = tuple((float(x), float(y), float(z)) for x, y, z in matrix)
    return replace(EARTH, gradient_ut_m=rows)


def recorded(found: Iterable[Sample]) -> SensorRecording:
    """Samples as a recording."""
    return Gatherer.of(SCALE, found).recording()


def housing_error(module: Module, fit: ModuleFit, turn: FloatArray) -> float:
    """By how much it leans when it stands base down on a level table, degrees."""
    up = np.array([[0.0, 0.0, 1.0]])
    felt = (up * GRAVITY_M_S2) @ module.acc.T + module.acc_bias
    return _tilt(units(fit.acc.force(felt) @ turn.T), up)


def fit_errors(module: Module, fit: ModuleFit) -> dict[str, float]:
    """errors() of all three sensors of a fit."""
    return errors(module, fit.acc, fit.mag, fit.gyr)


def errors(
    module: Module,
    acc: AccFit | Affine,
    mag: MagFit | Affine | None,
    gyr: GyrFit | None = None,
) -> dict[str, float]:
    """Rms errors over all attitudes after a calibration, modulo a common turn of all
    sensors: those of the shape.
    """
    into = closest_turn(acc.matrix @ module.acc)
    up = ATTITUDES[:, 2, :]
    felt = (up * GRAVITY_M_S2) @ module.acc.T + module.acc_bias
    seen = units((felt - acc.bias) @ acc.matrix.T @ into)
    found = {"tilt": _tilt(seen, up)}
    if gyr is not None:
        of_gyr = into.T @ gyr.matrix @ module.gyr - np.eye(3)
        found["scale"] = 100.0 * _rms(np.diag(of_gyr))
        found["cross"] = 100.0 * _rms(of_gyr[~np.eye(3, dtype=bool)])
    if mag is not None:
        field = np.einsum("tji,j->ti", ATTITUDES, FIELD)
        felt = field @ module.mag.T + module.mag_bias
        read = (felt - mag.bias) @ mag.matrix.T @ into
        found["heading"] = _heading(seen, read, up, field)
        found["own"] = float(np.linalg.norm(mag.bias - module.mag_bias))
    return found


def _tilt(seen: FloatArray, up: FloatArray) -> float:
    across = np.linalg.norm(np.cross(seen, up), axis=1)
    return _rms(np.degrees(np.arctan2(across, (seen * up).sum(axis=1))))


def _heading(
    seen: FloatArray, read: FloatArray, up: FloatArray, field: FloatArray
) -> float:
    off = _frame(seen, read) @ np.swapaxes(_frame(up, field), 1, 2)
    quat = rotation.from_matrix(off)
    quat = np.where(quat[:, :1] < 0.0, -quat, quat)
    return _rms(np.degrees(2.0 * np.arctan2(quat[:, 3], quat[:, 0])))


def _frame(up: FloatArray, field: FloatArray) -> FloatArray:
    """Attitudes from up and the field in the body: rows east, north, up."""
    east = units(np.cross(field, up))
    return np.stack([east, np.cross(up, east), up], axis=-2)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt((np.asarray(values) ** 2).mean()))
