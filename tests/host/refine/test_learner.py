# SPDX-License-Identifier: MIT
"""All three sensors from free motion: the fit, and when it is worth its time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as with_fields

from benchmarks.calibration.simulated import errors, recorded, samples, uneven
from imud.calibration.affine import Affine, affine_of
from imud.calibration.algebra import integrated, units
from imud.calibration.recording import Sample, SensorRecording
from imud.calibration.stops import find_stops
from imud.gravity import GRAVITY_M_S2
from imud.params.learned import filter_can_continue
from imud.params.value import Params
from imud.refine.found import Found, found_by
from imud.refine.learner import (
    BETTER,
    EVERY_S,
    SELDOM_S,
    WINDOW_S,
    Learned,
    Learner,
    Proposal,
    fitted,
    heading_of,
    known_of,
    learned_of,
)
from imud.refine.model import SHOP, Priors
from imud.virtual.calibrating import SCALE, Manners
from raw_probe import lying, module, used

STEP_S = 0.01
SAME = Affine(np.eye(3), np.zeros(3))


def swung(
    seconds: float = 40.0,
    *,
    arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    bias_m_s2: tuple[float, float, float] = (0.2, -0.3, 0.1),
    own_ut: tuple[float, float, float] = (20.0, -15.0, 8.0),
    noise: float = 1.0,
) -> SensorRecording:
    """Fast turns about a pivot that stays, in a field of 48 uT."""
    random = np.random.default_rng(3)
    times_s = np.arange(0.0, seconds, STEP_S)
    phases, hz = random.uniform(0.0, 6.3, (3, 4)), random.uniform(0.1, 0.7, (3, 4))
    waves = np.sin(6.283 * hz[..., None] * times_s + phases[..., None])
    rate = 1.6 * waves.sum(axis=1).T
    rate *= np.minimum(times_s, 1.0)[:, None]
    attitude = integrated(rate, STEP_S)[:-1]
    arm = np.array(arm_m)
    bent = np.cross(np.gradient(rate, STEP_S, axis=0), arm)
    bent += np.cross(rate, np.cross(rate, arm))
    up = np.einsum("tji,j->ti", attitude, [0.0, 0.0, GRAVITY_M_S2])
    mag = np.einsum("tji,j->ti", attitude, [20.0, 0.0, -43.0])
    return SensorRecording(
        STEP_S,
        up + bent + bias_m_s2 + noise * 0.05 * random.standard_normal(up.shape),
        rate + noise * 0.002 * random.standard_normal(up.shape),
        mag + own_ut + noise * 0.5 * random.standard_normal(up.shape),
        np.zeros(len(times_s)),
    )


def found_in(recording: SensorRecording, priors: Priors = SHOP) -> Found:
    window = fitted(recording, np.zeros(3), priors)
    assert window is not None
    return found_by(window)


def test_an_accelerometer_is_told_apart_from_the_arm_that_turns_it() -> None:
    found = found_in(swung(arm_m=(0.2, 0.0, -0.1)))
    off = np.degrees(np.abs(found.acc.bias - [0.2, -0.3, 0.1]) / GRAVITY_M_S2)
    assert off.max() < 2.0 * found.tilt_deg < 2.0
    assert found.mag.bias == pytest.approx([20.0, -15.0, 8.0], abs=0.3)
    assert found.north_ut == pytest.approx(20.0, abs=0.7)
    assert math.hypot(found.north_ut, found.up_ut) == pytest.approx(47.4, abs=1.0)
    assert found.gyr.matrix == pytest.approx(np.eye(3), abs=0.003)


def test_errors_are_as_stated() -> None:
    found = found_in(swung())
    off = np.abs(found.acc.bias - [0.2, -0.3, 0.1]) / GRAVITY_M_S2
    assert np.degrees(off.max()) < 3.0 * found.tilt_deg
    assert 0.03 < found.tilt_deg < 1.0
    assert found.tilt_deg < found.heading_deg < 6.0


def test_what_is_known_before_holds() -> None:
    known = replace(SHOP, acc_bias=0.005, acc_scale=0.0005, acc_cross=0.0005)
    assert np.abs(found_in(swung(), known).acc.bias).max() < 0.1


def test_a_module_in_use_is_calibrated() -> None:
    recording = recorded(used())
    stops = find_stops(recording)
    rest = np.concatenate([recording.gyr[s.start : s.end] for s in stops]).mean(axis=0)
    window = fitted(recording, rest, replace(SHOP, bias=math.radians(0.06)))
    found = found_by(window)
    before = errors(module(), SAME, SAME)
    left = errors(module(), found.acc, found.mag)
    assert left["tilt"] < 0.3 < before["tilt"]
    assert left["heading"] < 1.5 < 20.0 < before["heading"]


@pytest.mark.parametrize(
    "recording",
    [
        swung(10.0),
        replace(swung(), breaks=(500,)),
        replace(swung(), mag=np.full((4000, 3), np.nan)),
        replace(swung(), mag=np.zeros((4000, 3))),
        replace(swung(), acc=np.full((4000, 3), np.inf)),
    ],
    ids=["short", "broken", "no field", "a dead magnetometer", "no numbers"],
)
def test_what_determines_nothing_gives_nothing(recording: SensorRecording) -> None:
    assert fitted(recording, np.zeros(3), SHOP) is None


def worked(learner: Learner, found: tuple[Sample, ...], records: bytes) -> Learned:
    """What comes of the fit after all these samples."""
    is_due = [learner.add(each) for each in found]
    assert any(is_due)
    learned = learned_of(learner.begin(records))
    learner.end(learned)
    return learned


def test_learning_continues_and_its_result_is_no_prior() -> None:
    learner = Learner(SCALE)
    first = worked(learner, used(), b"").proposal
    records = first.params.encode()
    assert filter_can_continue(b"", records)
    assert heading_of(first.params, 20.0) == pytest.approx(first.heading_deg, rel=0.1)
    # No better with the same samples: it would have to be by a tenth.
    work = learner.begin(records)
    assert work.base == b""
    assert learned_of(work).proposal is None
    # The same again, after what was less sure.
    mag = first.params.plain("mag") or {}
    unsure = mag | {"sigma_uT": 1.5 * mag["sigma_uT"] / BETTER}
    worse = first.params.replaced("mag", unsure)
    again = learned_of(learner.begin(worse.encode())).proposal
    assert again.params == first.params


def test_what_another_method_found_is_where_it_begins() -> None:
    learner = Learner(SCALE)
    first = worked(learner, used(), b"").proposal
    acc = (first.params.plain("acc") or {}) | {"method": "guided"}
    half = Params().replaced("acc", acc)
    assert known_of(half).acc_bias == pytest.approx(acc["sigma_m_s2"])
    second = learned_of(learner.begin(half.encode())).proposal
    assert second.params.acc == half.acc
    old, new = (affine_of(p.mag, SCALE.mag_ut) for p in (first.params, second.params))
    assert new.bias == pytest.approx(old.bias, abs=1.0)


def test_a_rest_is_remembered_and_without_one_nothing_is_learned() -> None:
    moving = tuple(each for each in used() if each.t_us > 1_300_000)
    learner = Learner(SCALE)
    stops = find_stops(recorded(moving))
    assert stops  # it rests between turns
    learned = worked(learner, moving, b"")
    assert learned.rest is not None
    rest, learner = learned.rest, Learner(SCALE)
    learner.rest = rest
    for each in moving:
        learner.add(each)
    assert learner.begin(b"").rest == rest


def test_a_loss_and_a_clipped_reading_start_again() -> None:
    first, second, *_ = used()
    for late in (
        with_fields(second, t_us=second.t_us + 200_000),
        with_fields(second, is_clipped=True),
        with_fields(second, t_us=first.t_us - 1),
    ):
        learner = Learner(SCALE)
        learner.add(first)
        learner.add(late)
        assert list(learner.samples) == [late]


def test_fits_become_seldom_without_news() -> None:
    learner = Learner(SCALE)
    found = iter(used(100.0))
    at_s: list[float] = []
    nothing = Learned(None, worked(Learner(SCALE), used(), b"").rest)
    for each in found:
        if learner.add(each):
            at_s.append(each.t_us / 1e6)
            learner.begin(b"")
            learner.end(nothing)
    apart = np.diff(at_s)
    assert EVERY_S <= apart[0] < EVERY_S + 1.0  # a stop, in which nothing turns
    assert 1.5 * apart[0] < apart[-1] <= SELDOM_S


def test_what_lies_is_not_fitted() -> None:
    learner = Learner(SCALE)
    still = lying([np.array([0.0, 0.0, 1.0])], 4)
    for part in range(15):
        for each in still:
            assert not learner.add(with_fields(each, t_us=each.t_us + part * 2_000_000))


def with_magnet(found: tuple[Sample, ...], x_ut: float) -> tuple[Sample, ...]:
    """The same samples with a magnet on the probe."""
    counts = round(x_ut / SCALE.mag_ut)
    return tuple(
        each
        if each.mag is None
        else with_fields(each, mag=(each.mag[0] + counts, *each.mag[1:]))
        for each in found
    )


@pytest.mark.parametrize("since_s", [10.0, 20.0])
def test_a_magnet_put_on_spoils_only_what_was_before(since_s: float) -> None:
    magnet_ut = 30.0
    middle = next(at for at, each in enumerate(used()) if each.t_us > since_s * 1e6)
    found = used()[:middle] + with_magnet(used()[middle:], magnet_ut)
    learner = Learner(SCALE)
    proposal = worked(learner, found, b"").proposal
    # The filter restarts, with the bias that it would have to find, and once only.
    records = proposal.params.encode()
    assert not filter_can_continue(b"", records)
    assert any(proposal.params.gyr.bias_counts)
    assert learner.samples[0].t_us == pytest.approx(since_s * 1e6, abs=3e5)
    own = affine_of(proposal.params.mag, SCALE.mag_ut).bias
    expected = module().mag_bias + np.array([magnet_ut, 0.0, 0.0])
    assert np.abs(own - expected).max() < 3.0 * proposal.sigma_ut


def test_what_fits_without_a_magnet_lets_the_filter_continue() -> None:
    learner = Learner(SCALE)
    proposal = worked(learner, used(80.0), b"").proposal
    assert filter_can_continue(b"", proposal.params.encode())
    samples = learner.samples
    assert samples[-1].t_us - samples[0].t_us == WINDOW_S * 1e6


def test_a_magnet_and_a_strange_matrix_are_refused() -> None:
    found = with_magnet(used(), 300.0)
    assert worked(Learner(SCALE), found, b"").proposal is None
    swapped = tuple(
        with_fields(each, gyr=(each.gyr[1], each.gyr[0], each.gyr[2]))
        for each in used()
    )
    assert worked(Learner(SCALE), swapped, b"").proposal is None


@pytest.mark.parametrize("seed", [1, 2])
def test_an_uneven_room_states_a_larger_error_and_is_no_magnet(seed: int) -> None:
    """25 uT/m, from few attitudes: it looks like soft iron."""
    random = np.random.default_rng([seed, 9])
    ups = np.append(random.normal(0.0, 0.35, (16, 2)), np.ones((16, 1)), axis=1)
    manners = Manners(stop_s=1.0, move_s=1.5, swerve_rad=0.3, place_m=0.15)
    room = uneven(3.75, random)
    found = tuple(samples(module(), seed, list(units(ups)), manners, room))
    learner = Learner(SCALE)
    for each in found:
        learner.add(each)
    window = fitted(recorded(found), np.zeros(3), SHOP)
    assert window is not None
    in_room = found_by(window)
    wrong_deg = errors(module(), in_room.acc, in_room.mag)["heading"]
    assert in_room.heading_deg > 3.0
    assert wrong_deg < 2.0 * in_room.heading_deg
    assert learned_of(learner.begin(b"")).since_us == 0


def test_records_that_cannot_be_read_teach_nothing() -> None:
    assert worked(Learner(SCALE), used(), b"\1").proposal is None


def test_a_proposal_says_what_it_is_worth() -> None:
    proposal = worked(Learner(SCALE), used(), b"").proposal
    assert isinstance(proposal, Proposal)
    assert 0.1 < proposal.tilt_deg < 1.5
    assert proposal.tilt_deg < proposal.heading_deg < 6.0
    assert proposal.params.gyr.sigma is None
    assert np.diag(proposal.params.gyr.matrix) == pytest.approx(np.ones(3))
