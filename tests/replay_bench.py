# SPDX-License-Identifier: MIT
"""Samples for _core.Replay, and the poses that the firmware's own C makes of them."""

from __future__ import annotations

from typing import Any

import numpy as np

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
    mag_lag_us=lib.LSM9DS0_MAG_LAG_US,
    gyr_lsb_nrad_s=1221730,
    acc_lsb_nm_s2=7178468,
    mag_lsb_pt=8000,
)
SAMPLES = scene(tumble(8, 200, 4), 200, seed=4).samples(MPU9250)
LSM6DSOX = desk.identity_of(
    kind=lib.SENSOR_LSM6DSOX,
    rate_hz=lib.LSM6DSOX_RATE_HZ,
    gyr_delay_us=lib.LSM6DSOX_GYR_DELAY_US,
    mag_lag_us=lib.ADAFRUIT_4517_MAG_LAG_US,
    gyr_lsb_nrad_s=1221730,
    acc_lsb_nm_s2=4785645,
    mag_lsb_pt=14616,
)
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
