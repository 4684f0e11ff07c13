# SPDX-License-Identifier: MIT
"""The filter of sensors that are calibrated well, a little or not at all: what it
starts from, and what it states."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core import desk
from core.desk import lib
from core.fuse_desk import centred, rms, twin_stating
from core.scenes import Filter, Scene, at_rest, scene, tumble
from imud import rotation

NULL = 2**16 - 1
MILLI_G = 9.80665e-3
UNIT_UT2 = 2.0**19  # of the field's covariance
OWN_UT = (25.0, -18.0, 12.0)  # a module's own field
LEANS_MG = (20.0, -25.0, 15.0)  # and its accelerometer's bias


def filter_with(acc: int = NULL, gyr: int = NULL, mag: int = NULL) -> Filter:
    """A filter that was told these sigmas."""
    calibration = desk.ffi.new("struct calibration *", desk.UNKNOWN[0])
    calibration.acc.sigma, calibration.gyr.sigma = acc, gyr
    calibration.mag.sigma = mag
    found = Filter(200)
    lib.fuse_set_accuracy(found.c, calibration)
    return found


def of_the_shop(felt: Scene) -> Scene:
    felt.mag += np.array(OWN_UT)
    felt.acc += np.array(LEANS_MG) * MILLI_G
    return felt


@pytest.mark.parametrize(
    ("sigma", "ut"),
    [
        (0, 0.79),
        (79, 0.79),
        (100, 1.0),
        (500, 5.0),
        (2099, 20.99),
        (2100, 21),
        (NULL, 21),
    ],
)
def test_the_own_field_is_as_uncertain_as_its_calibration_left_it(sigma, ut):
    deviation = math.sqrt(filter_with(mag=sigma).c.settings.own_variance / 16)
    assert deviation == pytest.approx(ut, abs=0.05)


@pytest.mark.parametrize(
    ("sigma", "degrees"),
    [(0, 0.0), (100, 0.0826), (4160, 3.437), (4161, 3.438), (NULL, 3.438)],
)
def test_the_level_is_as_uncertain_as_two_axes_of_the_accelerometer(sigma, degrees):
    variance = filter_with(acc=sigma).c.settings.level_variance / desk.ONE
    assert math.degrees(math.sqrt(variance)) == pytest.approx(degrees, abs=1e-3)


@pytest.mark.parametrize(
    ("sigma", "percent"),
    [(0, 0.03), (50, 0.0583), (999, 0.996), (1000, 1.0), (NULL, 1.0)],
)
def test_scales_are_as_uncertain_as_their_calibration_left_them(sigma, percent):
    pairs = filter_with(gyr=sigma).c.state.motion_covariance
    for state in (3, 4, 5):
        variance = pairs[lib.kalman_variance(state)] / 2.0**21
        assert 100 * math.sqrt(variance) / 500 == pytest.approx(percent, abs=0.005)


@pytest.fixture(scope="module")
def shop() -> Scene:
    """A minute in a hand with a module from the shop."""
    return of_the_shop(scene(tumble(60, 200, 11), 200, seed=4))


def test_uncalibrated_fixed_point_follows_doubles_and_states_the_same(shop):
    found, _, quality = filter_with().feel(shop)
    track, stated = twin_stating(shop, is_known=False)
    assert rms(desk.apart_deg(found, track)) < 0.05
    known = quality["heading_sigma_cdeg"] != NULL
    known[: 5 * 200] = False
    assert known.mean() > 0.8
    for index, name in enumerate(("tilt_sigma_cdeg", "heading_sigma_cdeg")):
        apart = quality[name][known] / 100 - stated[known, index]
        assert np.abs(apart).max() < 0.1


def test_without_calibration_there_is_no_heading_until_the_probe_has_turned(shop):
    found, _, quality = filter_with().feel(shop)
    heading = quality["heading_sigma_cdeg"]
    assert (heading[: 4 * 200] == NULL).all()  # it rests
    assert quality["is_heading_free"][3 * 200 : 4 * 200].all()
    assert (heading[20 * 200 :] < 3000).all()
    true = desk.apart_deg(found, shop.quat)
    assert true[20 * 200 :].max() < 20
    stated = np.hypot(heading, quality["tilt_sigma_cdeg"]) / 100
    assert (true <= 1.96 * stated)[20 * 200 :].mean() > 0.95


def test_a_known_own_field_gives_a_heading_at_rest():
    felt = scene(np.tile(rotation.IDENTITY, (1200, 1)), 200, seed=4)
    known, unknown = (
        each.feel(felt)[2][-1] for each in (filter_with(0, 0, 0), filter_with())
    )
    assert known["heading_sigma_cdeg"] < 300
    assert unknown["heading_sigma_cdeg"] == NULL
    assert known["tilt_sigma_cdeg"] < 120
    assert unknown["tilt_sigma_cdeg"] > 340


def learned(probe: Filter) -> desk.Array:
    """Activates a calibration halfway; returns the orientation then."""
    calibration = desk.ffi.new("struct calibration *", desk.UNKNOWN[0])
    calibration.acc.sigma = calibration.gyr.sigma = 100  # 0.01 m/s2, 0.001
    calibration.mag.sigma = 80  # 0.8 uT
    lib.fuse_set_accuracy(probe.c, calibration)
    q = desk.ffi.new("struct quat *")
    lib.fuse_orientation(probe.c, q)
    return np.array([q.w, q.x, q.y, q.z])


def correlations(pairs: list[int], states: int) -> desk.Array:
    """Of a covariance as the filter keeps it: its lower half, row by row."""
    whole = np.zeros((states, states))
    whole[np.tril_indices(states)] = pairs[: states * (states + 1) // 2]
    whole += np.tril(whole, -1).T
    sigma = np.sqrt(np.maximum(np.diag(whole), 1))
    return whole / np.outer(sigma, sigma)


def test_a_calibration_in_the_midst_has_the_own_field_and_leaves_the_attitude(shop):
    fuse = filter_with()
    before = fuse.feel(shop[:6000])[0][-1]
    own_ut = np.array(list(fuse.c.state.field_ut)[3:]) / desk.FIELD
    assert own_ut == pytest.approx(OWN_UT, abs=2)
    place = list(fuse.c.state.field_ut)[:3]
    bias = fuse.bias_deg_s
    assert learned(fuse).tolist() == list(before)
    assert list(fuse.c.state.field_ut) == [*place, 0, 0, 0]
    assert fuse.bias_deg_s.tolist() == bias.tolist()


def test_a_calibration_in_the_midst_leaves_the_covariance_usable(shop):
    """A scale that is better known than before shares no more than it has."""
    fuse = filter_with()
    fuse.feel(shop[:6000])
    learned(fuse)
    whole = correlations(list(fuse.c.state.motion_covariance), 7)
    assert np.abs(whole - np.diag(np.diag(whole))).max() <= 1
    assert not whole[3:6, [0, 1, 2, 6]].any()
    assert np.linalg.eigvalsh(whole).min() > -1e-3


def test_a_filter_that_goes_on_with_a_calibration_remains_right(shop):
    fuse = filter_with()
    fuse.feel(shop[:6000])
    learned(fuse)
    rest = shop[6000:]
    rest.mag -= np.array(OWN_UT)
    rest.acc -= np.array(LEANS_MG) * MILLI_G
    found, _, quality = fuse.feel(rest)
    assert desk.tilt_deg(found, rest.quat).max() < 3
    assert desk.apart_deg(found, rest.quat).max() < 10
    assert desk.apart_deg(found, rest.quat)[-2000:].max() < 5
    own_ut = np.array(list(fuse.c.state.field_ut)[3:]) / desk.FIELD
    assert np.abs(own_ut).max() < 1.5
    assert (quality["heading_sigma_cdeg"] != NULL).all()


def test_the_covariance_of_an_unknown_field_stays_in_its_range(shop):
    """Through turns, rests and gaps of readings."""
    fuse = filter_with()
    for begun in range(0, len(shop), 2000):
        piece = shop[slice(begun, begun + 2000)]
        piece.has_mag &= np.arange(len(piece)) % 1000 < 700
        fuse.feel(piece)
        variances = [
            fuse.c.state.field_covariance[lib.kalman_variance(i)] for i in range(6)
        ]
        assert min(variances) >= 1
        assert max(variances) <= 460 * UNIT_UT2


def test_an_error_of_the_heading_makes_the_place_unsure_across_its_field():
    """Not along it: a field at 45 degrees of the level frame is the same in both."""
    fuse = centred(200)
    turned = rotation.from_rotation_vector(np.array([0, 0, np.pi / 4]))
    quat = rotation.multiply(np.tile(turned, (4000, 1)), at_rest(20))
    fuse.feel(scene(quat, 200))
    place = list(fuse.c.state.field_ut)[:2]
    assert place == pytest.approx([14.1 * desk.FIELD] * 2, rel=0.02)
    xx, xy, yy = list(fuse.c.state.field_covariance)[:3]
    along, across = (xx + yy) / 2 + xy, (xx + yy) / 2 - xy
    assert across - along > 0.02 * UNIT_UT2
