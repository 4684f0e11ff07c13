# SPDX-License-Identifier: MIT
"""The ground that the papers' filters share, in doubles: the first attitude, and a
motion run through one step after the other. The steps are in each filter's test."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from core.desk import DEGREE, FIELD, FORCE, ONE, RATE, Array, apart_deg, norms
from core.scenes import Attitude, Scene, earth, scene, tumble
from imud import rotation
from length import choose

# quat, rate, force, field or None, seconds -> quat
Step = Callable[[Array, Array, Array, Array | None, float], Array]

UPSIDE_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
BIAS_DEG_S = (1.0, -2.0, 0.5)

# A step in doubles takes ten times as long as ours under the sanitizers.
WILD_S = choose(everyday=12, long=30)

# The rates of both boards and a slower one, both ways up, and a steep field.
motions = pytest.mark.parametrize(
    ("rate_hz", "start", "dip_deg"),
    [
        (200, rotation.IDENTITY, 66),
        (200, UPSIDE_DOWN, 85),
        (100, UPSIDE_DOWN, 66),
        (380, rotation.IDENTITY, 66),
    ],
)


def unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def skew(v: Array) -> Array:
    """The matrix that multiplies like the cross product of v."""
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def matrix_of(quat: Array) -> Array:
    """world_from_body, by Rodrigues' formula."""
    twist = skew(quat[1:])
    return np.asarray(np.eye(3) + 2 * quat[0] * twist + 2 * twist @ twist)


def quat_of(matrix: Array) -> Array:
    """The unit quaternion nearest to a matrix: Bar-Itzhack's eigenvector."""
    (a, b, c), (d, e, f), (g, h, i) = matrix
    form = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, b + d, c + g],
            [c - g, b + d, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    return np.asarray(np.linalg.eigh(form)[1][:, -1])


def facing(up: Array, north: Array) -> Array:
    """world_from_body of the vertical and of anything that points north."""
    east = unit(np.cross(north, up))
    return np.array([east, np.cross(up, east), up])


def level(force: Array) -> Array:
    """world_from_body with the body's x, or y where x is steep, to the east."""
    up = unit(force)
    ahead = np.eye(3)[1 if abs(up[0]) > 0.5 else 0]
    return facing(up, np.cross(up, ahead))


def run(
    felt: Scene,
    step: Step,
    biases: dict[int, Array],
    told: Callable[[], None] = lambda: None,
) -> Array:
    """An attitude a sample; `biases` says from which sample on one is removed.

    `told` is called at each.
    """
    rows = felt.measurements()
    out = np.zeros((len(felt), 4))
    quat = rotation.IDENTITY
    bias = np.zeros(3)
    has_level = has_heading = False
    for i, row in enumerate(rows):
        if i in biases:
            bias = biases[i]
            told()
        force = row["acc_m_s2_q21"] / FORCE
        field = row["mag_ut_q18"] / FIELD if row["has_mag"] else None
        if not has_level or (field is not None and not has_heading):
            matrix = matrix_of(quat) if has_level else level(force)
            has_level = True
            if field is not None:
                has_heading = True
                matrix = facing(matrix[2], field)
            quat = quat_of(matrix)
        else:
            rate = row["gyr_rad_s_q25"] / RATE - bias
            quat = step(quat, rate, force, field, felt.interval_us[i] / 1e6)
        out[i] = quat
    return out


def wild(rate_hz: int, seconds: float, seed: int, **options: Any) -> Scene:
    """Turns of up to 2000 deg/s, and a force in addition to gravity."""
    return scene(
        tumble(seconds, rate_hz, seed, options.pop("start", rotation.IDENTITY)),
        rate_hz,
        seed=seed,
        field_ut=earth(options.pop("dip_deg", 66.0)),
        gyr_bias_deg_s=BIAS_DEG_S,
        sway_m_s2=options.pop("sway_m_s2", 1.0),
    )


def apart_from(
    felt: Scene, name: str, step: Step, on_bias: Callable[[], None] = lambda: None
) -> tuple[Array, Array]:
    """How far the filter of that name is from doubles, degrees, and what it found.

    Both learn of the bias after 3 s.
    """
    told = 3 * felt.rate_hz
    fixed = Attitude(name, felt.rate_hz)
    before, _ = fixed.feel(felt[:told])
    fixed.set_bias(BIAS_DEG_S)
    after, _ = fixed.feel(felt[told:])
    found = np.concatenate([before, after])
    truth = run(felt, step, {told: np.array(BIAS_DEG_S) * DEGREE}, on_bias)
    return apart_deg(found, truth), found


def assert_within_0_001_degrees(
    name: str, step: Step, rate_hz: int, start: Array, dip_deg: float
) -> None:
    """The filter of that name is as near to doubles as that, root mean square."""
    felt = wild(rate_hz, WILD_S, 5, start=start, dip_deg=dip_deg)
    apart, found = apart_from(felt, name, step)
    assert rms(apart) < 0.001
    assert np.abs(norms(found) / ONE - 1).max() < 1e-6


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
