# SPDX-License-Identifier: MIT
"""A magnetometer that is switched off by the params: the firmware's filter has none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fakes import HELLO
from imud import _core
from imud.params.value import Params
from imud.probes.scales import Scales
from imud.probes.withheld import withheld_of
from imud.virtual import sensors
from imud.wire.messages import decode, encode
from imud.wire.params import is_mag_off
from params_bench import GOOD

SECONDS, RATE_HZ = 20, 200
WITH_MAG = GOOD.replaced(
    "mag",
    {"bias_counts": (1, 2, 3), "matrix": np.eye(3).tolist(), "sigma_uT": 0.4},
)


@pytest.mark.parametrize("params", [Params(), GOOD, WITH_MAG])
def test_its_calibration_is_kept_meanwhile(params: Params) -> None:
    off = params.with_magnetometer(is_on=False)
    assert is_mag_off(off.encode())
    off.check()
    assert off.with_magnetometer(is_on=False) == off
    on = off.with_magnetometer(is_on=True)
    assert {*on.records} == {*params.records}
    assert params.with_magnetometer(is_on=True) == params


def last_pose(params: Params) -> dict[str, Any]:
    moved = sensors.generate(SECONDS, seed=3)
    hello = encode("hello", HELLO | {"sample_rate": RATE_HZ}, 0, 0)
    replay = _core.Replay(hello, params.encode())
    scales = Scales(hello, params.encode())
    for number in range((SECONDS - 1) * RATE_HZ):
        at = round(number / RATE_HZ * moved.rate_hz)
        raw = {"temperature": 25.0, "sample_flags": ()}
        for name in ("acc", "gyr", "mag"):
            counts = np.rint(getattr(moved, name)[at] / HELLO[f"{name}_lsb"])
            raw[name] = tuple(np.clip(counts, -32767, 32767).astype(int).tolist())
        content = encode("raw", raw, number, 1000 + number * 1_000_000 // RATE_HZ)
        replay.step(content)
    assert (scales.measure(content)[2] is None) == is_mag_off(params.encode())
    pose: dict[str, Any] = decode(replay.pose(1, 0)).fields
    return pose


def test_a_filter_without_a_magnetometer_withholds_the_heading() -> None:
    assert "mag_absent" not in last_pose(Params())["pose_flags"]
    pose = last_pose(Params().with_magnetometer(is_on=False))
    assert {"mag_absent", "heading_free"} <= {*pose["pose_flags"]}
    assert pose["heading_sigma"] is None
    assert pose["tilt_sigma"] is not None
    published = {"heading_sigma_deg": None, "tilt_sigma_deg": 0.3}
    flags = {"flags": [*pose["pose_flags"], "mag_off"]}
    assert "switched off" in str(withheld_of(published | flags)["heading"])
