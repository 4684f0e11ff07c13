# SPDX-License-Identifier: MIT
"""Why a filter withholds errors: fields, forces and sensors that can't be."""

from __future__ import annotations

import numpy as np
import pytest

from core import desk
from core import hard_ground as ground
from core.desk import ffi, lib
from core.fuse_desk import twin_stating
from core.hard_ground import EARTH_UT, KNOWN, poses_of, times
from core.scenes import Filter
from imud import rotation
from imud.virtual.motions import ways

ELSEWHERE = np.array([0.0, 41.0, -8.0])  # uT: Bangkok


def flags_of(felt, calibration=KNOWN):
    """A filter of these sensors from its start on: what it states, sample by sample."""
    probe = Filter(ground.RATE_HZ, 2500)
    lib.fuse_set_accuracy(probe.c, calibration)
    return probe.feel(felt)[2], probe


def share(flags, begin_s, end_s=None):
    end = None if end_s is None else round(end_s * ground.RATE_HZ)
    return flags[round(begin_s * ground.RATE_HZ) : end].mean()


def moved(field_ut, seed=1, seconds=88.0):
    random = np.random.default_rng([20, seed])
    body = ways.in_hand(random, times(seconds))
    return ground.feeling(body, random, field_ut=field_ut)


@pytest.mark.parametrize(("size", "is_impossible"), [(0.35, 1), (1, 0), (1.7, 1)])
def test_a_field_that_can_not_be_the_earths_gives_no_heading(size, is_impossible):
    quality, _ = flags_of(moved(size * EARTH_UT), desk.EXACT)
    assert share(quality["is_field_impossible"], 12) == is_impossible
    assert not quality["is_field_unlike"].any()


def test_a_field_like_that_of_the_calibration_gives_a_heading():
    for change in (0.9, 1.1):
        quality, _ = flags_of(moved(change * EARTH_UT))
        assert not quality["is_field_unlike"].any()
        assert not quality["is_field_impossible"].any()


def test_another_country_is_stated_once_turning_has_shown_no_own_field():
    """The params are of Berlin: no heading while it lies, and none for ever."""
    quality, probe = flags_of(moved(ELSEWHERE))
    assert share(quality["is_field_unlike"], 3, 8) == 1
    assert share(quality["is_field_unlike"], 60) == 0
    assert share(quality["heading_sigma_cdeg"] == ground.NOT_KNOWN, 60) == 0
    assert probe.c.state.is_own_unknown
    found = poses_of(moved(ELSEWHERE)).since(40)
    assert found.honest_headings > 0.99
    assert found.heading_rms_deg < 5


def test_a_magnet_is_not_taken_for_another_country():
    felt = moved(EARTH_UT)
    felt.mag += [0, 0, 30]
    quality, _ = flags_of(felt)
    assert share(quality["is_field_unlike"], 3, 8) == 1
    assert poses_of(felt).since(15).honest_headings > 0.95


def test_a_room_that_becomes_plain_again_is_learned_anew():
    """Steel for 12 s: afterwards a heading, as soon as the probe was turned about."""
    for seed in (1, 2, 3):
        felt = ground.laid_on_steel(70, seed)
        found = poses_of(felt).since(40)
        assert found.honest_headings > 0.95
        assert np.isnan(found.heading_sigma_deg).mean() < 0.1
        assert found.heading_rms_deg < 4


def test_own_fields_of_the_uncalibrated_have_an_end():
    felt = moved(EARTH_UT)
    felt.mag += [0, 70, 0]
    quality, _ = flags_of(felt, desk.UNKNOWN)
    assert share(quality["is_field_impossible"], 20) > 0.9


def test_forces_that_can_not_be_gravity_give_neither_tilt_nor_heading():
    for size, is_impossible in ((0.3, True), (0.7, False), (1.6, False), (2.2, True)):
        felt = moved(EARTH_UT)
        felt.acc *= size
        quality, _ = flags_of(felt)
        told = quality["is_force_impossible"][ground.RATE_HZ :]
        assert told.all() if is_impossible else not told.any()
        for name in ("tilt_sigma_cdeg", "heading_sigma_cdeg"):
            unknown = quality[name][12 * ground.RATE_HZ :] == ground.NOT_KNOWN
            assert (unknown == is_impossible).all()


def test_an_accelerometer_that_repeats_itself_is_dead_until_it_moves():
    felt = ground.lying(10, 20)
    felt.acc[2000:3000] = felt.acc[2000]
    quality, _ = flags_of(felt)
    told = quality["is_force_impossible"]
    assert not told[:2000].any()
    # 25 looks, every second sample, and the rest of a window.
    assert told[2000 + 80 : 3000].all()
    assert not told[3000 + 40 :].any()


def test_a_magnetometer_that_repeats_itself_is_absent_until_it_moves():
    felt = ground.lying(10, 30)
    felt.mag[2000:3000] = felt.mag[2001]
    quality, _ = flags_of(felt)
    unknown = quality["heading_sigma_cdeg"] == ground.NOT_KNOWN
    assert not unknown[1000:2000].any()
    assert unknown[2000 + 60 : 3000].all()
    assert quality["is_mag_absent"][2000 + 280 : 3000].all()
    assert not unknown[3000 + 500 :].any()
    assert not (quality["tilt_sigma_cdeg"] == ground.NOT_KNOWN)[1000:].any()


def test_the_field_of_the_place_is_known_however_bad_the_magnetometer_is():
    calibration = ffi.new("struct calibration *", KNOWN[0])
    for sigma in (200, 2500, 65535):
        calibration.mag.sigma = sigma
        quality, _ = flags_of(moved(ELSEWHERE)[: 8 * ground.RATE_HZ], calibration)
        assert quality["is_field_unlike"].any()


def test_of_an_own_field_in_doubt_nothing_is_kept():
    felt = moved(EARTH_UT)
    felt.mag += [0, 70, 0]
    _, probe = flags_of(felt, desk.UNKNOWN)
    assert not lib.fuse_read_own(probe.c, ffi.new("struct own_field *"))


@pytest.mark.parametrize("of", ["earth", "elsewhere", "magnet"])
def test_doubles_withhold_the_same(of):
    felt = moved(ELSEWHERE if of == "elsewhere" else EARTH_UT)
    felt.mag += [0, 0, 30 if of == "magnet" else 0]
    quality, _ = flags_of(felt)
    _, stated = twin_stating(felt, known_ut=EARTH_UT[1:])
    mine = quality["heading_sigma_cdeg"] == ground.NOT_KNOWN
    assert np.mean(mine == np.isnan(stated[:, 1])) > 0.99
    both = ~mine & np.isfinite(stated[:, 1])
    apart = quality["heading_sigma_cdeg"][both] / 100 - stated[both, 1]
    assert np.abs(apart).max() < 0.5


def test_a_rotation_of_the_world_changes_no_doubt():
    felt = moved(EARTH_UT)
    turned = felt.mag.copy()
    quality, _ = flags_of(felt)
    felt.mag[:] = rotation.rotate(
        rotation.inverse(felt.quat),
        rotation.rotate(
            rotation.from_rotation_vector(np.array([0, 0, 1.0])),
            rotation.rotate(felt.quat, turned),
        ),
    )
    other, _ = flags_of(felt)
    for name in ("is_field_unlike", "is_field_impossible"):
        assert np.array_equal(quality[name], other[name])
