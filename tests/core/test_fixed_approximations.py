# SPDX-License-Identifier: MIT
"""The functions of fixed.h that approximate, within the bounds that fixed.h promises:
reciprocal roots, angles, sines and cosines, and exp."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import pytest

from core import desk
from core.desk import INT32_MAX, INT32_MIN, ONE, TURN
from core.test_fixed import EDGES, ffi, fits, lib


def away(angles: Any, truth: Any) -> Any:
    """How far turn32 angles are from radians, the short way round."""
    return np.abs(np.remainder(angles / TURN - truth + np.pi, 2 * np.pi) - np.pi)


def test_reciprocal_roots_are_within_1e_7_from_end_to_end():
    x = np.unique(
        np.concatenate(
            [
                np.linspace(2**30, 2**32 - 1, 400_000).astype(np.uint32),
                np.arange(2**30, 2**30 + 5_000, dtype=np.uint32),
                np.arange(2**32 - 5_000, 2**32, dtype=np.uint32),
            ]
        )
    )
    y = desk.mapped(desk.lib.loop_rsqrt, x)
    assert np.abs(y / ONE - 1 / np.sqrt(x / 2.0**32)).max() < 1e-7
    # 2 itself does not fit: it is held at the last step below.
    assert INT32_MAX - 200 <= y.max() <= INT32_MAX


def test_the_origin_has_the_angle_zero():
    assert lib.fixed_atan2(0, 0) == 0


@pytest.mark.parametrize("radius", [1, 2, 1000, 2**30, INT32_MAX])
def test_axes_and_diagonals_have_their_angles(radius):
    quarter = 2**30
    assert lib.fixed_atan2(0, radius) == 0
    assert lib.fixed_atan2(radius, 0) == quarter
    assert lib.fixed_atan2(0, -radius) == INT32_MIN  # half a turn
    assert lib.fixed_atan2(-radius, 0) == -quarter
    bound = 3e-6 * TURN
    for index, (x, y) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        angle = lib.fixed_atan2(y * radius, x * radius) % 2**32
        assert abs(angle - (2 * index + 1) * quarter / 2) < bound


def test_angles_of_points_at_the_edges_are_within_3e_6():
    y, x = np.array(list(product(EDGES, EDGES)), np.int32).T.copy()
    angles = desk.mapped(desk.lib.loop_atan2, y, x)
    assert away(angles, np.arctan2(y, x)).max() < 3e-6
    assert INT32_MIN in x
    assert INT32_MIN in y


def test_angles_in_all_octants_are_within_3e_6():
    random = np.random.default_rng(20)
    truth = random.uniform(-np.pi, np.pi, 200_000)
    radius = 2.0 ** random.uniform(0, 31, truth.size)
    y = np.clip(np.round(radius * np.sin(truth)), INT32_MIN, INT32_MAX).astype(np.int32)
    x = np.clip(np.round(radius * np.cos(truth)), INT32_MIN, INT32_MAX).astype(np.int32)
    angles = desk.mapped(desk.lib.loop_atan2, y, x)
    assert away(angles, np.arctan2(y, x)).max() < 3e-6


def test_sines_and_cosines_are_within_5e_9_also_where_quadrants_meet():
    eighth = 2**29
    edges = [
        turn * eighth + off
        for turn in range(-4, 4)
        for off in (*range(-50, 51), 2**28)
        if fits(turn * eighth + off)
    ]
    grid = np.linspace(INT32_MIN, INT32_MAX, 400_000).astype(np.int64)
    angle = np.concatenate([edges, [INT32_MIN, INT32_MAX], grid]).astype(np.int32)
    sine, cosine = np.zeros_like(angle), np.zeros_like(angle)
    desk.call(desk.lib.loop_sincos, len(angle), angle, sine, cosine)
    assert np.abs(sine / ONE - np.sin(angle / TURN)).max() < 5e-9
    assert np.abs(cosine / ONE - np.cos(angle / TURN)).max() < 5e-9


def test_sine_and_cosine_of_whole_quarters_are_exact_and_never_above_one():
    sine, cosine = ffi.new("int32_t *"), ffi.new("int32_t *")
    one = 2**30
    for quarters, wanted in (
        (0, (0, one)),
        (1, (one, 0)),
        (-1, (-one, 0)),
        (-2, (0, -one)),
    ):
        lib.fixed_sincos(quarters * one, sine, cosine)
        assert (sine[0], cosine[0]) == wanted


def test_exp_is_within_4e_7_from_nothing_to_the_end_of_its_range():
    grid = np.geomspace(1, INT32_MAX, 20_000).astype(np.int64)
    whole = np.arange(40) * math.log(2) * 2**21  # where the power of two changes
    near = [round(x) + off for x in whole.tolist() for off in (-2, -1, 0, 1, 2)]
    for x in sorted({0, INT32_MAX, *grid.tolist(), *(x for x in near if x >= 0)}):
        found = lib.fixed_exp_neg(x) / ONE
        assert abs(found - math.exp(-x / 2**21)) < 4e-7
        assert 0 <= found <= 1 + 7e-8
