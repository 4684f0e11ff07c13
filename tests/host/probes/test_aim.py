# SPDX-License-Identifier: MIT
"""How near a probe is to a target: error, its sigma, how long it was held."""

from __future__ import annotations

import json
import math
from typing import Any

import jsonschema
import msgspec
import numpy as np
import pytest

from chain import Chain
from imud import rotation
from imud.client import Pose
from imud.config import reader
from imud.daemon.command_runner import aim_at
from imud.daemon.registry import ProbeEntry
from imud.errors import CommandRefused
from imud.log.schemas import JSON_SCHEMAS
from imud.probes.aim import Aim, Target
from imud.published import SinceOrigin
from imud.recordings.export import columns_of, names_of

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
    # An origin that was set at an unknown time is as wrong as the pose.
    assert sigma(UPRIGHT, "x", flags=("tared",)) == pytest.approx(0.5 * math.sqrt(2.0))
    assert sigma(UPRIGHT, "x", heading_sigma_deg=None) == pytest.approx(0.3)
    assert sigma(LEVEL, "x", heading_sigma_deg=None) is None
    assert sigma(LEVEL, "x", tilt_sigma_deg=None) is None


SINCE = SinceOrigin(0.12, 0.05, 60.0)
LOST = SinceOrigin(None, None, 60.0, "gap")


def test_an_origin_makes_the_errors_since_it_count() -> None:
    aim = Aim(Target(LEVEL, axis="all"))
    measured = aim.measure(pose(LEVEL, flags=("tared",), since_origin=SINCE))
    assert measured["sigma_deg"] == pytest.approx(0.13)
    assert (measured["since"], measured["void"]) == ("origin", None)
    # Its errors are about the world's axes: the heading does not turn what is upright.
    tared = pose(UPRIGHT, flags=("tared",), since_origin=SINCE)
    upright = Aim(Target(UPRIGHT)).measure(tared)
    assert upright["sigma_deg"] == pytest.approx(0.05)
    unknown = SinceOrigin(None, 0.05, 60.0)
    measured = aim.measure(pose(LEVEL, flags=("tared",), since_origin=unknown))
    assert (measured["sigma_deg"], measured["state"]) == (None, "unsure")


def test_an_origin_that_is_void_leaves_the_absolute_errors_of_both_ends() -> None:
    aim = Aim(Target(LEVEL, axis="all"))
    measured = aim.measure(pose(LEVEL, flags=("tared",), since_origin=LOST))
    assert measured["sigma_deg"] == pytest.approx(0.5 * math.sqrt(2.0))
    assert (measured["since"], measured["void"]) == (None, "gap")


def test_a_capture_counts_before_the_origin_and_says_when_it_is_void() -> None:
    aim = Aim(Target(LEVEL, axis="all", capture="00"))
    tared = pose(LEVEL, flags=("tared",), since_origin=SinceOrigin(0.4, 0.3, 99.0))
    measured = aim.measure(tared, SINCE)
    assert measured["sigma_deg"] == pytest.approx(0.13)
    assert (measured["since"], measured["void"]) == ("capture", None)
    measured = aim.measure(tared, LOST)
    assert measured["sigma_deg"] == pytest.approx(0.5)
    assert (measured["since"], measured["void"]) == ("origin", "gap")
    measured = aim.measure(pose(LEVEL), LOST)
    assert measured["sigma_deg"] == pytest.approx(0.5)
    assert (measured["since"], measured["void"]) == (None, "gap")


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
        {"q": "1,0,0,0", "off": "1"},
        {"off": "2"},
    ],
)
def test_a_wrong_target_is_refused(given: dict[str, str]) -> None:
    entry = ProbeEntry("00", reader.load(None), [])
    with pytest.raises(CommandRefused, match="aim needs q"):
        aim_at(entry, given)
    assert entry.aim is None


def heard_until(heard: Any, is_so: Any, chain: Chain, **fields: Any) -> Any:
    """The first record of which that is true, while the probe says such poses."""
    for _ in range(200):
        chain.port.write(chain.probe.say("pose", **fields))
        record = json.loads(heard.get())
        jsonschema.validate(record, JSON_SCHEMAS[record["type"]])
        if is_so(record):
            return record
    raise AssertionError(record)


def test_below_two_degrees_is_reached_from_the_origin_and_not_after_a_restart(
    chain: Chain,
) -> None:
    """The task of the NECTEC paper: set origin, aim at 0/0/0, below 2 degrees."""
    level = {"q": LEVEL, "tilt_sigma": 0.4, "heading_sigma": 1.75}
    tared = level | {"pose_flags": ("tared",)}
    name = chain.probe.name
    aims, poses = chain.hear("aim"), chain.hear("pose")
    with pytest.raises(CommandRefused, match="has sent no pose"):
        chain.client.command(name, "capture")
    with pytest.raises(CommandRefused, match="capture has no parameter q"):
        chain.client.command(name, "capture", q="1,0,0,0")
    chain.client.command(name, "aim", q="1,0,0,0", axis="all", hold_s="0.2")
    record = heard_until(aims, lambda _: True, chain, **level)
    assert (record["state"], record["since"]) == ("unsure", None)

    chain.command("tare")
    record = heard_until(aims, lambda r: r["is_reached"], chain, **tared)
    assert (record["state"], record["since"]) == ("sure", "origin")
    assert record["sigma_deg"] < 0.2
    record = heard_until(poses, lambda r: r["since_origin"], chain, **tared)
    assert record["since_origin"]["void"] is None
    assert record["since_origin"]["heading_sigma_deg"] < 0.2
    typed = msgspec.convert(record, Pose).since_origin
    assert typed == SinceOrigin(**record["since_origin"])
    columns = columns_of("pose", [record])
    row = {n: c for n, (c,) in zip(names_of("pose"), columns, strict=True)}
    for key, value in record["since_origin"].items():
        assert row[f"since_origin_{key}"] == value

    lost = tared | {"pose_flags": ("tared", "starting")}
    record = heard_until(aims, lambda r: r["void"] is not None, chain, **lost)
    assert (record["state"], record["void"]) == ("unsure", "starting")
    chain.command("tare")
    heard_until(aims, lambda r: r["since"] == "origin", chain, **tared)
    chain.command("restart")
    heard_until(aims, lambda r: r["void"] == "restarted", chain, **tared)
    heard_until(poses, lambda r: r["since_origin"] is None, chain, **level)


def test_a_target_is_published_with_each_pose(chain: Chain) -> None:
    heard = chain.hear("aim")
    name = chain.probe.name
    chain.client.command(name, "aim", q="2,0,0,0", axis="z", target="entry")
    chain.port.write(chain.probe.poses(2))
    for _ in range(2):
        record = json.loads(heard.get())
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
