# SPDX-License-Identifier: MIT
"""What is estimated of a recording, and what is known of it before.

A recording is cut into intervals of about 0.1 s; a node stands at the beginning of each
and one after the last. World: east, north, up; body: the probe's axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

BoolArray = npt.NDArray[np.bool_]
NODE_S = 0.1

# The state at a node. Its attitude is kept beside it, and TURN is what is still to be
# turned, in the world: always 0 where a step begins.
TURN, SPEED, PLACE = slice(0, 3), slice(3, 6), slice(6, 9)  # rad, m/s, m
FIELD, OWN, BIAS = slice(9, 12), slice(12, 15), slice(15, 18)  # uT, uT (body), rad/s
STATE = 18

# What holds for all of the recording. Matrices, rows first, are less the identity: they
# map measured rates and forces to true ones, and true fields to measured ones.
GYR, ACC_BIAS, ACC, MAG = slice(0, 9), slice(9, 12), slice(12, 21), slice(21, 30)
LAG, GRAVITY = slice(30, 31), slice(31, 32)  # of the magnetometer, s; m/s2
NORTH = slice(32, 34)  # uT: the north and up part of the place's mean field
WHOLE = 34
ON_DIAGONAL = np.array([0, 4, 8])


@dataclass(frozen=True, slots=True)
class Priors:
    """One-sigma values: of a module after a guided calibration, moved by hand."""

    # The gyroscope: ten times a chip's white noise, as it stands for what is in no
    # model; a share of what is turned; and its bias.
    gyr_noise: float = math.radians(0.12)  # rad/sqrt(s)
    gyr_turning: float = 0.0008
    bias_wander: float = math.radians(0.005)  # rad/s/sqrt(s)
    bias: float = math.radians(1.0)
    gyr_scale: float = 0.003
    gyr_cross: float = 0.004
    acc_noise: float = 0.02  # m/s2/sqrt(Hz), and a share of what is accelerated
    acc_moving: float = 0.01
    acc_bias: float = 0.05  # m/s2
    acc_scale: float = 0.003
    acc_cross: float = 0.002
    gravity: float = 0.02
    # A hand's speed and distance are bounded, seen once a second.
    speed: float = 1.0  # m/s
    place: float = 1.0  # m
    rest_speed: float = 0.002
    rest_turn: float = math.radians(0.003)  # rad/sqrt(s)
    mag_noise: float = 12.0  # uT of an interval: what a room adds is alike in many
    room: float = 3.0  # uT, by which the field changes on the way
    room_s: float = 60.0
    room_rest: float = 0.003  # uT/sqrt(s), where nothing moves
    north: float = 0.2  # uT, at the first rest and at rests in the same place
    own: float = 0.2  # uT
    own_wander: float = 0.03  # uT/sqrt(s)
    soft: float = 0.003
    mag_cross: float = 0.002
    lag: float = 0.005  # s, about LAG_S


LAG_S = 0.010
CALIBRATED = Priors()
# By the data sheets of modules as shops sell them.
SHOP = replace(
    CALIBRATED,
    own=30.0,
    soft=0.04,
    mag_cross=0.02,
    gyr_scale=0.02,
    gyr_cross=0.02,
    acc_bias=0.3,
    acc_scale=0.012,
    acc_cross=0.006,
    bias=math.radians(2.0),
)


@dataclass(frozen=True)
class Recording:
    """Samples at a constant rate, (n, 3), in the body frame."""

    rate_hz: float
    gyr: FloatArray  # rad/s, mean since the sample before
    acc: FloatArray  # m/s2
    mag: FloatArray  # uT; NaN without a new reading
    is_bad: BoolArray | None = None  # clipped or missing: neither is believed

    @cached_property
    def each(self) -> int:
        """Samples in an interval."""
        return max(2, round(self.rate_hz * NODE_S))

    @cached_property
    def count(self) -> int:
        """Whole intervals."""
        return len(self.gyr) // self.each

    @property
    def step_s(self) -> float:
        return 1.0 / self.rate_hz

    @property
    def node_s(self) -> float:
        return self.each / self.rate_hz

    @cached_property
    def has_mag(self) -> BoolArray:
        return np.asarray(np.isfinite(self.mag).all(axis=1))

    @cached_property
    def is_bad_node(self) -> BoolArray:
        if self.is_bad is None:
            return np.zeros(self.count, bool)
        return np.asarray(self.by_node(self.is_bad).any(axis=1))

    def by_node(self, rows: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Rows (samples, ...) as (intervals, samples in each, ...)."""
        used = rows[: self.count * self.each]
        return used.reshape(self.count, self.each, *rows.shape[1:])

    def part(self, start: int, end: int) -> Recording:
        """The intervals from `start` to before `end`."""
        used = slice(start * self.each, end * self.each)
        bad = None if self.is_bad is None else self.is_bad[used]
        return Recording(
            self.rate_hz, self.gyr[used], self.acc[used], self.mag[used], bad
        )


@dataclass(slots=True)
class Estimate:
    """What is known so far of `k` intervals."""

    first: FloatArray  # (4,): world_from_body at the first node
    unseen: FloatArray  # (k, 3): turns in the world that the gyroscope did not see, rad
    states: FloatArray  # (k + 1, STATE)
    whole: FloatArray  # (WHOLE,)

    @staticmethod
    def begun(count: int) -> Estimate:
        """Nothing but what sensors are by their data sheets."""
        whole = np.zeros(WHOLE)
        whole[LAG], whole[GRAVITY] = LAG_S, GRAVITY_M_S2
        return Estimate(
            np.array([1.0, 0.0, 0.0, 0.0]),
            np.zeros((count, 3)),
            np.zeros((count + 1, STATE)),
            whole,
        )

    def matrix(self, of: slice) -> FloatArray:
        """GYR, ACC or MAG as a matrix."""
        return np.eye(3) + self.whole[of].reshape(3, 3)

    @property
    def mean_field(self) -> FloatArray:
        """The place's field, whose east part is 0: that is north."""
        return np.concatenate([[0.0], self.whole[NORTH]])


def prior_of_whole(whole: FloatArray, priors: Priors) -> tuple[FloatArray, FloatArray]:
    """How far the parameters are from what is expected, and their sigmas."""
    away, sigma = whole.copy(), np.zeros(WHOLE)
    away[LAG] -= LAG_S
    away[GRAVITY] -= GRAVITY_M_S2
    for of, cross, scale in (
        (GYR, priors.gyr_cross, priors.gyr_scale),
        (ACC, priors.acc_cross, priors.acc_scale),
        (MAG, priors.mag_cross, priors.soft),
    ):
        sigma[of] = cross
        sigma[of][ON_DIAGONAL] = scale
    sigma[ACC_BIAS], sigma[LAG] = priors.acc_bias, priors.lag
    sigma[GRAVITY], sigma[NORTH] = priors.gravity, 100.0
    return away, sigma
