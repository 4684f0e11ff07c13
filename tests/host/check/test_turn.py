# SPDX-License-Identifier: MIT
"""`imud check --turn`: a known turn, of modules that are sound and of others."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.calibration import simulated
from benchmarks.common.boards import NANO
from benchmarks.common.engines import ENGINES, HOST
from benchmarks.common.feed import NO_READING, Feed, sampled
from benchmarks.honesty.since_origin import published
from imud.calibration.guided import housing, whole
from imud.calibration.guided.result import result_of_fit
from imud.calibration.poses import BASE_DOWN
from imud.calibration.recording import Sample, Scale
from imud.check import turn
from imud.check.rows import Row, RowVerdict, overall
from imud.check.turn import TurnGuide, TurnSeen
from imud.check.turn_rows import LAID_DEG, rows, timed_out
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.virtual.calibrating import SCALE
from imud.virtual.modules import calibrated, shop
from imud.virtual.motion import Motion, join
from imud.virtual.motions.module import Module
from imud.virtual.sensors import NO_ERRORS, stream
from imud.virtual.turning import AXES, EACH_S, MOVE_S, TurningHand
from length import choose

SALT = 0x7412
RATE_HZ = 400.0
FIRST_S = 20.0  # since power-on: the bias is found, the filter settled
WANTED_DEG = 30.0

CHIP = NANO.chip
BOARD_SCALE = Scale(CHIP.acc_lsb, CHIP.gyr_lsb, CHIP.mag_lsb, CHIP.rate_hz)


def motion_of(module: Module, seed: int, axis: FloatArray, turn_deg: float) -> Motion:
    """One turn, as measured by a module."""
    exact = stream(
        seed,
        RATE_HZ,
        simulated.EARTH,
        NO_ERRORS,
        lambda random, hz: TurningHand(random, hz, axis, turn_deg, FIRST_S),
    )
    sensor = module.sensor(RATE_HZ, np.random.default_rng([seed, SALT, 2]))
    felt: list[Motion] = []
    for piece in exact:
        felt.append(sensor.feel(piece))
        if sum(each.seconds for each in felt) > FIRST_S + MOVE_S + EACH_S:
            break
    return join(felt)


def guided(module: Module, seed: int) -> Params:
    """The params of the guided procedure."""
    ups = [*simulated.UPS, BASE_DOWN.up, None]
    recording = simulated.recorded(simulated.samples(module, seed, ups))
    fit = whole.fit(recording)
    assert fit is not None
    return result_of_fit(fit, SCALE, Params(), housing.found(recording, fit)).params


def seen_by(guide: TurnGuide, feed: Feed, count: int | None = None) -> None:
    """Gives it raw samples, the first `count` of them, and poses in the order in which
    a probe sends them.
    """
    poses = zip(feed.pose_after, published(ENGINES[HOST](feed)), strict=True)
    due = dict(poses)
    table = feed.rows
    for index, t_us in enumerate(table["time_us"].tolist()[:count]):
        mag = table["mag"][index].tolist()
        guide.on_sample(
            Sample(
                t_us,
                tuple(table["acc"][index].tolist()),
                tuple(table["gyr"][index].tolist()),
                None if mag[0] == NO_READING else tuple(mag),
            )
        )
        if index in due:
            guide.on_pose(due[index])


KNOWN = guided(calibrated(), 5)


@cache
def feed_of(name: str) -> Feed:
    """A module without errors, turned once."""
    felt = motion_of(calibrated(), 5, AXES[name], WANTED_DEG)
    return sampled(felt, CHIP, KNOWN.encode())


@cache
def seen(name: str, params: Params = KNOWN) -> TurnSeen:
    guide = TurnGuide(BOARD_SCALE, params, WANTED_DEG)
    seen_by(guide, feed_of(name))
    assert guide.found is not None
    return guide.found


def table(
    found: TurnSeen, params: Params = KNOWN, wanted_deg: float = WANTED_DEG
) -> dict[str, Row]:
    found_rows = rows(found, BOARD_SCALE, params, wanted_deg, LAID_DEG)
    return {row.name: row for row in found_rows}


@pytest.mark.long
@pytest.mark.parametrize("hand", AXES)
@pytest.mark.parametrize("seed", choose(everyday=[900], long=[900, 902]))
def test_a_calibrated_module_is_good_and_another_modules_params_are_found(
    seed: int, hand: str
) -> None:
    random = np.random.default_rng([seed, SALT])
    module = shop(random)
    params = guided(module, seed)
    for felt_by, verdict in (
        (module, RowVerdict.GOOD),
        (shop(random), RowVerdict.FAULT),
    ):
        felt = motion_of(felt_by, seed, AXES[hand], WANTED_DEG)
        guide = TurnGuide(BOARD_SCALE, params, WANTED_DEG)
        seen_by(guide, sampled(felt, CHIP, params.encode()))
        assert guide.found is not None
        assert overall([*table(guide.found, params).values()]) is verdict


@pytest.mark.parametrize("hand", AXES)
def test_a_turn_by_another_angle_is_told_as_one(hand: str) -> None:
    found = table(seen(hand), wanted_deg=45.0)
    turned = [row for name, row in found.items() if name.startswith("turn")]
    assert {row.verdict for row in turned} == {RowVerdict.FAULT}
    assert {row.advice.split(" degrees")[1] for row in turned} == {
        ": was it laid against the stops?"
    }
    assert found["gravity"].verdict is RowVerdict.GOOD


def test_what_is_not_calibrated_is_not_judged() -> None:
    found = table(seen("turn", Params()), Params())
    assert {row.verdict for row in found.values()} == {RowVerdict.LOOK}
    assert all("imud calibrate" in row.advice for row in found.values())


def test_lost_samples_leave_the_gyroscope_out() -> None:
    whole = seen("turn")
    steps_s = whole.steps_s.copy()
    steps_s[len(steps_s) // 2] *= 5.0
    row = table(replace(whole, steps_s=steps_s))["turn by the gyroscope"]
    assert (row.verdict, row.advice) == (
        RowVerdict.LOOK,
        "samples were lost: repeat the turn",
    )


@pytest.mark.parametrize(
    ("hand", "verdict"), [("turn", RowVerdict.LOOK), ("wedge", RowVerdict.GOOD)]
)
def test_gravity_alone_sees_only_turns_about_a_level_axis(
    hand: str, verdict: RowVerdict
) -> None:
    whole = seen(hand)
    first, second = whole.rests
    without = replace(
        whole, rests=(replace(first, mag=None), replace(second, mag=None))
    )
    row = table(without)["turn by gravity"]
    assert row.verdict is verdict
    assert ("only turns about a level axis" in row.advice) is (hand == "turn")


def test_a_probe_that_is_not_turned_ends_the_guide(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(turn, "TIMEOUT_S", 5.0)
    guide = TurnGuide(BOARD_SCALE, KNOWN, WANTED_DEG)
    assert not guide.is_late
    seen_by(guide, feed_of("turn"), round(15.0 * BOARD_SCALE.rate_hz))
    assert guide.has_first
    assert guide.found is None
    assert guide.is_late
    row = timed_out(guide)
    assert overall([row]) is RowVerdict.LOOK
    assert row.advice == "start again: turn it, lay it down and let go"
