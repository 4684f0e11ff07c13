# SPDX-License-Identifier: MIT
"""The guided procedure as a state machine, fed by hands that obey it and by others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache

import msgspec
import numpy as np
import pytest

from benchmarks.calibration.simulated import UPS, fit_errors, housing_error, samples
from imud.calibration.guided.events import (
    Event,
    Finished,
    FitRefused,
    PoseTaken,
    Troubled,
)
from imud.calibration.guided.procedure import Procedure
from imud.calibration.guided.result import housing_of, result_of_fit
from imud.calibration.recording import COUNT_MAX, Sample
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.virtual.calibrating import SCALE, Follower, Manners, Sampler, pieces
from imud.virtual.modules import NOISE, shop
from imud.virtual.motions.module import Module

HAND_HZ = 500.0  # whose noise is as white as that of the module


@cache
def twelve() -> tuple[Sample, ...]:
    """The twelve poses of the module."""
    return tuple(samples(module(), 6))


@cache
def module(seed: int = 1) -> Module:
    return shop(np.random.default_rng([seed, 78]), warm_degc=0.0)


def fed(procedure: Procedure, found: Iterable[Sample]) -> list[Event]:
    return [event for each in found for event in procedure.feed(each)]


def kinds(events: list[Event]) -> list[str]:
    return [e.fault.kind for e in events if isinstance(e, Troubled | FitRefused)]


def obeyed(
    name: str = "calibrate", seed: int = 1, seconds: float = 75.0
) -> list[Event]:
    """What comes of a hand that follows a procedure of its own."""
    procedure, sampler = Procedure(SCALE), Sampler()
    events: list[Event] = []
    for piece in pieces(name, module(seed), seed, 500.0):
        events += fed(procedure, sampler.samples(piece))
        if procedure.is_over or procedure.status().seconds > seconds:
            break
    return events


def test_a_hand_that_obeys_is_done_within_a_minute_with_its_housing() -> None:
    seed = 1
    events = obeyed(seed=seed)
    done = events[-1]
    assert isinstance(done, Finished)
    assert done.turn is not None
    assert fit_errors(module(seed), done.fit)["tilt"] < 0.08
    leaning = housing_error(module(seed), done.fit, np.eye(3))
    assert housing_error(module(seed), done.fit, done.turn) < 0.1 < leaning
    assert done.fit.stops[-1].end * done.fit.step_s < 60.0
    poses = [event.count for event in events if isinstance(event, PoseTaken)]
    assert poses == list(range(1, 13))


def test_scores_fall_and_words_and_sure_params_follow() -> None:
    procedure = Procedure(SCALE, wants_housing=False)
    assert procedure.status().instruction == "Lay it base down and let go."
    instructions, tilts, events = [], [], list[Event]()
    for each in twelve():
        if found := procedure.feed(each):
            events += found
            status = procedure.status()
            instructions.append(status.instruction)
            if status.tilt_deg is not None:
                tilts.append(status.tilt_deg)
    assert instructions[0].startswith("Good (1 of 12). Now lay it ")
    assert instructions[-1] == "Done."
    assert tilts[0] > 0.5
    assert tilts[-1] < 0.1
    assert procedure.is_over
    assert procedure.feed(Sample(10**9, (0, 0, 0), (0, 0, 0))) == []
    done = events[-1]
    assert isinstance(done, Finished)
    params = result_of_fit(done.fit, SCALE, Params()).params
    assert params.faults() == []
    assert 0.002 < (params.acc.sigma or 0.0) < 0.02
    assert 0.0001 <= (params.gyr.sigma or 0.0) < 0.002
    assert 0.01 < (params.mag.sigma or 0.0) < 0.3
    assert params.mag.norm_ut == pytest.approx(48.0, rel=0.1)
    assert params.mag.method == "guided"
    only = result_of_fit(done.fit, SCALE, Params(), sensors=("gyr",)).params
    assert only.acc is None
    assert only.gyr == params.gyr
    made = NOISE.noise(HAND_HZ)[:, 0] * math.sqrt(2.0 / HAND_HZ)
    gyr = {"gyr_rad_s_rthz": pytest.approx(made[0], rel=0.1)}
    assert params.plain("noise") == gyr | {
        "acc_m_s2_rthz": pytest.approx(made[1], rel=0.1)
    }
    assert only.plain("noise") == gyr | {"acc_m_s2_rthz": None}
    # Noise of samples that are missing is folded into those that are there.
    sparse = msgspec.structs.replace(SCALE, is_sparse=True)
    assert result_of_fit(done.fit, sparse, Params()).params.plain("noise") is None


def test_moving_too_early_is_reported() -> None:
    short = samples(module(), 2, UPS, Manners(stop_s=1.2))
    procedure = Procedure(SCALE)
    assert set(kinds(fed(procedure, short))) == {"moved"}
    status = procedure.status()
    assert status.poses == 0
    assert "lay it down" in (status.trouble or "")


def test_a_pose_that_was_there_before_does_not_count_twice() -> None:
    twice = samples(module(), 3, [UPS[0], UPS[0], UPS[1]])
    procedure = Procedure(SCALE)
    events = fed(procedure, twice)
    assert [e.is_new for e in events if isinstance(e, PoseTaken)] == [True, False, True]
    assert procedure.status().poses == 2


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "kind"), [("lazy", "missing_poses"), ("air", "too_few")]
)
def test_who_does_not_listen_is_refused_with_a_cure(name: str, kind: str) -> None:
    procedure, sampler = Procedure(SCALE), Sampler()
    for piece in pieces(name, module(), 4, 500.0):
        fed(procedure, sampler.samples(piece))
        if procedure.is_over or procedure.status().seconds > 60.0:
            break
    (asked,) = procedure.end()
    assert isinstance(asked, Troubled)
    assert asked.fault.kind == kind
    assert not procedure.is_over
    (refused,) = procedure.end()
    assert isinstance(refused, FitRefused)
    assert refused.fault == asked.fault
    assert refused.fault.cure


def test_who_had_enough_too_early_is_told_which_poses_are_missing_and_ends_well() -> (
    None
):
    """Five poses are too few; the guide asks, and who goes on is calibrated."""
    procedure, recorded = Procedure(SCALE, wants_housing=False), samples(module(), 12)
    told, rest = [], list(recorded)
    while len(procedure.ups) < 5 and rest:
        told += procedure.feed(rest.pop(0))
    told += procedure.end()
    assert isinstance(told[-1], Troubled)
    assert procedure.status().trouble is not None
    told += fed(procedure, rest)
    assert isinstance(told[-1], Finished)


@pytest.mark.nightly
def test_iron_beside_the_table_is_named() -> None:
    events = obeyed("iron", 5, 120.0)
    assert "uneven_field" in kinds(events)
    assert not isinstance(events[-1], Finished)


def changed(
    found: Iterable[Sample], acc: FloatArray, gyr: FloatArray, mag: FloatArray
) -> Iterator[Sample]:
    """Samples with their axes mixed by matrices of whole numbers."""

    def mixed(matrix: FloatArray, counts: tuple[int, int, int]) -> tuple[int, int, int]:
        x, y, z = (matrix @ np.array(counts)).astype(int).tolist()
        return x, y, z

    for s in found:
        own = mixed(mag, s.mag) if s.mag is not None else None
        yield Sample(s.t_us, mixed(acc, s.acc), mixed(gyr, s.gyr), own)


SAME = np.eye(3, dtype=int)
DEAD = np.diag([1, 0, 1])
SWAPPED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])


@pytest.mark.parametrize(
    ("matrices", "kind", "words"),
    [
        ((DEAD, SAME, SAME), "dead_axis", "accelerometer's y"),
        ((SAME, DEAD, SAME), "dead_axis", "gyroscope's y"),
        ((SAME, SAME, DEAD), "dead_axis", "magnetometer's y"),
        ((SAME, SWAPPED, SAME), "swapped_axes", "y, x, -z"),
        ((SAME, SAME, SWAPPED), "swapped_axes", "magnetometer's axes"),
    ],
)
def test_a_broken_module_is_refused_with_its_fault(
    matrices: tuple[FloatArray, FloatArray, FloatArray], kind: str, words: str
) -> None:
    procedure = Procedure(SCALE)
    events = fed(procedure, changed(twelve(), *matrices))
    refused = events[-1]
    assert isinstance(refused, FitRefused)
    assert refused.fault.kind == kind
    assert words in refused.fault.reason


def test_a_saturated_axis_is_a_dead_one() -> None:
    def stuck(found: Iterable[Sample]) -> Iterator[Sample]:
        for s in found:
            yield Sample(s.t_us, (COUNT_MAX, s.acc[1], s.acc[2]), s.gyr, s.mag)

    events = fed(Procedure(SCALE), stuck(twelve()))
    assert isinstance(events[-1], FitRefused)
    assert "the accelerometer's x axis" in events[-1].fault.reason


def test_a_magnet_on_the_probe_is_refused() -> None:
    own = replace(module(), mag_bias=np.array([300.0, 0.0, 100.0]))
    procedure = Procedure(SCALE)
    events = fed(procedure, samples(own, 7)) + procedure.end()
    assert "magnet" in kinds(events)
    assert isinstance(events[-1], FitRefused)


def test_the_housing_needs_base_down_and_half_a_turn() -> None:
    procedure = Procedure(SCALE)
    # After the twelve it lies on its front, then base down, is turned by little only,
    # and at last by half a turn.
    ups: list[FloatArray | None] = [*UPS, UPS[3], UPS[0], None]
    events = fed(procedure, samples(module(), 8, ups))
    assert "not_base_down" in kinds(events)
    done = events[-1]
    assert isinstance(done, Finished)
    found = result_of_fit(done.fit, SCALE, Params(), done.turn)
    assert found.housing_deg is not None
    assert done.turn is not None
    assert np.allclose(housing_of(found.params.acc), done.turn, atol=1e-3)
    # A later calibration without the housing's two poses keeps that turn.
    again = result_of_fit(done.fit, SCALE, found.params)
    assert again.housing_deg is None
    assert np.allclose(again.params.acc.matrix, found.params.acc.matrix, atol=2e-4)


def test_a_follower_begins_again_when_it_is_done() -> None:
    follower = Follower(Procedure(SCALE))
    ups = follower.ups()
    assert next(ups) == pytest.approx([0.0, 0.0, 1.0])
    follower.procedure.phase = "done"
    assert next(ups) is not None
    assert follower.procedure.phase == "poses"
