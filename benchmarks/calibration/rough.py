# SPDX-License-Identifier: MIT
"""Learned calibrations of rough modules in use, and their true against their stated
errors: accelerometers off by up to 600 mg, hands that also shift what they turn, rooms
whose field is uneven, gyroscopes that never rest.

A module is inside its data sheet or far outside; the first kind should get a proposal
within a minute, the second a true one or none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.calibration.simulated import FIELD, affine_errors
from benchmarks.common.figure import Figure
from imud.calibration.affine import affine_of
from imud.calibration.algebra import integrated, units
from imud.calibration.learned.learner import Learner, learned_of
from imud.calibration.recording import Sample
from imud.gravity import GRAVITY_M_S2
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.virtual.calibrating import SCALE
from imud.virtual.modules import shop
from imud.virtual.motions.module import MG, Module

SECONDS = 60.0
INSIDE = 1.96  # sigmas
SALT = 0x0FF5

# Of one axis, at most; and of a gyroscope by the MPU-9250's product specification
# (rev. 1.1, 3.1). Its 60 mg of an accelerometer (3.2) are those of shop().
ACC_MAX_MG, GYR_MAX_DPS, IRON_MAX_UT, SCALE_MAX = 600.0, 20.0, 150.0, 0.05
SHEET_DPS = 5.0


@dataclass(frozen=True, slots=True)
class Rough:
    """A module and how it is used."""

    module: Module
    is_usual: bool  # inside its data sheet
    rest_s: float
    shift_m_s2: float  # rms of an axis: the hand's own acceleration
    turn_rad_s: float
    uneven_ut: float
    mag_noise_ut: float


def drawn(seed: int) -> Rough:
    """One of all kinds; half of them are inside their data sheet."""
    random = np.random.default_rng([seed, SALT])
    module, is_usual = shop(random), bool(random.random() < 0.5)
    rest_s = float(random.choice([0.0, random.uniform(1.0, 4.0)], p=[0.3, 0.7]))
    if not is_usual:
        share = 1.0 + random.uniform(-SCALE_MAX, SCALE_MAX, 3)
        module = replace(
            module,
            acc=np.diag(share) @ module.acc,
            acc_bias=random.uniform(-ACC_MAX_MG, ACC_MAX_MG, 3) * MG,
            gyr_bias=np.radians(random.uniform(-GYR_MAX_DPS, GYR_MAX_DPS, 3)),
            mag_bias=units(random.standard_normal(3))
            * random.uniform(0.0, IRON_MAX_UT),
        )
    else:
        module = replace(
            module,
            gyr_bias=np.radians(random.uniform(-SHEET_DPS, SHEET_DPS, 3)),
        )
    return Rough(
        module,
        is_usual,
        rest_s,
        float(random.uniform(0.05, 1.2)),
        float(random.uniform(0.4, 1.6)),
        float(random.choice([0.0, random.uniform(0.0, 2.0)])),
        float(random.uniform(0.4, 0.9)),
    )


def swings(
    random: np.random.Generator, t: FloatArray, hz: tuple[float, float], count: int
) -> FloatArray:
    """Sums of `count` sines of an axis, rms 1."""
    rates = random.uniform(*hz, (count, 3))
    phases = random.uniform(0.0, 2.0 * np.pi, (count, 3))
    sizes = random.normal(size=(count, 3))
    sizes /= np.sqrt((sizes**2).sum(axis=0) / 2.0)
    return np.asarray(
        (sizes * np.sin(2.0 * np.pi * rates * t[:, None, None] + phases)).sum(axis=1)
    )


def samples(rough: Rough, seed: int, seconds: float = SECONDS) -> list[Sample]:
    """Its readings in use."""
    random = np.random.default_rng([seed, SALT, 1])
    hz = SCALE.rate_hz
    t = np.arange(round((seconds + rough.rest_s) * hz)) / hz
    moves = np.clip((t - rough.rest_s) / 0.5, 0.0, 1.0)[:, None]
    rate = rough.turn_rad_s * swings(random, t, (0.05, 0.7), 5) * moves
    attitude = integrated(rate, 1.0 / hz)[:-1]
    shift = rough.shift_m_s2 * swings(random, t, (0.3, 3.0), 5) * moves
    # A room's field changes with the place, and hands move back and forth slowly.
    place = 0.5 * swings(random, t, (0.02, 0.2), 3) * moves
    gradient = random.standard_normal((3, 3))
    gradient = gradient + gradient.T
    gradient -= np.eye(3) * np.trace(gradient) / 3.0
    field = FIELD + rough.uneven_ut / 2.0 * place @ gradient.T
    module = rough.module
    up = np.array([0.0, 0.0, GRAVITY_M_S2])
    acc = np.einsum("tji,tj->ti", attitude, up + shift)
    mag = np.einsum("tji,tj->ti", attitude, field)
    late = round(module.mag_lag_s * hz)
    mag = np.concatenate([np.repeat(mag[:1], late, axis=0), mag])[: len(t)]
    warmth = module.warming(t)[:, None]
    gyr = rate @ module.gyr.T + module.gyr_bias + warmth * module.drift
    gyr += acc @ module.gyr_from_acc.T + random.normal(0.0, 0.0014, gyr.shape)
    acc = acc @ module.acc.T + module.acc_bias + warmth * module.acc_drift
    acc += random.normal(0.0, 0.05, acc.shape)
    mag = mag @ module.mag.T + module.mag_bias
    mag += random.normal(0.0, rough.mag_noise_ut, mag.shape)
    rows = np.hstack([acc / SCALE.acc_m_s2, gyr / SCALE.gyr_rad_s, mag / SCALE.mag_ut])
    return [
        Sample(1000 + round(n * 1e6 / hz), (ax, ay, az), (gx, gy, gz), (mx, my, mz))
        for n, (ax, ay, az, gx, gy, gz, mx, my, mz) in enumerate(
            np.rint(rows).astype(int).tolist()
        )
    ]


def measure(seed: int) -> dict[str, Any]:
    """Each proposal of a minute: its true and its stated errors."""
    rough = drawn(seed)
    learner = Learner(SCALE)
    records, found = b"", []
    for sample in samples(rough, seed):
        if not learner.add(sample):
            continue
        learned = learned_of(learner.begin(records))
        learner.end(learned)
        if learned.proposal is None:
            continue
        proposal = learned.proposal
        # Active at once, as with learn = "apply".
        records = proposal.params.encode()
        found.append(
            {
                "seconds": (sample.t_us - 1000) / 1e6 - rough.rest_s,
                "stated_tilt": proposal.tilt_deg,
                "stated_heading": proposal.heading_deg,
                **errors(rough.module, proposal.params),
            }
        )
    return {"seed": seed, "is_usual": rough.is_usual, "proposals": found}


def errors(module: Module, params: Params) -> dict[str, float]:
    acc = affine_of(params.acc, SCALE.acc_m_s2)
    mag = affine_of(params.mag, SCALE.mag_ut)
    return affine_errors(module, acc, mag)


def figures(rows: Sequence[dict[str, Any]]) -> list[Figure]:
    """Of all proposals, the share inside the stated errors, and the ratio of true to
    stated ones; and how many modules inside their data sheet get one.
    """
    proposals = [each for row in rows for each in row["proposals"]]
    usual = [bool(row["proposals"]) for row in rows if row["is_usual"]]
    others = [bool(row["proposals"]) for row in rows if not row["is_usual"]]
    counts = f"{len(proposals)} proposals, {sum(others)} of {len(others)} bad modules"
    found = [
        Figure(
            "usual modules with a proposal, %",
            100.0 * float(np.mean(usual)),
            (70.0, 100.0),
            (90.0, 100.0),
            counts,
        )
    ]
    for which in ("tilt", "heading"):
        ratio = np.array([each[which] / each[f"stated_{which}"] for each in proposals])
        inside = 100.0 * float((ratio <= INSIDE).mean()) if len(ratio) else math.nan
        rms = math.sqrt(float((ratio**2).mean())) if len(ratio) else math.nan
        found += [
            Figure(f"learned {which} inside 95 %, %", inside, (93.0, 100.0), (95, 100)),
            Figure(f"learned {which}, true / stated rms", rms, (0.3, 1.2), (0.5, 1.1)),
        ]
    return found
