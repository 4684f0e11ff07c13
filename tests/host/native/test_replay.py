# SPDX-License-Identifier: MIT
"""_core.Replay and _core.Calibrator of any filter: the bits of the firmware's own, from
the start, after a restart and under params.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core import desk
from core.desk import ffi, lib
from core.probe_bench import callbacks
from core.scenes import scene, tumble
from fakes.records import (
    BIAS_MAX,
    ONE,
    ROW_MAX,
    any_records,
    calibrated_records,
    calibration_record,
    record,
)
from imud import _core
from protocol import wire

MPU9250 = desk.identity_of()
LSM9DS0 = desk.identity_of(
    kind=lib.SENSOR_LSM9DS0,
    rate_hz=lib.LSM9DS0_RATE_HZ,
    gyr_delay_us=lib.LSM9DS0_GYR_DELAY_US,
    mag_lag_us=lib.LSM9DS0_MAG_LAG_US,
    gyr_lsb_nrad_s=1221730,
    acc_lsb_nm_s2=7178468,
    mag_lsb_pt=8000,
)
SAMPLES = scene(tumble(8, 200, 4), 200, seed=4).samples(MPU9250)
PAIR = {"gyr_lsb_nrad_s": 1221730, "acc_lsb_nm_s2": 4785645, "mag_lsb_pt": 14616}
LSM6DSOX = desk.identity_of(
    kind=lib.SENSOR_LSM6DSOX,
    rate_hz=lib.LSM6DSOX_RATE_HZ,
    gyr_delay_us=lib.LSM6DSOX_GYR_DELAY_US,
    mag_lag_us=lib.ADAFRUIT_4517_MAG_LAG_US,
    **PAIR,
)
LSM6DSV16X = desk.identity_of(
    kind=lib.SENSOR_LSM6DSV16X,
    rate_hz=lib.LSM6DSV16X_RATE_HZ,
    gyr_delay_us=lib.LSM6DSV16X_GYR_DELAY_US,
    mag_lag_us=lib.LSM6DSV16X_MAG_LAG_US,
    **PAIR,
)
OTHERS = {"lsm9ds0": LSM9DS0, "lsm6dsox": LSM6DSOX, "lsm6dsv16x": LSM6DSV16X}
KINDS = range(lib.FILTER_FUSE, lib.FILTER_DCM_PI + 1)
NULL = -(2**15)


def hello(kind: int, identity: Any = MPU9250) -> bytes:
    fields: dict[str, Any] = {
        name: "0" * 16 if name == "probe_id" else 0
        for name, _ in wire.field_types("hello")
    }
    fields |= {
        "firmware": "test",
        "who_am_i": [0x71, 0x48],
        "mag_adjust": [0, 0, 0],
        "own_field": [0, 0, 0],
        "sensor": identity.kind,
        "sample_rate": identity.rate_hz,
        "acc_lsb": identity.acc_lsb_nm_s2,
        "gyr_lsb": identity.gyr_lsb_nrad_s,
        "mag_lsb": identity.mag_lsb_pt,
        "filter": kind,
    }
    return wire.encode_message("hello", fields, 0, 0)


def raw(row: Any) -> bytes:
    fields = {
        "acc": row["acc"].tolist(),
        "gyr": row["gyr"].tolist(),
        "mag": row["mag"].tolist() if row["has_mag"] else [NULL] * 3,
        "temperature": 0,
        "sample_flags": 0,
    }
    return wire.encode_message("raw", fields, 0, int(row["time_us"]))


def poses(
    kind: int,
    rows: desk.Array,
    identity: Any = MPU9250,
    calibration: Any = desk.UNKNOWN,
) -> list[bytes]:
    """The contents of the firmware's poses of samples, from a start with them."""
    tracker = ffi.new("struct pose_tracker *")
    assert lib.pose_begin(tracker, calibration, identity, kind)
    return tracked(tracker, rows)


def tracked(tracker: Any, rows: desk.Array) -> list[bytes]:
    """The same of a tracker that has begun."""
    made = np.zeros(len(rows), desk.dtype_of("struct message_pose"))
    results = np.zeros(len(rows), np.int32)
    desk.call(lib.loop_pose, tracker, len(rows), rows, made, results)
    return [
        wire.encode_message(
            "pose", {n: row[n].tolist() for n in made.dtype.names}, 7, 8
        )
        for row in made
    ]


def replayed(replay: _core.Replay, rows: desk.Array) -> list[bytes]:
    found = []
    for row in rows:
        replay.step(raw(row))
        found.append(replay.pose(7, 8))
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_the_hellos_filter_is_replayed_to_the_last_bit(kind):
    assert replayed(_core.Replay(hello(kind)), SAMPLES) == poses(kind, SAMPLES)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("identity", OTHERS.values(), ids=OTHERS)
def test_other_sensors_are_replayed_to_the_last_bit(kind, identity):
    rate_hz = identity.rate_hz
    rows = scene(tumble(8, rate_hz, 4), rate_hz, seed=4).samples(identity)
    replay = _core.Replay(hello(kind, identity))
    assert replayed(replay, rows) == poses(kind, rows, identity)


@pytest.mark.parametrize("sensor", [lib.SENSOR_NONE, lib.SENSOR_LSM6DSV16X + 1, 255])
def test_a_hello_of_no_sensor_is_refused(sensor):
    unknown = desk.identity_of(kind=sensor)
    with pytest.raises(ValueError, match=f"sensor {sensor} is not one that can be"):
        _core.Replay(hello(lib.FILTER_FUSE, unknown))


def test_a_restart_begins_anew_with_the_filter_that_it_names():
    replay = _core.Replay(hello(lib.FILTER_FUSE))
    assert replayed(replay, SAMPLES[:700]) == poses(lib.FILTER_FUSE, SAMPLES[:700])
    for kind in reversed(KINDS):
        replay.restart(kind)
        assert replayed(replay, SAMPLES) == poses(kind, SAMPLES)


@pytest.mark.parametrize("kind", [0, 6, 255])
def test_a_hello_of_no_filter_is_refused(kind):
    with pytest.raises(ValueError, match=f"filter {kind} is not one that can be"):
        _core.Replay(hello(kind))


@pytest.mark.parametrize("kind", [-1, 0, 6, 256 + lib.FILTER_FUSE, 2**32 + 1])
def test_a_restart_of_no_filter_is_refused_and_changes_nothing(kind):
    replay = _core.Replay(hello(lib.FILTER_MAHONY))
    before = replayed(replay, SAMPLES[:100])
    with pytest.raises(ValueError, match=f"filter {kind} is not one that can be"):
        replay.restart(kind)
    after = replayed(replay, SAMPLES[100:200])
    assert before + after == poses(lib.FILTER_MAHONY, SAMPLES[:200])


# Params.


EYE = [ONE, 0, 0, 0, ONE, 0, 0, 0, ONE]
UNKNOWN = 2**16 - 1
IDENTITY = b"".join(
    calibration_record(tag, [0, 0, 0], EYE, UNKNOWN, -(2**15), (-(2**15), 0))
    for tag in (1, 2, 3)
)

# The first half of SHA-256 of the poses of SAMPLES, of the papers' filters from a
# firmware that had no params.
BEFORE = {
    lib.FILTER_FUSE: "d7d7b5555059d478c9b8c8adcd6f8672",
    lib.FILTER_COMPLEMENTARY: "58e82b104c9c41756759332b9ce31ed9",
    lib.FILTER_MAHONY: "5e1828ad5234bc11ce08f24ecb5a2328",
    lib.FILTER_MADGWICK: "092e807a994b11c5df40ae24cc760b65",
    lib.FILTER_DCM_PI: "2df935b848c57d68eac53bbe9f841197",
}

REFUSED = {
    "record 1 of the params is too short": record(1, bytes(29)),
    "record 5 of the params is too short": record(5, b"\0"),
    "record 2 of the params is too short": record(9, b"new") + b"\x02",
    "record 3 of the params is too short": calibration_record(3, [0] * 3, EYE)[:-1],
    "record 5 of the params has a value out of range": record(5, b"\x03\0"),
    "record 1 of the params has a value": calibration_record(
        1, [0, BIAS_MAX + 1, 0], EYE
    ),
    "record 2 of the params has a value": calibration_record(
        2, [0, 0, 0], [ONE, 0, 0, 0, ONE, 0, ROW_MAX - ONE, 1, -ONE]
    ),
    "record 1 of the params is given twice": IDENTITY
    + calibration_record(1, [0, 0, 0], EYE),
    "params of 249 bytes": record(200, bytes(247)),
}


def calibration_of(records: bytes) -> Any:
    """As the firmware reads it."""
    made = callbacks("struct memory", read=lambda _, at: records[at])
    memory = ffi.new("struct memory *", made)
    out, tag = ffi.new("struct params *"), ffi.new("uint8_t *")
    assert lib.params_read(memory, 0, len(records), out, tag) == lib.PARAMS_FINE
    calibration = ffi.new("struct calibration *")
    calibration[0] = out.calibration
    return calibration


@pytest.mark.parametrize("reason", REFUSED)
def test_records_that_the_firmware_refuses_are_refused_with_the_reason(reason):
    replay = _core.Replay(hello(lib.FILTER_FUSE))
    for take in (
        lambda: _core.Replay(hello(lib.FILTER_FUSE), REFUSED[reason]),
        lambda: _core.Calibrator(hello(lib.FILTER_FUSE), REFUSED[reason]),
        lambda: replay.params(REFUSED[reason]),
    ):
        with pytest.raises(ValueError, match=f"^{reason}"):
            take()


@pytest.mark.parametrize("kind", KINDS)
def test_poses_under_params_are_the_firmwares_to_the_last_bit(kind):
    records = calibrated_records(kind)
    own = poses(kind, SAMPLES, calibration=calibration_of(records))
    assert replayed(_core.Replay(hello(kind), params=records), SAMPLES) == own
    assert own != poses(kind, SAMPLES)


@given(seed=st.integers(0, 2**32))
def test_any_params_that_the_firmware_takes_give_its_bits(seed):
    records, rows = any_records(seed), SAMPLES[600:700]
    own = poses(lib.FILTER_FUSE, rows, calibration=calibration_of(records))
    assert replayed(_core.Replay(hello(lib.FILTER_FUSE), records), rows) == own


def test_other_params_are_in_force_from_the_next_restart_on():
    first, second = calibrated_records(1), calibrated_records(2)
    replay = _core.Replay(hello(lib.FILTER_FUSE), first)
    before = replayed(replay, SAMPLES[:600])
    assert replay.params(second)
    before += replayed(replay, SAMPLES[600:700])
    own = poses(lib.FILTER_FUSE, SAMPLES[:700], calibration=calibration_of(first))
    assert before == own
    with pytest.raises(ValueError, match="filter 0"):
        replay.restart(0)
    assert replay.params(second), "a restart that failed puts nothing in force"
    replay.restart(lib.FILTER_MAHONY)
    assert not replay.params(second)
    own = poses(lib.FILTER_MAHONY, SAMPLES, calibration=calibration_of(second))
    assert replayed(replay, SAMPLES) == own


@pytest.mark.parametrize("kind", KINDS)
def test_a_replay_that_goes_on_has_the_firmwares_bits(kind):
    first, second = calibrated_records(1), calibrated_records(2)
    replay = _core.Replay(hello(kind), first)
    made = replayed(replay, SAMPLES[:900])
    assert replay.params(second)
    replay.go_on()
    made += replayed(replay, SAMPLES[900:])
    assert not replay.params(second)
    calibration = calibration_of(first)
    tracker = ffi.new("struct pose_tracker *")
    assert lib.pose_begin(tracker, calibration, MPU9250, kind)
    own = tracked(tracker, SAMPLES[:900])
    calibration[0] = calibration_of(second)[0]
    lib.pose_recalibrate(tracker)
    own += tracked(tracker, SAMPLES[900:])
    assert made == own
    # Neither the one calibration nor a start has these.
    assert made[900:] != poses(kind, SAMPLES, calibration=calibration_of(first))[900:]
    assert made[900:] != poses(kind, SAMPLES[900:], calibration=calibration_of(second))


def test_params_that_calibrate_the_same_are_told_from_those_that_do_not():
    replay = _core.Replay(hello(lib.FILTER_FUSE))
    assert not replay.params(IDENTITY + record(5, b"\x01\x01") + record(77, b"new"))
    assert not replay.params(calibration_record(2, [0, 0, 0], EYE, UNKNOWN))
    without_sigma = calibration_record(2, [0, 0, 0], EYE)[2:32]
    assert not replay.params(record(2, without_sigma))
    assert replay.params(calibration_record(2, [0, 0, 0], EYE))
    assert replay.params(calibration_record(2, [0, 0, 1], EYE))


@pytest.mark.parametrize("kind", KINDS)
def test_identity_params_give_the_poses_of_before_there_were_any(kind):
    made = replayed(_core.Replay(hello(kind), IDENTITY), SAMPLES)
    assert made == replayed(_core.Replay(hello(kind)), SAMPLES)
    assert hashlib.sha256(b"".join(made)).hexdigest()[:32] == BEFORE[kind]


@pytest.mark.parametrize("identity", [MPU9250, LSM9DS0], ids=["mpu9250", "lsm9ds0"])
def test_calibrated_values_are_those_that_the_filter_gets(identity):
    records = calibrated_records(3)
    calibration = calibration_of(records)
    scale = ffi.new("struct calibration_scale *")
    lib.calibration_scale_of(identity, scale)
    calibrator = _core.Calibrator(hello(lib.FILTER_FUSE, identity), records)
    sample = ffi.new("struct sample *")
    out = ffi.new("struct measurement *")
    for row in SAMPLES[::50]:
        ffi.buffer(sample)[:] = row.tobytes()
        lib.calibrate(calibration, scale, sample, out)
        acc, gyr, mag = calibrator.apply(raw(row))
        assert acc == tuple(value / 2**21 for value in out.acc_m_s2_q21.axis)
        assert gyr == tuple(value / 2**25 for value in out.gyr_rad_s_q25.axis)
        field = tuple(value / 2**18 for value in out.mag_ut_q18.axis)
        assert mag == (field if row["has_mag"] else None)


def test_without_params_values_are_counts_times_scales():
    calibrator = _core.Calibrator(hello(lib.FILTER_FUSE))
    (row,) = SAMPLES[700:701]
    row = row.copy()
    row["has_mag"] = True
    acc, gyr, mag = calibrator.apply(raw(row))
    assert mag is not None
    assert acc == pytest.approx(
        row["acc"].astype(float) * MPU9250.acc_lsb_nm_s2 * 1e-9, abs=2e-6
    )
    assert gyr == pytest.approx(
        row["gyr"].astype(float) * MPU9250.gyr_lsb_nrad_s * 1e-9, abs=2e-7
    )
    assert mag == pytest.approx(
        row["mag"].astype(float) * MPU9250.mag_lsb_pt * 1e-6, abs=2e-5
    )


def test_the_ends_of_counts_under_the_ends_of_params_stay_within_their_bounds():
    row = np.zeros(1, SAMPLES.dtype)[0]
    row["has_mag"] = True
    for counts in (-32768, 32767):
        for name in ("acc", "gyr", "mag"):
            row[name] = counts
        for seed in range(20):
            calibrator = _core.Calibrator(hello(lib.FILTER_FUSE), any_records(seed))
            acc, gyr, mag = calibrator.apply(raw(row))
            assert mag is None or max(map(abs, mag)) <= 2048
            assert max(map(abs, acc)) <= 270
            assert max(map(abs, gyr)) <= 38


@pytest.mark.parametrize(
    ("name", "most"),
    [("gyr_lsb_nrad_s", 1230468), ("acc_lsb_nm_s2", 19687500), ("mag_lsb_pt", 157500)],
)
def test_scales_beyond_what_the_firmware_computes_with_are_refused(name, most):
    _core.Calibrator(hello(lib.FILTER_FUSE, desk.identity_of(**{name: most})))
    beyond = hello(lib.FILTER_FUSE, desk.identity_of(**{name: most + 1}))
    for kind in (_core.Calibrator, _core.Replay):
        with pytest.raises(ValueError, match="scales"):
            kind(beyond)


@pytest.mark.parametrize("wrong", [b"", b"\x05", hello(1), bytes(300)])
def test_only_raw_messages_can_be_calibrated(wrong):
    with pytest.raises(ValueError, match="not a raw message"):
        _core.Calibrator(hello(lib.FILTER_FUSE)).apply(wrong)


@pytest.mark.parametrize("wrong", [b"", raw(SAMPLES[0]), bytes(300)])
def test_only_the_hello_of_a_sensor_has_scales(wrong):
    for kind in (_core.Calibrator, _core.Replay):
        with pytest.raises(ValueError, match="not the hello"):
            kind(wrong)
    with pytest.raises(TypeError):
        _core.Calibrator(hello(lib.FILTER_FUSE), "text")
