# SPDX-License-Identifier: MIT
"""The twin that parameters are chosen with, what is taken from it, and how they are
chosen."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import engines
import feed
import numpy as np
import pytest
import scoring
import stated
import tune
import twin
import without
from scoring import Score

from imud.virtual import motion, sensors

RECORDED = ("07", "30", "32")  # fast, beside a magnet, with one on the probe
FOLDED = ("01_made", "03_made", "05_made")  # one of each fold

# Of itself, more than it should be.
SURE = {
    "tilt_floor": 0.05,
    "tilt_drift": 0.05,
    "heading_floor": 0.005,
    "covariance_share": 0.001,
    "level_drift": 0.01,
    "residual_share": 0.001,
}


def save(made: motion.Motion, path: Path, *groups: str) -> Path:
    """A recording that scoring finds the groups of."""
    made.save(path)
    with np.load(path) as archive:
        columns = dict(archive)
    np.savez(path, **columns, groups=np.array(groups))
    return path


def recorded(shared_data: Path, name: str) -> feed.Feed:
    (path,) = scoring.find_trials([shared_data / "broad"], [name])
    return feed.sampled(motion.load(path))


@cache
def hand(seed: int = 5) -> motion.Motion:
    """Turned any way up, after a rest, with nothing left to calibrate."""
    errors = sensors.SensorErrors(gyr_offset_dps=1.0, acc_offset_mg=0.0)
    return sensors.generate(30.0, seed=seed, errors=errors)


@cache
def made_course() -> twin.Course:
    trial = scoring.Trial(Path("01_made.npz"), hand(), ("all_trials", "undisturbed"))
    bias = feed.with_bias(hand(), np.array([2.0, 0.0, -2.0]))
    return twin.course(trial, feed.sampled(hand()), [feed.sampled(bias)])


def assert_same(one: engines.Estimate, other: engines.Estimate) -> None:
    """Within 0.02 degrees, and as sure of it."""
    apart = scoring.errors(one.quats, other.quats).total
    assert np.sqrt(np.mean(apart**2)) < 0.02
    for name in ("tilt_sigma_deg", "heading_sigma_deg"):
        mine, theirs = getattr(one, name), getattr(other, name)
        # They may leave the largest stated error at different poses.
        assert np.mean(np.isnan(mine) != np.isnan(theirs)) < 0.01
        assert np.nanmax(np.abs(mine - theirs)) < 0.05


def test_the_twin_is_within_0_02_degrees_of_the_firmware_on_a_made_motion() -> None:
    made = feed.sampled(hand())
    ours = engines.core(made, "fuse")
    assert_same(twin.estimate(made, twin.defaults()), ours)
    # It would see the calibration a tenth of a second late.
    track = twin.run(made.samples, made.times_s, twin.defaults(), is_calibrated=False)
    other = track.quats[np.asarray(made.pose_after)]
    assert scoring.errors(other, ours.quats).total.max() > 0.02


@pytest.mark.parametrize("name", RECORDED)
def test_the_twin_is_within_0_02_degrees_of_the_firmware_on_a_recording(
    shared_data: Path, name: str
) -> None:
    made = recorded(shared_data, name)
    assert_same(twin.estimate(made, twin.defaults()), engines.core(made, "fuse"))


def test_every_parameter_has_a_name_and_a_place() -> None:
    known = twin.defaults()
    assert known["lag_s"] == 0.005
    assert known["level_drift"] == 6
    assert all(value > 0 for value in known.values())
    drawn = {*tune.ESTIMATE, *stated.TILT, *stated.HEADING}
    taken = {name for part in without.PARTS.values() for name in part}
    assert drawn | taken <= set(twin.NAMES)


def test_a_course_scores_as_the_benchmark_does() -> None:
    made = feed.sampled(hand())
    found = twin.estimate(made, twin.defaults())
    assert found.tilt_sigma_deg is not None
    assert found.heading_sigma_deg is not None
    plain, biased = made_course().score(twin.defaults())
    assert plain == scoring.score_at(found.times_s, found.quats, hand())
    assert biased is not None
    assert biased.heading > plain.heading
    shares = scoring.coverage_at(
        found.times_s,
        found.quats,
        found.tilt_sigma_deg,
        found.heading_sigma_deg,
        hand(),
    )
    assert stated.coverage(made_course(), twin.defaults()) == shares
    vqf = engines.vqf_defaults(made).quats[np.asarray(made.pose_after)]
    assert made_course().vqf[0] == scoring.score_at(found.times_s, vqf, hand())


@pytest.mark.parametrize(
    "part", [part for part in without.PARTS if part != without.WHOLE]
)
def test_each_part_taken_away_changes_the_poses(shared_data: Path, part: str) -> None:
    made = recorded(shared_data, "32")
    whole, less = (
        twin.run(made.samples, made.times_s, twin.defaults() | dict(params)).quats
        for params in ({}, without.PARTS[part])
    )
    assert scoring.errors(less, whole).total.max() > 0.01


def test_begun_in_motion_nothing_has_calibrated_the_gyroscope(tmp_path: Path) -> None:
    path = save(hand(), tmp_path / "01_made.npz", "all_trials")
    course = without.load_in_motion(path)
    plain = feed.sampled(hand())
    first = len(plain.samples) - len(course.samples)
    moving = scoring.counted(plain.times_s, hand())
    assert not moving[first - 500]
    assert moving[first - 300 :].all()
    more = np.degrees(course.samples.gyr - plain.samples.gyr[first:])
    lsb_deg_s = np.degrees(feed.MPU9250.gyr_lsb)
    assert more == pytest.approx(
        np.tile(without.BIAS_DEG_S, (len(more), 1)), abs=lsb_deg_s
    )
    assert course.scored[0] == pytest.approx(600, abs=2)
    assert len(course.scored) == len(course.truth)
    scores = [
        course.score(twin.defaults() | dict(without.PARTS[part]))[0].inclination
        for part in (without.WHOLE, "bias")
    ]
    assert scores[0] < 0.85 * scores[1]


def test_what_is_drawn_is_within_a_factor_of_two_and_the_same_for_a_seed() -> None:
    known = twin.defaults()
    found = stated.draws(("surprise", "own_sd"), 200, 7)
    assert found == stated.draws(("surprise", "own_sd"), 200, 7)
    assert found != stated.draws(("surprise", "own_sd"), 200, 8)
    for name in known:
        factors = np.array([each[name] / known[name] for each in found])
        if name not in ("surprise", "own_sd"):
            assert (factors == 1.0).all()
            continue
        assert 0.5 <= factors.min() < 0.55
        assert 1.8 < factors.max() <= 2.0
        assert np.median(factors) == pytest.approx(1.0, abs=0.15)


def test_stated_errors_are_the_sums_of_their_terms() -> None:
    # The accelerometer's own error is too small for a term of the heading's.
    params = twin.defaults() | SURE | {"level_sd": 0.0}
    terms = stated.Terms.of(made_course(), params)
    shares = stated.coverage(made_course(), params)
    assert 0.02 < shares.tilt < 0.98
    assert 0.02 < shares.heading < 0.98
    assert terms.tilt_inside(params) == pytest.approx(shares.tilt, abs=1e-3)
    assert terms.heading_inside(params) == pytest.approx(shares.heading, abs=1e-3)


def test_what_is_stated_is_chosen_to_hold_95_percent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    random = np.random.default_rng(1)
    drift, across, leaning, residual = random.uniform(0.1, 3.0, (4, 20_000))
    known = twin.defaults()
    # Errors half as large again as the firmware has them.
    tilt = 1.5 * np.hypot(known["tilt_floor"], known["tilt_drift"] * drift)
    heading = 1.5 * np.sqrt(
        known["heading_floor"] ** 2
        + known["covariance_share"] * across**2
        + (known["level_drift"] * leaning) ** 2
        + known["residual_share"] * residual**2
    )
    tilt, heading = random.standard_normal((2, 20_000)) * [tilt, heading]
    terms = stated.Terms(
        np.abs(tilt), np.abs(heading), drift, across, leaning, residual
    )
    monkeypatch.setattr(stated.Terms, "of", lambda *_: terms)
    assert terms.tilt_inside(known) == pytest.approx(0.81, abs=0.01)
    assert terms.heading_inside(known) == pytest.approx(0.81, abs=0.01)
    found = stated.honest([made_course()], known, 100, 1)
    assert terms.tilt_inside(found) == pytest.approx(0.95, abs=0.01)
    assert terms.heading_inside(found) == pytest.approx(0.95, abs=0.01)
    changed = {name for name in known if found[name] != known[name]}
    assert changed == {*stated.TILT, *stated.HEADING}


def named(name: str) -> twin.Course:
    groups = ("all_trials", "undisturbed")
    trial = scoring.Trial(Path(f"{name}.npz"), hand()[:0], groups)
    return twin.replace(made_course(), trial=trial)


def test_a_fold_has_no_say_in_what_is_tried_on_it() -> None:
    courses = [named(name) for name in FOLDED]
    tries = stated.draws(tune.ESTIMATE, 4, 1)

    def pairs(*totals: float) -> list[twin.Pair]:
        scores = [Score(total, total, 1.0) for total in totals]
        return [(score, score) for score in scores]

    # Each is by far the best where it is at home, and the last one nowhere.
    rows = [pairs(0, 5, 5), pairs(5, 0, 5), pairs(5, 5, 0), pairs(3, 3, 3)]
    found = tune.held_out(courses, tries, rows, seed=1)
    assert list(found) == list(scoring.FOLDS)
    for index, entries in enumerate(found.values()):
        assert [each.course.trial.name for each in entries] == [FOLDED[index]]
        best = [
            number
            for number, params in enumerate(tries)
            if all(entries[0].params[name] == params[name] for name in tune.ESTIMATE)
        ]
        assert best != [index]
        assert entries[0].pair == rows[best[0]][index]


def test_ratios_are_of_means_and_cost_in_goals() -> None:
    ours = [(Score(1, 1, 1), Score(2, 2, 2)), (Score(2, 1, 2), Score(4, 2, 2))]
    vqf = [(Score(2, 1, 2), Score(6, 2, 2)), (Score(4, 1, 1), Score(6, 2, 2))]
    found = tune.ratios(ours, vqf)
    assert (found.total, found.inclination, found.biased) == (0.5, 1.0, 0.5)
    assert found.cost == pytest.approx(0.5 / 0.65 + 0.5 / 0.55)


@pytest.mark.nightly
def test_the_tables_of_three_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for seed, name in enumerate(FOLDED):
        path = tmp_path / f"{name}.npz"
        save(sensors.generate(14.0, seed=seed), path, "all_trials", "undisturbed")
    output = tmp_path / "out" / "found.json"
    words = [str(tmp_path), "--jobs", "1", "--output", str(output)]
    assert tune.main([*words, "--tries", "3"]) == 0
    said = capsys.readouterr().out
    assert "fold C" in said
    assert "undisturbed: errors inside 1.96 sigma" in said
    found = json.loads(output.read_text())
    assert set(found["rows"]) == {"chosen", "the firmware's"}
    assert found["rows"]["chosen"]["fold A"]["ratios"]["total"] > 0
    assert found["params"][tune.ALL] == pytest.approx(twin.defaults())
    assert without.main(words) == 0
    said = capsys.readouterr().out
    assert "begun in motion" in said
    found = json.loads(output.read_text())
    assert set(found["scores_deg"]["calibrated"]) == {*without.PARTS, without.VQF}
    assert without.BIASED in found["scores_deg"]["calibrated"]["lead"]


@pytest.mark.parametrize("program", [tune, without])
def test_absent_recordings_are_skipped_with_one_line(
    program: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert program.main([str(tmp_path / "nowhere")]) == 0
    assert capsys.readouterr().out.count("\n") == 1
    with pytest.raises(SystemExit, match="2"):
        program.main([str(tmp_path)])


def test_one_fold_alone_leaves_nothing_to_hold_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = save(hand(), tmp_path / "01_made.npz", "all_trials")
    words = [str(path), "--tries", "1", "--jobs", "1"]
    assert tune.main([*words, "--output", str(tmp_path / "out.json")]) == 2
    assert "one fold" in capsys.readouterr().err
    assert not (tmp_path / "out.json").exists()
