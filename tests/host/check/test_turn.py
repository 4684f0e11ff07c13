# SPDX-License-Identifier: MIT
"""`imud check --turn`: a known turn, of modules that are sound and of others."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from benchmarks.calibration import turns
from benchmarks.calibration.turns import OTHER, SOUND
from benchmarks.common.boards import NANO
from benchmarks.common.feed import Feed, sampled
from imud.check import turn
from imud.check.rows import Row, RowVerdict, overall
from imud.check.turn import TurnGuide, TurnSeen
from imud.check.turn_rows import LAID_DEG, rows, timed_out
from imud.params.value import Params
from imud.virtual.modules import calibrated
from imud.virtual.turning import AXES

WANTED_DEG = 30.0
KNOWN = turns.calibrated(calibrated(), 5)


@cache
def feed_of(name: str) -> Feed:
    """A module without errors, turned once."""
    felt = turns.motion_of(calibrated(), 5, AXES[name], WANTED_DEG)
    return sampled(felt, NANO.chip, KNOWN.encode())


@cache
def seen(name: str, params: Params = KNOWN) -> TurnSeen:
    guide = TurnGuide(turns.BOARD_SCALE, params, WANTED_DEG)
    turns.seen_by(guide, feed_of(name))
    assert guide.found is not None
    return guide.found


def table(
    found: TurnSeen, params: Params = KNOWN, wanted_deg: float = WANTED_DEG
) -> dict[str, Row]:
    found_rows = rows(found, turns.BOARD_SCALE, params, wanted_deg, LAID_DEG)
    return {row.name: row for row in found_rows}


@pytest.mark.parametrize("hand", AXES)
@pytest.mark.parametrize("seed", [900, 902])
def test_a_calibrated_module_is_good_and_another_modules_params_are_found(
    seed: int, hand: str
) -> None:
    assert turns.judged((seed, SOUND, hand, WANTED_DEG))["verdict"] == "good"
    assert turns.judged((seed, OTHER, hand, WANTED_DEG))["verdict"] == "fault"


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
    guide = TurnGuide(turns.BOARD_SCALE, KNOWN, WANTED_DEG)
    assert not guide.is_late
    turns.seen_by(guide, feed_of("turn"), round(15.0 * turns.BOARD_SCALE.rate_hz))
    assert guide.has_first
    assert guide.found is None
    assert guide.is_late
    row = timed_out(guide)
    assert overall([row]) is RowVerdict.LOOK
    assert row.advice == "start again: turn it, lay it down and let go"
