# SPDX-License-Identifier: MIT
"""How near a probe is to a target: error, its sigma, how long it was held."""

from __future__ import annotations

import json
import math
from typing import Any

import jsonschema
import numpy as np
import pytest

from chain import Chain
from imud import rotation
from imud.config import reader
from imud.daemon.aiming import aim_at
from imud.daemon.registry import ProbeEntry
from imud.errors import CommandRefused
from imud.log.schemas import JSON_SCHEMAS
from imud.probes.aim import Aim, Target

UPRIGHT = tuple(map(float, rotation.from_heading_pitch_roll(0.0, -math.pi / 2, 0.0)))
LEVEL = (1.0, 0.0, 0.0, 0.0)


def turned(q: tuple[float, ...], vector_deg: tuple[float, ...]) -> tuple[float, ...]:
    step = rotation.from_rotation_vector(np.deg2rad(vector_deg))
    return tuple(map(float, rotation.multiply(step, np.array(q))))


def pose(q: tuple[float, ...], at_s: float = 0.0, **fields: Any) -> dict[str, Any]:
    return {
        "number": 1,
        "t_device_us": round(at_s * 1e6),
        "t_ns": None,
        "q": q,
        "tilt_sigma_deg": 0.3,
        "heading_sigma_deg": 0.4,
        "flags": (),
    } | fields


@pytest.mark.parametrize("angle", [0.0, 0.001, 1.5, 90.0, 179.0])
@pytest.mark.parametrize("axis", ["x", "all"])
def test_the_error_is_one_angle_at_any_attitude(angle: float, axis: Any) -> None:
    for start in (LEVEL, UPRIGHT):
        measured = Aim(Target(start, axis=axis)).measure(
            pose(turned(start, (0, angle, 0)))
        )
        assert measured["error_deg"] == pytest.approx(angle, abs=1e-6)


def test_the_sigma_is_that_of_what_turns_the_axis() -> None:
    def sigma(q: tuple[float, ...], axis: Any, **fields: Any) -> Any:
        return Aim(Target(q, axis=axis)).measure(pose(q, **fields))["sigma_deg"]

    assert sigma(LEVEL, "x") == pytest.approx(0.5)
    assert sigma(UPRIGHT, "x") == pytest.approx(0.3)
    assert sigma(UPRIGHT, "all") == pytest.approx(0.5)
    assert sigma(UPRIGHT, "x", flags=("tared",)) == pytest.approx(0.5)
    assert sigma(UPRIGHT, "x", heading_sigma_deg=None) == pytest.approx(0.3)
    assert sigma(LEVEL, "x", heading_sigma_deg=None) is None
    assert sigma(LEVEL, "x", tilt_sigma_deg=None) is None


def test_it_is_reached_only_when_it_was_held_surely() -> None:
    aim = Aim(Target(LEVEL, tolerance_deg=2.0, hold_s=1.0))
    near, unsure = turned(LEVEL, (0, 0.9, 0)), turned(LEVEL, (0, 1.5, 0))
    assert aim.measure(pose(near, 0.0))["state"] == "sure"
    assert aim.measure(pose(unsure, 0.9))["state"] == "unsure"
    assert aim.measure(pose(near, 1.0))["held_s"] == 0.0
    measured = aim.measure(pose(near, 1.99))
    assert not measured["is_reached"]
    assert measured["bound_deg"] == pytest.approx(1.9, abs=1e-3)
    assert aim.measure(pose(near, 2.0))["is_reached"]
    measured = aim.measure(pose(turned(LEVEL, (0, 5, 0)), 2.1))
    assert (measured["state"], measured["bound_deg"], measured["is_reached"]) == (
        "off",
        None,
        True,
    )


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"q": "1,0,0"},
        {"q": "0,0,0,0"},
        {"q": "nan,0,0,1"},
        {"q": "1,0,0,0", "axis": "w"},
        {"q": "1,0,0,0", "hold_s": "inf"},
        {"q": "1,0,0,0", "target": "x" * 61},
        {"q": "1,0,0,0", "what": "1"},
        {"off": "2"},
    ],
)
def test_a_wrong_target_is_refused(given: dict[str, str]) -> None:
    entry = ProbeEntry("00", reader.load(None), [])
    with pytest.raises(CommandRefused, match="aim needs q"):
        aim_at(entry, given)
    assert entry.aim is None


def test_a_target_is_published_with_each_pose(tmp_path: Any) -> None:
    chain = Chain(tmp_path)
    try:
        heard = chain.hear("aim")
        name = chain.probe.name
        chain.client.command(name, "aim", q="2,0,0,0", axis="z", target="entry")
        chain.port.write(chain.probe.poses(2))
        for _ in range(2):
            record = json.loads(heard.get(timeout=30))
            jsonschema.validate(record, JSON_SCHEMAS["aim"])
            assert (record["probe"], record["target"], record["axis"]) == (
                name,
                "entry",
                "z",
            )
        chain.client.command(name, "aim", off="1")
        chain.port.write(chain.probe.poses(2))
        assert chain.client.statuses(name)
        assert heard.empty()
    finally:
        chain.close()
