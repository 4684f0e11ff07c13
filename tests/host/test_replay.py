# SPDX-License-Identifier: MIT
"""_core.Replay of any filter: the same bits as the firmware's own, from the start and
after a restart."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from core import desk
from core.desk import ffi, lib
from core.scenes import scene, tumble
from imud import _core
from protocol import wire

MPU9250 = desk.identity_of()
LSM9DS0 = desk.identity_of(
    kind=lib.SENSOR_LSM9DS0,
    rate_hz=lib.LSM9DS0_RATE_HZ,
    gyr_delay_us=lib.LSM9DS0_GYR_DELAY_US,
    gyr_lsb_nrad_s=1221730,
    acc_lsb_nm_s2=7178468,
    mag_lsb_pt=8000,
)
SAMPLES = scene(tumble(8, 200, 4), 200, seed=4).samples(MPU9250)
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


def poses(kind: int, rows: desk.Array, identity: Any = MPU9250) -> list[bytes]:
    """The contents of the firmware's poses of samples, from a start with them."""
    tracker = ffi.new("struct pose_tracker *")
    assert lib.pose_begin(tracker, desk.UNCALIBRATED, identity, kind)
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
def test_an_lsm9ds0_is_replayed_to_the_last_bit(kind):
    rate_hz = LSM9DS0.rate_hz
    rows = scene(tumble(8, rate_hz, 4), rate_hz, seed=4).samples(LSM9DS0)
    replay = _core.Replay(hello(kind, LSM9DS0))
    assert replayed(replay, rows) == poses(kind, rows, LSM9DS0)


@pytest.mark.parametrize("sensor", [lib.SENSOR_NONE, lib.SENSOR_LSM9DS0 + 1, 255])
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
