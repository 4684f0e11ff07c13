# SPDX-License-Identifier: MIT
"""The simulated hand: what its sensors measure agrees with what it does.

Each quantity is held against a difference of the one it derives from. Steps of 2 ms are
blunt, so each bound is a share of what the hand does at its strongest.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.virtual import motion, sensors
from imud.virtual.motion import Motion
from imud.virtual.sensors import SensorErrors, World

RATE_HZ = 1000.0


@pytest.fixture(scope="module")
def exact() -> Motion:
    """A minute of the hand as a perfect sensor would feel it."""
    return sensors.generate(60.0, seed=7, errors=sensors.NO_ERRORS)


def rms(values: rotation.FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_the_rate_is_the_attitudes_derivative(exact: Motion) -> None:
    quat = exact.quat
    turned = rotation.multiply(rotation.inverse(quat[:-2]), quat[2:])
    rate = rotation.to_rotation_vector(turned) * RATE_HZ / 2.0
    assert np.abs(exact.gyr).max() > math.radians(300.0)
    assert np.abs(rate - exact.gyr[1:-1]).max() < math.radians(0.05)


def test_velocity_is_the_positions_derivative(exact: Motion) -> None:
    position = exact.position
    speed = (position[2:] - position[:-2]) * RATE_HZ / 2.0
    assert np.abs(exact.velocity).max() > 0.5
    assert np.abs(speed - exact.velocity[1:-1]).max() < 5e-4


def test_specific_force_is_acceleration_against_gravity(exact: Motion) -> None:
    velocity = exact.velocity
    acceleration = (velocity[2:] - velocity[:-2]) * RATE_HZ / 2.0
    felt = rotation.rotate(exact.quat, exact.acc)[1:-1]
    up = np.array([0.0, 0.0, GRAVITY_M_S2])
    assert np.abs(acceleration).max() > 3.0
    # The surface's grain at 60 Hz is what 2 ms resolve worst: 2.4 % of its strength.
    assert np.abs(acceleration + up - felt).max() < 0.05


def test_the_tip_is_at_its_place_in_the_body(exact: Motion) -> None:
    arm = rotation.rotate(exact.quat, np.array(World().tip_m))
    assert np.allclose(exact.position + arm, exact.tip, atol=1e-12)


def test_the_field_is_the_earths_whatever_the_attitude(exact: Motion) -> None:
    field = rotation.rotate(exact.quat, exact.mag)
    dip = math.radians(66.0)
    expected = 49.0 * np.array([0.0, math.cos(dip), -math.sin(dip)])
    assert np.allclose(field, expected, atol=1e-9)


def test_a_magnet_is_a_dipole() -> None:
    magnet = sensors.Magnet((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    along, across = magnet.field_ut(np.array([[0.0, 0.0, 0.1], [0.1, 0.0, 0.0]]))
    # mu0/4pi m/r^3 = 100 uT at 0.1 m; twice that on the axis, against it beside.
    assert along == pytest.approx([0.0, 0.0, 200.0])
    assert across == pytest.approx([0.0, 0.0, -100.0])


def test_a_magnet_disturbs_where_the_sensor_comes_near() -> None:
    world = World(magnets=(sensors.Magnet((0.15, 0.0, 0.05), (0.0, 0.5, 0.0)),))
    felt = sensors.generate(30.0, seed=7, world=world, errors=sensors.NO_ERRORS)
    norm = np.linalg.norm(felt.mag, axis=1)
    expected = world.field_at(felt.position)
    assert np.allclose(rotation.rotate(felt.quat, felt.mag), expected, atol=1e-9)
    assert norm.max() - norm.min() > 10.0


def test_a_rest_is_perfectly_still(exact: Motion) -> None:
    assert exact.is_rest is not None
    assert np.abs(exact.gyr[exact.is_rest]).max() < 1e-12
    force = np.linalg.norm(exact.acc[exact.is_rest], axis=1)
    assert force == pytest.approx(GRAVITY_M_S2, abs=1e-12)


def runs(flags: motion.BoolArray) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [slice(*pair) for pair in itertools.pairwise(edges)][::2]


@pytest.mark.parametrize("seed", range(5))
def test_it_starts_with_three_to_five_seconds_of_rest(seed: int) -> None:
    made = sensors.generate(8.0, seed)
    assert made.is_rest is not None
    assert made.movement is not None
    first = runs(made.is_rest)[0]
    assert first.start == 0
    assert 3.0 <= first.stop / RATE_HZ <= 5.0
    assert (made.movement == (np.arange(len(made)) >= first.stop)).all()


def test_strokes_are_five_to_fifteen_centimetres_along_the_surface(
    exact: Motion,
) -> None:
    assert exact.is_stroke is not None
    strokes = runs(exact.is_stroke)[:-1]  # the end may cut the last one short
    assert len(strokes) > 10
    tip = exact.tip
    for stroke in strokes:
        path = tip[stroke]
        length = np.linalg.norm(path[-1] - path[0])
        assert 0.0499 < length < 0.1501
        # The surface is level at height 0, but for its grain.
        assert np.abs(path[:, 2]).max() < 5e-5


def test_each_round_has_strokes_turns_and_rests(exact: Motion) -> None:
    assert exact.is_rest is not None
    up = rotation.rotate(exact.quat, np.array([0.0, 0.0, 1.0]))[:, 2]
    assert len(runs(exact.is_rest)) >= 3
    assert up.min() < -0.5  # upside down
    assert exact.tip[:, 2].max() > 0.15  # in the air
    assert exact.tip[:, 2].min() > -1e-3  # never inside the table


def test_the_same_seed_gives_the_same_motion() -> None:
    first, again, other = (sensors.generate(6.0, seed) for seed in (3, 3, 4))
    for name in motion.NPZ_KEYS:
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.gyr, other.gyr)


def test_a_stream_is_the_same_motion_in_pieces() -> None:
    whole = sensors.generate(20.0, seed=3)
    pieces = sensors.stream(3)
    gathered = [next(pieces) for _ in range(60)]
    joined = motion.join(gathered)[: len(whole)]
    assert np.array_equal(joined.acc, whole.acc)
    assert np.array_equal(joined.quat, whole.quat)
    assert all(len(piece) < 10 * RATE_HZ for piece in gathered)


def test_noise_has_the_data_sheets_strength_after_the_chips_low_pass() -> None:
    errors = SensorErrors(gyr_offset_dps=0.0, acc_offset_mg=0.0)
    made = sensors.generate(3.0, seed=11, errors=errors)  # all of it rest
    assert made.is_rest.all()
    # A mean over 5 of 1000 records a second, close to 0.443/92 Hz.
    averaged = [
        values.reshape(-1, 5, 3).mean(axis=1) - values.mean(axis=0)
        for values in (made.gyr, made.acc)
    ]
    assert math.degrees(rms(averaged[0])) == pytest.approx(0.1, rel=0.1)
    assert rms(averaged[1]) / GRAVITY_M_S2 == pytest.approx(8e-3, rel=0.1)
    assert rms(made.mag - made.mag.mean(axis=0)) == pytest.approx(0.6, rel=0.1)


def test_offsets_stay_within_their_limits_and_differ_by_seed() -> None:
    errors = SensorErrors(0.0, 0.0, 0.0, 3.0, 60.0, 5.0)
    found = np.array(
        [sensors.generate(0.1, seed, errors=errors).gyr[0] for seed in range(20)]
    )
    limit = math.radians(3.0)
    assert np.abs(found).max() <= limit
    assert np.abs(found).max() > 0.8 * limit
    assert len(np.unique(found)) == found.size
