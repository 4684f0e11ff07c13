# SPDX-License-Identifier: MIT
"""The messages of a checked board: good, except for a test's changes."""

from __future__ import annotations

from typing import Any

import numpy as np

from imud.check.evidence import Evidence
from imud.check.judge import judged
from imud.check.rows import Row, RowVerdict
from imud.wire import schema

ACC_LSB = 16.0 * 9.80665 / 32768.0
GYR_LSB = np.radians(2000.0 / 32768.0)
MAG_LSB = 0.15
G = 2048  # counts at 16 g full scale

HELLO: dict[str, Any] = {
    "type": "hello",
    "schema_fingerprint": schema.FINGERPRINT,
    "firmware": "0.1.0+abcdef0",
    "board": "nano",
    "probe_id": "0011223344556677",
    "sensor": "mpu9250",
    "who_am_i": (0x71, 0x48),
    "mag_adjust": (176, 177, 166),
    "self_test": ("host_judges",),
    "sample_rate": 200,
    "pose_rate": 100,
    "raw_rate": 200,
    "acc_lsb": ACC_LSB,
    "gyr_lsb": GYR_LSB,
    "mag_lsb": MAG_LSB,
    "boot_count": 7,
    "reset_cause": ("power_on",),
    "filter": "fuse",
    "reset_address": 0,
    "params_digest": 0,
}
F405: dict[str, Any] = {
    "board": "f405",
    "sensor": "lsm9ds0",
    "who_am_i": (0xD4, 0x49),
    "self_test": ("acc_passed", "gyr_passed"),
}
STATUS: dict[str, Any] = {
    "type": "status",
    "uptime": 10,
    "state": "streaming",
    "overruns": 0,
    "bus_faults": 0,
    "bus_recoveries": 0,
    "messages_dropped": 0,
    "receive_lost": 0,
    "supply": 4990,
}
# A healthy MPU-9250 (tests/host/probes/test_self_test.py).
SELF_TEST: dict[str, Any] = {
    "type": "self_test",
    "before": (-12, 340, 16384, 15, -9, 131),
    "stimulated": (6500, 6900, 22800, 8000, -7900, 8150),
    "after": (-11, 338, 16390, 14, -8, 130),
    "factory": (93, 95, 96, 112, 112, 113),
    "mag_response": (40, -60, -1900),
}


def raws(
    seconds: float = 12.0,
    *,
    rate_hz: float = 200.0,
    acc: tuple[float, float, float] = (0.0, 0.0, 1.0),  # g
    gyr: tuple[float, float, float] = (0.4, -0.3, 1.0),  # deg/s
    mag: tuple[float, float, float] | None = (10.0, 20.0, -44.0),  # uT
    acc_noise_mg: float = 5.0,
    gyr_noise_dps: float = 0.07,
    ppm: float | None = None,  # of the device's clock; None: no times of the host
    bound_us: float | None = 500.0,
    **own: Any,
) -> list[dict[str, Any]]:
    """Raw messages of a probe at rest, as imud describes them."""
    random = np.random.default_rng(5)
    count = round(seconds * rate_hz)
    noise = random.standard_normal((count, 9))
    accs = np.array(acc) * G + noise[:, :3] * acc_noise_mg * G / 1000.0
    gyrs = (np.array(gyr) + noise[:, 3:6] * gyr_noise_dps) / np.degrees(GYR_LSB)
    mags = (np.array(mag or (0.0, 0.0, 0.0)) + noise[:, 6:] / 2) / MAG_LSB
    counts = np.rint(np.hstack([accs, gyrs, mags])).astype(int).tolist()
    found = []
    for i, row in enumerate(counts):
        t_us = 1_000_000 + round(i * 1e6 / rate_hz)
        has_mag = mag is not None and i % 2 == 0
        raw: dict[str, Any] = {
            "type": "raw",
            "t_device_us": t_us,
            "acc_counts": tuple(row[:3]),
            "gyr_counts": tuple(row[3:6]),
            "mag_counts": tuple(row[6:]) if has_mag else None,
            "mag_uT": None,
            "temperature_c": 24.0 + 0.01 * (i % 3),
            "flags": (),
        }
        if ppm is not None:
            raw["t_ns"] = round(1e18 + t_us * 1000.0 / (1.0 + ppm * 1e-6))
            raw["t_bound_us"], raw["age_us"] = bound_us, 3000 + i % 7 * 100
        found.append(raw | own)
    return found


def evidence(
    *,
    samples: list[dict[str, Any]] | None = None,
    hello: dict[str, Any] | None = None,
    status: dict[str, Any] | None = None,
    events: tuple[tuple[str, str, int], ...] = (),
    self_test: dict[str, Any] | None = None,
) -> Evidence:
    """The evidence of a board: a good one, except for these fields."""
    found = Evidence()
    found.add_message(HELLO | (hello or {}))
    found.add_message(STATUS)
    if self_test != {}:
        found.add_message(SELF_TEST | (self_test or {}))
    for event, cause, detail in events:
        found.add_message(
            {"type": "event", "event": event, "cause": cause, "detail": detail}
        )
    for item in raws() if samples is None else samples:
        found.add_message(item)
    found.add_message(STATUS | {"uptime": 22} | (status or {}))
    return found


def rows(found: Evidence) -> dict[str, Row]:
    """The table by the names of its rows, which are all different."""
    table = judged(found)
    named = {row.name: row for row in table}
    assert len(named) == len(table)
    return named


def troubles(found: Evidence) -> dict[str, RowVerdict]:
    """The rows that are not good, but for those that were not judged."""
    return {
        name: row.verdict
        for name, row in rows(found).items()
        if row.verdict in (RowVerdict.LOOK, RowVerdict.FAULT)
    }
