# SPDX-License-Identifier: MIT
"""The virtual leg: what its probes feel agrees with where they go."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.virtual import leg, leg_probes
from imud.virtual.leg_probes import RATE_HZ

SHORT = leg.Manner(walk_s=4.6, squats=1, raises=1)
FIRM = replace(SHORT, wobble_deg=0.0)


@cache
def made(manner: leg.Manner = SHORT) -> leg.Leg:
    return leg.made(3, manner)


@pytest.mark.nightly
def test_a_leg_is_the_same_for_the_same_seed():
    again = leg.made(3, SHORT)
    for name, motion in made().motions.items():
        np.testing.assert_array_equal(motion.gyr, again.motions[name].gyr)


@pytest.mark.parametrize("name", leg.SEGMENTS)
def test_forces_and_rates_are_those_of_the_course(name: str):
    motion = made().motions[name]
    assert motion.position is not None
    # Over 50 ms, so that noise averages out.
    size = 50
    count = len(motion) // size * size
    force = rotation.rotate(motion.quat, motion.acc)[:count].reshape(-1, size, 3)
    speed = np.gradient(motion.position, 1.0 / RATE_HZ, axis=0)
    change = np.gradient(speed, 1.0 / RATE_HZ, axis=0)[:count].reshape(-1, size, 3)
    off = force.mean(1) - change.mean(1) - [0.0, 0.0, GRAVITY_M_S2]
    assert np.sqrt((off**2).mean()) < 0.3
    step = rotation.multiply(rotation.inverse(motion.quat[:-1]), motion.quat[1:])
    rate = rotation.to_rotation_vector(step) * RATE_HZ
    off = (motion.gyr[:-1] - rate)[: count - size].reshape(-1, size, 3).mean(1)
    assert np.degrees(np.sqrt((off**2).mean())) < 2.0


def test_a_foot_does_not_move_while_it_lies():
    first, _ = made().stages["walk"]
    begin = round((first + SHORT.stride_s) * RATE_HZ)
    lying = made().ankle[begin : begin + round(0.4 * SHORT.stride_s * RATE_HZ)]
    assert np.ptp(lying, axis=0).max() < 1e-9


def test_knees_bend_as_far_as_people_do():
    first, last = (round(each * RATE_HZ) for each in made().stages["walk"])
    bend = np.degrees(made().angles["shank"][first:last, 0])
    assert 50.0 < bend.max() < 75.0
    assert bend.min() > -1.0


def test_probes_sit_askew_by_what_was_asked():
    for name, motion in made(FIRM).motions.items():
        assert motion.quat is not None
        segment = made(FIRM).quats[name]
        sits = rotation.multiply(rotation.inverse(segment), motion.quat)
        off = rotation.multiply(sits[0], rotation.inverse(leg_probes.USUAL))
        turned = np.degrees(np.linalg.norm(rotation.to_rotation_vector(off)))
        assert turned == pytest.approx(SHORT.mount_deg)
        np.testing.assert_allclose(np.abs((sits * sits[0]).sum(1)), 1.0, atol=1e-9)


def test_soft_tissue_wobbles_by_what_was_asked():
    first, last = (round(each * RATE_HZ) for each in made().stages["walk"])
    firm, loose = made(FIRM).motions["shank"].quat, made().motions["shank"].quat
    assert firm is not None
    assert loose is not None
    # The wobble of the probe in its own frame: both sit alike at the start.
    off = rotation.to_rotation_vector(
        rotation.multiply(rotation.inverse(firm), loose)[first:last]
    )
    assert np.degrees(np.sqrt((off**2).mean())) == pytest.approx(SHORT.wobble_deg, 0.01)


def test_steel_under_the_floor_disturbs_the_foot_most():
    def off(name: str) -> float:
        found = np.linalg.norm(made().motions[name].mag, axis=1)
        return float(np.std(found))

    assert off("foot") > 2.0 * off("thigh")
