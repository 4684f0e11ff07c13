# SPDX-License-Identifier: MIT
"""Modules that are mounted in any of 24 ways: found in the first poses of the guide,
told, and taken into account by all that follows.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration.simulated import recorded, samples
from imud.calibration import mounting
from imud.calibration.affine import affine_of
from imud.calibration.algebra import units
from imud.calibration.guided import wave, whole
from imud.calibration.guided.events import Finished, MountFound, Troubled
from imud.calibration.guided.procedure import Procedure
from imud.calibration.guided.result import result_of_fit, result_of_wave
from imud.calibration.guided.wave import Wave, Waving
from imud.calibration.mount import (
    ALL,
    ASSUMED,
    PLAIN,
    ModuleMount,
    MountError,
    named,
    of_matrix,
)
from imud.calibration.mounting import ASKED, MountFinder
from imud.calibration.poses import TWELVE
from imud.calibration.recording import Sample
from imud.calibration.result import CalibrationResult
from imud.calibration.session import CalibrationSession, Subject
from imud.params.value import Params
from imud.refine.learner import Learner, learned_of
from imud.rotation import FloatArray
from imud.virtual.calibrating import RECORDS_HZ, SCALE, Manners, Sampler, pieces
from imud.virtual.modules import shop
from imud.virtual.motions.module import MG, Module

TURNED = named("back,left")  # upside down
pytestmark = pytest.mark.sampled(12)
EVERY = pytest.mark.parametrize("mount", ALL, ids=lambda each: each.name)


def module(mount: ModuleMount, seed: int = 4) -> Module:
    """One from the shop, mounted so: true vectors of the housing to its readings."""
    made = shop(np.random.default_rng([seed, 24]), warm_degc=0.0)
    back = mount.turn.T
    return replace(made, acc=made.acc @ back, gyr=made.gyr @ back, mag=made.mag @ back)


def guided(mount: ModuleMount) -> tuple[Procedure, Finished | None, list[Troubled]]:
    """A hand that obeys the guide."""
    procedure, sampler = Procedure(SCALE, mount=None), Sampler()
    troubles = []
    for piece in pieces("calibrate", module(mount), 1, RECORDS_HZ):
        for sample in sampler.samples(piece):
            for event in procedure.feed(sample):
                if isinstance(event, Finished):
                    return procedure, event, troubles
                troubles += [event] if isinstance(event, Troubled) else []
        if procedure.status().seconds > 90.0:
            break
    return procedure, None, troubles


def left_of(params: Params, of: Module) -> float:
    """How far what the params make of a housing's axes is from them."""
    acc = np.array(params.acc.matrix if params.acc else np.eye(3)) @ of.acc
    gyr = np.array(params.gyr.matrix if params.gyr else np.eye(3)) @ of.gyr
    mag = np.array(params.mag.matrix if params.mag else np.eye(3)) @ of.mag
    mag = mag / np.cbrt(np.linalg.det(mag))
    return float(np.abs(np.stack([acc, gyr, mag]) - np.eye(3)).max())


@EVERY
def test_each_mounting_is_found_by_the_guide(mount: ModuleMount) -> None:
    procedure, done, troubles = guided(mount)
    assert troubles == []
    assert done.mount == mount
    assert procedure.status().mount == mount.told()

    def make(before: Params) -> CalibrationResult:
        return result_of_fit(done.fit, SCALE, before, done.turn)

    found = mounting.through(done.mount, Params(), make)
    assert found.mount == mount.told()
    assert left_of(found.params, module(mount)) < 0.02
    assert mounting.of_calibration(found.params.acc) == mount


@EVERY
def test_a_name_and_a_matrix_are_those_of_the_mounting(mount: ModuleMount) -> None:
    assert named(mount.name) == mount
    random = np.random.default_rng(2)
    matrix = mount.turn @ (np.eye(3) + random.normal(0.0, 0.03, (3, 3)))
    assert of_matrix(matrix) == mount
    sample = Sample(5, (1, 2, 3), (4, 5, 6), (7, 8, 9))
    turned = mount.sample(sample)
    assert turned.acc == tuple(mount.turn @ sample.acc)
    assert turned.mag == tuple(mount.turn @ (7, 8, 9))
    assert mount.sample(replace_mag(sample)).mag is None


def replace_mag(sample: Sample) -> Sample:
    return Sample(sample.t_us, sample.acc, sample.gyr, None)


def test_there_are_24_and_one_of_them_is_plain() -> None:
    assert len({each.name for each in ALL}) == 24
    assert PLAIN.name == "front,left"
    assert PLAIN.words == "the module's axes are those of the housing"
    assert "lies upside down" in TURNED.words
    assert "its x arrow points to the back, its y arrow to the left" in TURNED.words
    assert of_matrix(-np.eye(3)) is None
    half = np.array([[0.7071, -0.7071, 0], [0.7071, 0.7071, 0], [0, 0, 1]])
    assert of_matrix(half) is None
    with pytest.raises(MountError, match="give the directions of the module's x and y"):
        named("front,back")


def stops(mount: ModuleMount, ups: list[tuple[int, int, int]]) -> Iterator[FloatArray]:
    """Mean readings of a module that is off by 0.5 g, laid by a hand."""
    random = np.random.default_rng(1)
    for up in ups:
        way = units(np.array(up, dtype=float) + random.normal(0.0, 0.1, 3))
        yield 9.80665 * mount.turn.T @ way + np.array([418.0, -499.0, 300.0]) * MG


@EVERY
def test_a_die_that_is_off_by_half_a_g_hides_no_mounting(mount: ModuleMount) -> None:
    finder = MountFinder()
    *first, last = [finder.add(force) for force in stops(mount, list(ASKED))]
    assert first == [None] * 4
    assert last == mount


@pytest.mark.parametrize(
    "ups",
    [
        [(0, 0, 1), (0, 0, 1)],
        [(0, 0, 1), (1, 0, 0)],
        [(0, 0, 1), (0, 0, -1), (0, 0, 1)],
        [(0, 0, 1), (0, 0, -1), (1, 0, 0), (1, 0, 0)],
        [(0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, -1, 0)],
    ],
    ids=["twice", "on its back", "flat again", "not over", "on the wrong side"],
)
def test_a_pose_that_was_not_requested_starts_again(
    ups: list[tuple[int, int, int]],
) -> None:
    finder = MountFinder()
    *before, wrong = stops(TURNED, ups)
    for force in before:
        assert finder.add(force) is None
    with pytest.raises(MountError, match="match no possible mounting"):
        finder.add(wrong)
    assert finder.asked == ASKED[0]
    assert [finder.add(f) for f in stops(TURNED, list(ASKED))][-1] == TURNED


def test_the_guide_says_that_it_was_not_laid_as_asked_and_ends_well() -> None:
    """On the wrong side at first, then as it is asked."""
    ups = [np.array(up, dtype=float) for up in (*ASKED[:4], (0, -1, 0), *ASKED)]
    procedure = Procedure(SCALE, mount=None, is_mount_alone=True)
    events = []
    for sample in samples(module(TURNED), 3, ups, Manners(off_rad=0.1)):
        events += procedure.feed(sample)
    (trouble,) = [each for each in events if isinstance(each, Troubled)]
    assert "start again, base down" in str(trouble.fault)
    (found,) = [each for each in events if isinstance(each, MountFound)]
    assert found.mount == TURNED


def test_who_does_not_listen_is_told_what_was_assumed() -> None:
    """In an order of its own, as a hand that has begun before."""
    ups = [pose.up for pose in TWELVE[::-1]]
    procedure = Procedure(SCALE, mount=None, wants_housing=False)
    events = []
    for sample in samples(module(PLAIN), 3, ups):
        events += procedure.feed(sample)
    assert procedure.mount is ASSUMED
    events += procedure.end()
    (done,) = [each for each in events if isinstance(each, Finished)]
    assert "find them with imud calibrate mount" in done.mount.words
    assert len([each for each in events if isinstance(each, Troubled)]) >= 1


def ended_early(count: int) -> tuple[CalibrationSession, list[Sample]]:
    """A session of a user who has laid the probe `count` times; and what is left."""
    day, ups = datetime.date(2026, 11, 27), [np.array(up, dtype=float) for up in ASKED]
    session = CalibrationSession("mount", Subject(SCALE, Params(), True), day)
    left = samples(module(TURNED), 3, ups)
    while session.state()["poses"] < count:
        session.feed(left.pop(0))
    session.end()
    return session, left


@pytest.mark.parametrize("count", [2, 4])
def test_an_early_end_of_a_mounting_asks_for_poses_once(count: int) -> None:
    session, _ = ended_early(count)
    asked = session.state()
    assert asked["phase"] == "running"
    assert "takes five poses" in asked["trouble"]
    session.end()
    assert session.phase == "refused"
    assert "takes five poses" in str(session.state()["why"])


def test_continuing_after_an_early_end_finds_the_mounting() -> None:
    session, left = ended_early(4)
    for sample in left:
        session.feed(sample)
    assert session.phase == "done"
    assert session.state()["outcome"]["mount"]["words"]


def test_a_mounting_alone_keeps_what_is_known() -> None:
    fit = whole.fit(recorded(samples(module(PLAIN), 2)))
    assert fit is not None
    before = result_of_fit(fit, SCALE, Params()).params
    found = mounting.result_of_mount(TURNED, before).params
    for name in mounting.SENSORS:
        old, new = before.calibration(name), found.calibration(name)
        assert np.allclose(new.matrix, TURNED.turn @ old.matrix, atol=1e-3)
        assert (new.bias_counts, new.sigma) == (old.bias_counts, old.sigma)
    assert mounting.mounted(found, PLAIN) == before
    # Of a module that nobody calibrated there is the mounting alone.
    raw = mounting.result_of_mount(TURNED, Params()).params
    assert raw.gyr.sigma is None
    assert np.array_equal(raw.gyr.matrix, TURNED.turn)


def waved(of: Module) -> list[Sample]:
    ups = list(units(np.random.default_rng(3).standard_normal((30, 3))))
    manners = Manners(stop_s=0.02, move_s=1.5, is_held=True, swerve_rad=0.6)
    return samples(of, 3, ups, manners)


def test_a_wave_and_learning_go_on_from_a_mounting() -> None:
    mount = named("top,left")
    fit = whole.fit(
        recorded(map(mount.sample, samples(module(mount), 2))),
    )
    assert fit is not None

    def levelled(before: Params) -> CalibrationResult:
        return result_of_fit(fit, SCALE, before, sensors=("acc", "gyr"))

    params = mounting.through(mount, Params(), levelled).params
    acc = affine_of(params.acc, SCALE.acc_m_s2)
    gyr = affine_of(params.gyr, SCALE.gyr_rad_s)
    waving = Waving(SCALE, acc, gyr, 0.05, mount)
    found = next(filter(None, map(waving.feed, waved(module(mount)))))
    assert isinstance(found, Wave)
    assert wave.weakness(found) is None
    done = mounting.through(
        mount, params, lambda before: result_of_wave(found, SCALE, before)
    )
    assert left_of(done.params, module(mount)) < 0.03
    learner = Learner(SCALE)
    for each in waved(module(mount)):
        learner.add(each)
    proposal = learned_of(learner.begin(params.encode())).proposal
    assert left_of(proposal.params, module(mount)) < 0.03
