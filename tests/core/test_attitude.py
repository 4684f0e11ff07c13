# SPDX-License-Identifier: MIT
"""The choice of a filter, at run time and when it is built, and what all filters
promise: whatever comes in, a unit quaternion comes out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import native
from core import desk, stroke_desk
from core.desk import ONE, Array, ffi, lib
from core.scenes import (
    MEASUREMENT,
    ORIENTATION,
    QUALITY,
    Attitude,
    Filter,
    scene,
    tumble,
)
from imud.virtual.stroking import Plan
from length import examples

# Of a sensor, as its driver gives them.
IDENTITY = (
    *("kind", "rate_hz", "gyr_delay_us", "mag_lag_us"),
    *("gyr_lsb_nrad_s", "acc_lsb_nm_s2", "mag_lsb_pt"),
)
KINDS = {
    name: getattr(lib, f"FILTER_{name.upper()}")
    for name in ("fuse", "complementary", "mahony", "madgwick", "dcm_pi")
}
PAPERS = [name for name in KINDS if name != "fuse"]

filters = pytest.mark.parametrize("name", KINDS)
of_papers = pytest.mark.parametrize("name", PAPERS)


def direct(
    library: Any, name: str, measurements: Array, intervals_us: Array, bias: list[int]
) -> tuple[Array, Array]:
    """Orientations and qualities by the filter's own functions; a bias half-way."""
    verbs = ("init", "restart", "step", "set_bias", "orientation", "quality")
    init, restart, step, set_bias, orientation, quality = (
        getattr(library[1], f"{name}_{verb}") for verb in verbs
    )
    return by_functions(
        *(library, f"struct {name} *", measurements, intervals_us, bias),
        init=lambda state: init(state, 200, 3900),
        restart=restart,
        step=step,
        set_bias=set_bias,
        orientation=orientation,
        quality=quality,
    )


def dispatched(
    library: Any, name: str, measurements: Array, intervals_us: Array, bias: list[int]
) -> tuple[Array, Array]:
    """The same through attitude.h."""
    c = library[1]
    return by_functions(
        *(library, "struct attitude *", measurements, intervals_us, bias),
        init=lambda state: c.attitude_init(state, KINDS[name], 200, 3900),
        restart=c.attitude_restart,
        step=c.attitude_step,
        set_bias=c.attitude_set_bias,
        orientation=c.attitude_orientation,
        quality=c.attitude_quality,
    )


def by_functions(
    library: Any,
    kind: str,
    measurements: Array,
    intervals_us: Array,
    bias: list[int],
    **call: Any,
) -> tuple[Array, Array]:
    new = library[0].new
    state, one = new(kind), new("struct measurement *")
    quat, quality = new("struct quat *"), new("struct attitude_quality *")
    orientations, qualities = [], []
    call["init"](state)
    for i, row in enumerate(measurements):
        if i == len(measurements) // 3:
            call["set_bias"](state, new("struct vector *", bias))
        if i == len(measurements) // 2:
            call["restart"](state)
        library[0].buffer(one)[:] = row.tobytes()
        call["step"](state, one, int(intervals_us[i]))
        call["orientation"](state, quat)
        call["quality"](state, quality)
        orientations.append([quat.w, quat.x, quat.y, quat.z])
        qualities.append([getattr(quality, field) for field in dir(quality)])
    return np.array(orientations), np.array(qualities)


FELT = scene(tumble(8, 200, 7), 200, seed=2, sway_m_s2=0.5)[600:]
BIAS = [100_000, -200_000, 50_000]


@filters
def test_a_filter_that_is_chosen_gives_what_its_own_functions_give(name):
    given_ = FELT.measurements(), FELT.interval_us, BIAS
    own = direct((ffi, lib), name, *given_)
    through = dispatched((ffi, lib), name, *given_)
    assert np.array_equal(own[0], through[0])
    assert np.array_equal(own[1], through[1])
    looped, _ = Attitude(name).feel(FELT[: len(FELT) // 3])
    assert np.array_equal(own[0][: len(looped)], looped)


def test_filters_differ():
    found = [Attitude(name).feel(FELT)[0] for name in KINDS]
    for i, one in enumerate(found):
        for other in found[:i]:
            assert desk.apart_deg(one, other).max() > 0.1


@filters
def test_the_kind_that_was_chosen_is_told(name):
    assert lib.attitude_kind(Attitude(name).c) == KINDS[name]


@pytest.mark.parametrize("kind", [-(2**31), -1, 0, 6, 257, 2**31 - 1])
def test_no_other_number_is_a_filter(kind):
    assert not lib.attitude_has(kind)
    tracker = ffi.new("struct pose_tracker *")
    assert not lib.pose_begin(tracker, desk.EXACT, desk.identity_of(), kind)
    assert bytes(ffi.buffer(tracker)) == bytes(ffi.sizeof(tracker[0]))


def poses(library: Any, name: str) -> tuple[Array, Array, Array]:
    """Poses of a tracker that finds its bias, and after a long gap starts again; then
    orientations and qualities of its filter alone.
    """
    own, c = library
    # One whose magnetometer's lag is set apart.
    known = desk.identity_of(kind=lib.SENSOR_LSM9DS0, mag_lag_us=1000)
    fields = {field: getattr(known, field) for field in IDENTITY}
    identity = own.new("struct sensor_identity *", fields)
    calibration = own.new("struct calibration *")
    c.calibration_clear(calibration)
    samples = scene(tumble(6, 200, 7), 200, seed=2).samples(known)
    samples["time_us"][1000:] += 300_000
    out = np.zeros(len(samples), desk.dtype_of("struct message_pose"))
    results = np.zeros(len(samples), np.int32)
    tracker = own.new("struct pose_tracker *")
    assert c.pose_begin(tracker, calibration, identity, KINDS[name])
    for other in KINDS.values():
        assert c.pose_begin(tracker, calibration, identity, other) == (
            c.attitude_has(other)
        )
    assert c.pose_begin(tracker, calibration, identity, KINDS[name])
    assert c.loop_kind(own.addressof(tracker.attitude)) == KINDS[name]
    c.loop_pose(
        *(tracker, len(samples)),
        own.cast("struct sample *", own.from_buffer(samples)),
        own.cast("struct message_pose *", own.from_buffer(out)),
        own.cast("int32_t *", own.from_buffer(results)),
    )
    assert c.POSE_CALIBRATED in results
    orientation, quality = (
        np.zeros(len(FELT), ORIENTATION),
        np.zeros(len(FELT), QUALITY),
    )
    # Kept here while they are read.
    felt, intervals_us = FELT.measurements(), FELT.interval_us
    c.loop_attitude(
        *(own.addressof(tracker.attitude), len(FELT)),
        own.cast("struct measurement *", own.from_buffer(felt)),
        own.cast("uint32_t *", own.from_buffer(intervals_us)),
        own.cast("struct quat *", own.from_buffer(orientation)),
        own.cast("struct attitude_quality *", own.from_buffer(quality)),
    )
    return out, orientation, quality


@pytest.mark.sampled(5)
@filters
def test_an_image_of_one_filter_has_no_other_and_gives_the_same_bits(name):
    rooms = ("math", "wire", "fusion")
    library = native.load(
        [
            *(
                path
                for room in rooms
                for path in sorted((native.CORE / room).glob("*.c"))
            ),
            "tests/core/loops.c",
        ],
        ["firmware/core/fusion/pose.h", "tests/core/loops.h"],
        [f"ATTITUDE_ONLY={name}"],
    )
    only = library[1]
    assert [kind for kind in range(-1, 300) if only.attitude_has(kind)] == [KINDS[name]]
    assert KINDS[name] == only.ATTITUDE_DEFAULT
    assert library[0].sizeof("struct attitude") == ffi.sizeof(f"struct {name}")
    for found, wanted in zip(
        poses(library, name), poses((ffi, lib), name), strict=True
    ):
        assert np.array_equal(found, wanted)
    assert np.array_equal(strokes(library, name), strokes((ffi, lib), name))


def strokes(library: Any, name: str) -> Array:
    """What a tracker tells of strokes while the button is held."""
    own, c = library
    fields = {field: getattr(stroke_desk.MPU9250, field) for field in IDENTITY}
    identity = own.new("struct sensor_identity *", fields)
    calibration = own.new("struct calibration *")
    c.calibration_clear(calibration)
    tracker = own.new("struct pose_tracker *")
    assert c.pose_begin(tracker, calibration, identity, KINDS[name])
    tip = own.new("struct pose_tip *", {"offset_um": [1000, 0, 0], "axis": [1, 0, 0]})
    c.pose_set_tip(tracker, tip, True)
    scene = stroke_desk.measured(Plan(seconds=1.0), 1)
    found = np.zeros(len(scene.samples) // stroke_desk.WINDOW + 2, stroke_desk.TOLD)
    after, held = np.zeros(len(found), np.int32), scene.held()
    count = c.loop_strokes(
        *(tracker, len(scene.samples)),
        own.cast("struct sample *", own.from_buffer(scene.samples)),
        own.cast("bool *", own.from_buffer(held)),
        own.cast("struct message_stroke *", own.from_buffer(found)),
        own.cast("int32_t *", own.from_buffer(after)),
    )
    ends = {int(end) for end in found[:count]["end"]} - {c.STROKE_END_RUNNING}
    # The others say to each press that they find none.
    known = c.STROKE_END_BUTTON if name == "fuse" else c.STROKE_END_NO_FILTER
    assert ends == {known}
    return found[:count]


# Whatever comes in.


def edges(random: np.random.Generator, limit: int, shape: tuple[int, ...]) -> Array:
    """Numbers up to a limit: anything, the ends, next to nothing."""
    anything = random.integers(-limit, limit + 1, shape)
    edge = random.choice([-limit, -1, 0, 0, 1, limit], shape)
    return np.where(random.random(shape) < 0.5, anything, edge)


def wild_measurements(random: np.random.Generator, count: int) -> Array:
    """The bounds of calibrate.h, held for up to 200 samples."""
    hold = int(random.choice([1, 1, 5, 50, 200]))
    out = np.zeros(count, MEASUREMENT)
    for name, limit in (
        ("gyr_rad_s_q25", 38 * 2**25),
        ("acc_m_s2_q21", int(470 / 3**0.5 * 2**21)),
        ("mag_ut_q18", 2048 * 2**18),
    ):
        rows = edges(random, limit, (count // hold + 1, 3))
        out[name] = np.repeat(rows, hold, axis=0)[:count]
    # A force of 470 m/s2 along one axis.
    out["acc_m_s2_q21"][random.random(count) < 0.1] = (470 * 2**21 - 1, 0, 0)
    out["has_mag"] = random.random(count) < random.choice([0, 0.5, 1])
    return out


INTERVALS_US = [0, 1, 1250, 5000, 7500, 7501, 50_000, 50_001, 10**6, 2**31, 2**32 - 1]


@pytest.mark.sampled(2)
@settings(max_examples=examples(60), deadline=None)
@given(seed=st.integers(0, 2**32 - 1), is_usual=st.booleans())
@filters
def test_whatever_the_measurements_a_unit_quaternion_comes_out(name, seed, is_usual):
    random = np.random.default_rng(seed)
    probe = Attitude(name, int(random.choice([100, 200, 380, 760])))
    for _ in range(3):
        measurements = wild_measurements(random, 400)
        intervals = np.full(400, 5000) if is_usual else random.choice(INTERVALS_US, 400)
        found, _ = probe.run(measurements, intervals.astype(np.uint32))
        assert np.abs(desk.norms(found) / ONE - 1).max() < 1e-6
        bias = edges(random, 2**31 - 1, (3,)).tolist()
        lib.attitude_set_bias(probe.c, ffi.new("struct vector *", bias))
        if random.random() < 0.2:
            lib.attitude_restart(probe.c)


def test_fuse_itself_is_what_the_other_tests_drive():
    found, _ = Attitude("fuse").feel(FELT)
    wanted, _, _ = Filter(200).feel(FELT)
    assert np.array_equal(found, wanted)
