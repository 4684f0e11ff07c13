# SPDX-License-Identifier: MIT
"""The filter's detection of rest: rates and forces near their means, in each axis and
in all of them together.
"""

from __future__ import annotations

from itertools import combinations

import pytest

from core.desk import ffi, lib

GRAVITY_Q21 = round(9.80665 * 2**21)
LOOKS = 400


def rests(
    rate_q25: tuple[float, ...], force_q21: tuple[float, ...] = (0, 0, 0)
) -> bool:
    """Whether a sensor that vibrates like this about its mean is at rest."""
    fuse = ffi.new("struct fuse *")
    lib.fuse_init(fuse, 200, 0)
    measured = ffi.new("struct measurement *")
    for look in range(LOOKS):
        sign = 1 if look % 2 else -1
        for axis in range(3):
            measured.gyr_rad_s_q25.axis[axis] = round(sign * rate_q25[axis])
            measured.acc_m_s2_q21.axis[axis] = round(sign * force_q21[axis])
        measured.acc_m_s2_q21.axis[2] += GRAVITY_Q21
        lib.fuse_look_for_rest(fuse, measured)
    return bool(fuse.state.rest_looks > 50)


def limit_of(is_rate: bool, axis: int) -> float:
    """The largest tremor of one axis that is still rest, by bisection."""
    low, high = 0.0, 2.0**24
    while high - low > low / 1000 + 1:
        middle = (low + high) / 2
        vector = tuple(middle if each == axis else 0.0 for each in range(3))
        is_rest = rests(vector) if is_rate else rests((0, 0, 0), vector)
        low, high = (middle, high) if is_rest else (low, middle)
    return low


@pytest.mark.parametrize("is_rate", [True, False], ids=["rate", "force"])
def test_a_tremor_counts_alike_in_each_axis_and_together(is_rate: bool) -> None:
    limits = [limit_of(is_rate, axis) for axis in range(3)]
    assert limits == pytest.approx([limits[0]] * 3, rel=0.01)
    part = limits[0] * 0.8
    for pair in combinations(range(3), 2):
        both = tuple(part if axis in pair else 0.0 for axis in range(3))
        one = tuple(part if axis == pair[0] else 0.0 for axis in range(3))
        if is_rate:
            assert rests(one)
            assert not rests(both)
        else:
            assert rests((0, 0, 0), one)
            assert not rests((0, 0, 0), both)


def test_a_steady_rate_is_no_rest_however_calm() -> None:
    """It is a turn, or a bias that no calibration would leave."""
    fuse = ffi.new("struct fuse *")
    lib.fuse_init(fuse, 200, 0)
    measured = ffi.new("struct measurement *")
    measured.acc_m_s2_q21.axis[2] = GRAVITY_Q21
    measured.gyr_rad_s_q25.axis[1] = round(0.5 * 2**25)
    for _ in range(LOOKS):
        lib.fuse_look_for_rest(fuse, measured)
    assert fuse.state.rest_looks == 0
