# SPDX-License-Identifier: MIT
"""The tip from positions that are known from elsewhere, as the thesis has it and by
least squares, and the errors that they state.
"""

from __future__ import annotations

import numpy as np
import pytest

from imud.calibration.affine import MethodError
from imud.calibration.algebra import onto, turn, units
from imud.calibration.path import UP
from imud.calibration.tip.positions import (
    axis_of,
    circle,
    pivot,
    sphere,
    tip_below,
)
from imud.rotation import FloatArray

TIP = np.array([0.12, 0.05, -0.07])
PLACE = np.array([0.3, -0.2, 0.1])
ERROR_M = 1e-3


def cone(
    random: np.random.Generator, count: int, lean_deg: float, error_m: float = ERROR_M
) -> tuple[FloatArray, FloatArray]:
    """Places and attitudes of a probe that leans about its tip, with their errors."""
    lean = np.radians(lean_deg) * np.sqrt(random.uniform(0.0, 1.0, count))
    around = random.uniform(0.0, 2.0 * np.pi, count)
    twist = random.normal(0.0, 0.3, count)
    leans = np.stack([lean * np.cos(around), lean * np.sin(around), twist], axis=1)
    attitudes = turn(leans) @ onto(units(TIP), -UP)
    places = PLACE - attitudes @ TIP + random.normal(0.0, error_m, (count, 3))
    missed = np.radians(0.3) * error_m / ERROR_M
    return places, attitudes @ turn(random.normal(0.0, missed, (count, 3)))


def ring(
    random: np.random.Generator, count: int, radius_m: float, error_m: float = ERROR_M
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Places and attitudes of an upright probe that is turned about itself; its axis
    and its tip in the body.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    turns = turn(angle[:, None] * UP)
    upright = turn(random.normal(0.0, 1.0, 3))
    sensor = np.array([radius_m, 0.0, 0.14])
    places = PLACE + turns @ sensor + random.normal(0.0, error_m, (count, 3))
    return places, turns @ upright, upright.T @ UP, -upright.T @ sensor


def test_exact_poses_give_the_exact_offset() -> None:
    places, attitudes = cone(np.random.default_rng(1), 5, 30.0, error_m=0.0)
    found = pivot(places, attitudes, ERROR_M)
    assert found.offset_m == pytest.approx(TIP, abs=1e-9)
    assert found.residual_m < 1e-9
    assert found.sigma_m.min() > 2e-4  # as sure as the positions are said to be


@pytest.mark.parametrize(("count", "p95_mm"), [(4, 9.0), (30, 2.0), (100, 1.1)])
def test_of_offsets_from_poses_95_percent_are_inside_what_is_stated(
    count: int, p95_mm: float
) -> None:
    random = np.random.default_rng([count, 7])
    errors, inside = [], []
    while len(errors) < 120:
        found = pivot(*cone(random, count, 30.0), ERROR_M)
        off = np.abs(found.offset_m - TIP)
        errors.append(1000.0 * float(np.linalg.norm(off)))
        inside.append(off < 1.96 * found.sigma_m)
    assert np.quantile(errors, 0.95) < p95_mm
    assert 0.92 <= np.mean(inside) <= 0.99


def test_a_sphere_through_four_points_is_theirs() -> None:
    places, _ = cone(np.random.default_rng(2), 4, 45.0, error_m=0.0)
    found = sphere(places, 1e-5)
    assert found.centre == pytest.approx(PLACE, abs=1e-7)
    assert found.radius == pytest.approx(float(np.linalg.norm(TIP)), abs=1e-7)


def test_a_cap_of_a_sphere_is_not_biased_by_noise() -> None:
    random = np.random.default_rng(3)
    length = float(np.linalg.norm(TIP))
    found = [sphere(cone(random, 100, 30.0)[0], ERROR_M) for _ in range(100)]
    errors = np.array([each.radius - length for each in found])
    sigmas = np.array([each.sigma_m for each in found])
    # The algebraic fit alone is wrong by 4 mm here, always to the same side.
    assert abs(np.mean(errors)) < 0.001
    assert 0.9 <= np.mean(np.abs(errors) < 1.96 * sigmas) <= 0.99


@pytest.mark.parametrize(("count", "radius_m"), [(3, 0.02), (30, 0.02), (30, 0.075)])
def test_a_circle_gives_the_axis_and_the_tip_below_it(
    count: int, radius_m: float
) -> None:
    random = np.random.default_rng([count, 4])
    near, inside = [], []
    for _ in range(100):
        places, attitudes, axis, tip = ring(random, count, radius_m)
        found = circle(places, ERROR_M)
        lies = axis_of(found, attitudes)
        off = float(np.linalg.norm(np.cross(lies.axis, axis)))
        near.append(off < 2.45 * lies.sigma_rad)
        distance_m = float(np.linalg.norm(tip)) + random.normal(0.0, ERROR_M)
        offset = tip_below(found, places, attitudes, distance_m, ERROR_M)
        inside.append(np.abs(offset.offset_m - tip) < 1.96 * offset.sigma_m)
        assert off < np.radians(1.5)
    assert np.mean(near) >= 0.93
    assert np.mean(inside) >= 0.93


def test_what_does_not_show_the_tip_is_refused_with_its_cure() -> None:
    random = np.random.default_rng(5)
    places, attitudes = cone(random, 10, 30.0)
    for words, ask in (
        ("too few", lambda: pivot(places[:2], attitudes[:2], ERROR_M)),
        ("two directions", lambda: pivot(places, attitudes[[0] * 10], ERROR_M)),
        ("give 4", lambda: sphere(places[:3], ERROR_M)),
        ("in a plane", lambda: sphere(places * [1, 1, 0], ERROR_M)),
        ("too little", lambda: sphere(cone(random, 6, 3.0)[0], ERROR_M)),
        ("give 3", lambda: circle(places[:2], ERROR_M)),
        ("on a line", lambda: circle(places * [1, 0, 0], ERROR_M)),
        (
            "more than the tip's distance",
            lambda: tip_below(circle(places, ERROR_M), places, attitudes, 1e-3, 1e-3),
        ),
    ):
        with pytest.raises(MethodError, match=words):
            ask()
