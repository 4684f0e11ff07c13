# SPDX-License-Identifier: MIT
"""Whatever a sensor reads, whenever, and whatever it is told between: a unit quaternion
comes out of every filter, and what is not known is null. tests/fuzz looks further."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core import desk
from core.desk import ONE, ffi, lib
from core.scenes import SAMPLE
from length import examples

FILTERS = [kind for kind in range(8) if lib.attitude_has(kind)]
NOT_KNOWN = 2**16 - 1
FLAGS = ("has_mag", "mag_overflow", "acc_clipped", "gyr_clipped", "has_gap")
EDGES = np.array([-(2**15), -(2**15) + 1, -1, 0, 1, 2**15 - 1])


def test_the_filter_of_the_house_is_among_them():
    assert lib.FILTER_FUSE in FILTERS
    assert lib.FILTER_NONE not in FILTERS


@pytest.mark.parametrize("kind", FILTERS)
@pytest.mark.parametrize("origin", [0, 1, 2])
def test_before_the_first_sample_there_is_a_unit_quaternion_too(kind, origin):
    tracker = ffi.new("struct pose_tracker *")
    pose = ffi.new("struct message_pose *")
    sample = ffi.new("struct sample *", {"time_us": 77})
    identity = desk.identity_of()
    assert lib.pose_begin(tracker, desk.EXACT, identity, kind)
    for step in range(4):
        lib.pose_read(tracker, pose)
        assert abs(np.linalg.norm(list(pose.q)) / ONE - 1) < 1e-6
        if step == 0:
            lib.pose_set_origin(tracker, origin)
        else:
            lib.pose_step(tracker, sample)


def any_samples(random: np.random.Generator, count: int) -> desk.Array:
    """Counts from everywhere and from the ends, single and held; every flag alone;
    intervals of all magnitudes."""
    out = np.zeros(count, SAMPLE)
    hold = int(random.choice([1, 3, 40, 400]))
    for name in ("gyr", "acc", "mag"):
        shape = (count // hold + 1, 3)
        rows = np.where(
            random.random(shape) < 0.5,
            random.integers(-(2**15), 2**15, shape),
            random.choice(EDGES, shape),
        )
        out[name] = np.repeat(rows, hold, axis=0)[:count]
    for name in FLAGS:
        out[name] = random.random(count) < random.choice([0, 0.02, 0.5, 1])
    out["temperature_cdeg"] = random.integers(-(2**15), 2**15, count)
    usual = np.full(count, 5000)
    any_us = np.floor(2.0 ** random.uniform(0, 32, count)).astype(np.int64) - 1
    steps = np.where(random.random(count) < random.choice([0, 0.01, 1]), any_us, usual)
    out["time_us"] = np.cumsum(steps, dtype=np.int64) % 2**32
    return out


def calibration_of(numbers: list[int]) -> Any:
    """Rows of a matrix and a bias of any shape, up to the longest that are valid."""
    out = ffi.new("struct calibration *")
    lib.calibration_clear(out)
    if numbers:
        random = np.random.default_rng(numbers)
        for part in (out.acc, out.gyr, out.mag):
            longest = random.choice([27852, random.uniform(0, 27852)])
            shares = random.dirichlet([0.5, 0.5, 0.5], 3) * longest
            signed = np.trunc(shares * random.choice([-1, 1], (3, 3))).astype(int)
            part.matrix = signed.tolist()
            bias = random.integers(-(2**28), 2**28 + 1, 3)
            part.bias = random.choice([bias, 2**28 * np.sign(bias)]).tolist()
    assert lib.calibration_is_valid(out)
    return out


@settings(max_examples=examples(200))
@given(
    seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(FILTERS),
    rate_hz=st.integers(100, 800),
    gyr_delay_us=st.integers(0, 7500),
    matrix=st.lists(st.integers(0, 2**16), max_size=1),
    origins=st.lists(st.integers(0, 2), max_size=4),
)
def test_any_input_gives_a_unit_quaternion_and_nulls_where_nothing_is_known(
    seed, kind, rate_hz, gyr_delay_us, matrix, origins
):
    random = np.random.default_rng(seed)
    identity = desk.identity_of(
        rate_hz=rate_hz,
        gyr_delay_us=gyr_delay_us,
        gyr_lsb_nrad_s=int(random.choice([1065264, 1221730])),
        acc_lsb_nm_s2=int(random.choice([4788403, 7178466])),
    )
    calibration = calibration_of(matrix)
    tracker = ffi.new("struct pose_tracker *")
    assert lib.pose_begin(tracker, calibration, identity, kind)
    is_tared = False
    for origin in [None, *origins]:
        if origin is not None:
            lib.pose_set_origin(tracker, origin)
            is_tared = origin != lib.POSE_ORIGIN_NONE
        samples = any_samples(random, 800)
        poses = np.zeros(len(samples), desk.dtype_of("struct message_pose"))
        results = np.zeros(len(samples), np.int32)
        desk.call(lib.loop_pose, tracker, len(samples), samples, poses, results)
        assert np.abs(desk.norms(poses["q"]) / ONE - 1).max() < 1e-6
        flags = poses["pose_flags"]

        def has(flag: int, flags: desk.Array = flags) -> desk.Array:
            return flags & flag != 0

        assert (poses["position"] == -(2**31)).all()
        assert (poses["normal"] == -(2**15)).all()
        is_unknown = poses["tilt_sigma"] == NOT_KNOWN
        assert is_unknown[has(lib.POSE_FORCE_IMPOSSIBLE)].all()
        is_free = (
            has(lib.POSE_STARTING)
            | has(lib.POSE_HEADING_FREE)
            | has(lib.POSE_FIELD_IMPOSSIBLE)
            | has(lib.POSE_FIELD_UNLIKE)
            | has(lib.POSE_FORCE_IMPOSSIBLE)
        )
        assert (poses["heading_sigma"] == NOT_KNOWN)[is_free].all()
        if kind == lib.FILTER_FUSE:
            # A flag gives the reason of each null.
            is_told = has(lib.POSE_STARTING) | has(lib.POSE_FORCE_IMPOSSIBLE)
            assert is_told[is_unknown].all()
            assert np.array_equal(poses["heading_sigma"] == NOT_KNOWN, is_free)
        assert not (has(lib.POSE_MAG_ABSENT) & has(lib.POSE_MAG_DISTURBED)).any()
        clipped = samples["acc_clipped"] | samples["gyr_clipped"]
        assert np.array_equal(has(lib.POSE_CLIPPED), clipped)
        assert np.array_equal(has(lib.POSE_GAP), samples["has_gap"])
        assert (has(lib.POSE_TARED) == is_tared).all()
