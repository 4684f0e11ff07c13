# SPDX-License-Identifier: MIT
"""What the driver of the LSM6DSV16X has other than the LSM6DSOX's; the rest is in
test_drivers.py and test_joined_*.py.
"""

from __future__ import annotations

import math

import pytest

from core.joined_desk import ALL_PASSED, dsv, running
from core.sensor_desk import axes, ffi, lib

ONE_G = round(1 / 0.488e-3)


def test_set_up_leaves_the_chip_as_st_s_driver_would():
    bench = running(dsv)
    control = [bench.inertial.peek(reg) for reg in range(0x0D, 0x1A)]
    # Data-ready of the gyroscope on INT1. CTRL1 to CTRL10: high accuracy, rate 7 of
    # both; whole blocks, addresses that increase; 2000 deg/s; 16 g; no test.
    assert control == [0x02, 0, 0x70, 0x17, 0x17, 0x44, 0, 0, 0x04, 0, 0x03, 0, 0]
    assert bench.inertial.peek(0x62) == 2  # 200 Hz in place of 240
    assert bench.complaint is None
    times = [sample.time_us for sample in bench.samples(21)]
    assert times[-1] - times[0] == pytest.approx(20 * 5000, abs=2)


def test_identity_tells_chips_units_and_verdicts():
    identity = running(dsv).identity
    assert identity.kind == lib.SENSOR_LSM6DSV16X
    assert list(identity.who_am_i) == [0x70, 0x3D]
    assert identity.self_test == ALL_PASSED
    assert identity.rate_hz == 200
    assert identity.gyr_delay_us == 5000
    assert identity.mag_lag_us == pytest.approx(5e5 / 155 + 5e5 / 200, abs=2)
    assert identity.gyr_lsb_nrad_s == round(math.radians(0.070) * 1e9)
    assert identity.acc_lsb_nm_s2 == round(0.488e-3 * 9.80665 * 1e9)
    known = ffi.new("struct sensor_identity *", {"kind": identity.kind})
    assert lib.delays_of_kind(known)
    assert (known.gyr_delay_us, known.mag_lag_us) == (5000, identity.mag_lag_us)


@pytest.mark.parametrize("sa0", [False, True])
@pytest.mark.parametrize(
    ("relative", "who", "kind", "rate_hz"),
    [
        ("lsm6dsv16x", 0x70, lib.SENSOR_LSM6DSV16X, 200),
        ("lsm6dsox", 0x6C, lib.SENSOR_LSM6DSOX, 208),
        ("lsm6dsox", 0x6B, lib.SENSOR_LSM6DSOX, 208),
    ],
)
def test_one_driver_takes_either_family(sa0, relative, who, kind, rate_hz):
    bench = running(dsv, relative=relative, inertial={"who_am_i": who, "sa0": sa0})
    identity = bench.identity
    found = (identity.kind, identity.rate_hz, identity.self_test)
    assert found == (kind, rate_hz, ALL_PASSED)
    assert axes(bench.sample().acc) == (0, 0, ONE_G)
    assert bench.complaint is None
    assert bench.set_up() == lib.SENSOR_OK


@pytest.mark.parametrize("who", [0x69, 0x71, 0x73, 0xFF])
def test_another_kind_is_refused_and_named(who):
    bench = dsv(inertial={"who_am_i": who})
    assert bench.set_up() == lib.SENSOR_WRONG_CHIP
    assert list(bench.identity.who_am_i) == [who, 0]
    assert not [what for _, what, *_ in bench.log if what == "write"]


def test_an_lsm6dsv32x_is_told_by_its_force():
    # It has the same identity, and says 1 g with half of the counts.
    bench = dsv(inertial={"acc_self_test_mg": [210, 195, 255]})
    bench.hold(g=(0, 0, 0.5))
    assert bench.set_up(bound_us=3_000_000) == lib.SENSOR_NO_FORCE
