# SPDX-License-Identifier: MIT
"""Public recordings felt by modules from the shop: the filter's true and stated errors,
without any procedure and after a guided one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration import simulated
from benchmarks.common import engines, scoring
from benchmarks.common.core import Replay
from benchmarks.common.engines import HOST, Estimate
from benchmarks.common.feed import NO_READING, Feed, sampled
from benchmarks.common.figure import Figure
from benchmarks.common.paths import RECORDINGS
from benchmarks.common.scoring import SIGMAS, Trial
from imud import rotation
from imud.calibration.affine import Affine
from imud.calibration.guided import housing, whole
from imud.calibration.guided.result import SENSORS, result_of_fit
from imud.calibration.learned.learner import Learner, learned_of
from imud.calibration.poses import BASE_DOWN
from imud.calibration.recording import Sample, Scale
from imud.calibration.result import with_sensor
from imud.params.learned import filter_can_continue
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.virtual.calibrating import SCALE
from imud.virtual.modules import shop
from imud.virtual.motion import Motion
from imud.virtual.motions.module import Module
from imud.virtual.sensors import NO_ERRORS
from imud.wire import messages, schema

# Seconds after the start of movement.
PHASES = {"under 10 s": (0.0, 10.0), "to 30 s": (10.0, 30.0), "later": (30.0, np.inf)}
INSTANTS_S = (30.0, 60.0)
CHANGE_S = 2.0  # a fit and a change of the params, 1.2 to 1.8 s on the virtual boards
LSBS = ("acc_lsb", "gyr_lsb", "mag_lsb", "sample_rate")
AROUND_S = 1.0  # of an instant: the error is the rms over it
SALT = 0x5B0B  # of these modules' seeds


def module_of(trial: Trial, seed: int) -> Module:
    """A module as shops sell it. The recording has its own noise and its own delay."""
    number = int(trial.name[:2])
    module = shop(np.random.default_rng([seed, SALT, number]))
    return replace(module, noise=NO_ERRORS, mag_lag_s=0.0)


def measure(task: tuple[Path, int]) -> dict[str, Any]:
    """One recording with one module: true and stated errors."""
    path, seed = task
    trial = scoring.load_trial(path)
    module = module_of(trial, seed)
    felt = module.measures(trial.motion, np.random.default_rng([seed, 2]))
    feed = sampled(felt, params=b"")
    row: dict[str, Any] = {"trial": trial.name, "seed": seed}
    row["has_rotation"] = "translation" not in trial.name
    row |= errors_of(engines.ENGINES[HOST](feed), trial)
    learned, row["applied_s"] = with_learning(feed)
    row["learned"] = errors_of(learned, trial)
    own = engines.ENGINES[HOST](sampled(trial.motion))
    row["own_total"] = total(own, trial)
    known = guided(module, seed)
    if known is not None:
        found = engines.ENGINES[HOST](sampled(felt, params=known))
        row["guided_total"] = total(found, trial)
        row |= apart(module, trial, felt, known, seed)
        row["own_turned"] = total(turned(own, trial), trial)
        row["guided_turned"] = total(turned(found, trial), trial)
    return row


def with_learning(feed: Feed) -> tuple[Estimate, list[float]]:
    """The poses with a daemon that has `learn = "apply"`, and the times of its changes,
    each after the duration of the fit and of the change.
    """
    hello = messages.decode(feed.hello)
    assert isinstance(hello, messages.Message)
    lsbs = [float(hello.fields[key]) for key in LSBS]  # type: ignore[arg-type]
    learner, records = Learner(Scale(*lsbs)), b""
    coming: tuple[float, bytes] | None = None
    replay = Replay(feed.hello, b"")
    due = dict(zip(feed.pose_after, feed.pose_sequence, strict=True))
    contents, applied_s = [], []
    for index, raw in enumerate(feed.raws):
        now_s = float(feed.times_s[index])
        if coming is not None and now_s >= coming[0]:
            is_anew = not filter_can_continue(records, coming[1])
            records, coming = coming[1], None
            replay.params(records)
            if is_anew:
                replay.restart(schema.Filter.FUSE)
            else:
                replay.go_on()
            applied_s.append(now_s)
        replay.step(raw)
        if index in due:
            time_us = int(feed.rows["time_us"][index])
            contents.append(replay.pose(due[index], time_us))
        if learner.add(sample_of(feed, index)) and coming is None:
            learned = learned_of(learner.begin(records))
            learner.end(learned)
            if learned.proposal is not None:
                coming = now_s + CHANGE_S, learned.proposal.params.encode()
    return engines.poses(feed.pose_times_s, contents), applied_s


def sample_of(feed: Feed, index: int) -> Sample:
    """A raw message as a calibration takes it."""
    row = feed.rows[index]
    acc, gyr, mag = (tuple(map(int, row[name])) for name in ("acc", "gyr", "mag"))
    has_mag = mag[0] != NO_READING
    return Sample(int(row["time_us"]), acc, gyr, mag if has_mag else None)  # type: ignore[arg-type]


def apart(
    module: Module, trial: Trial, felt: Motion, known: bytes, seed: int
) -> dict[str, Any]:
    """The part of the guided total that is not the calibration's: with a module that is
    warm already, and with params that are the module's very errors.
    """
    warm = replace(module, drift=np.zeros(3), acc_drift=np.zeros(3))
    calm = warm.measures(trial.motion, np.random.default_rng([seed, 2]))
    params = Params.decode(known)
    for name in SENSORS:
        values = params.plain(name) or {}
        kept = {key: values[key] for key in values.keys() - {"bias_counts", "matrix"}}
        matrix, bias = getattr(module, name), getattr(module, f"{name}_bias")
        affine = Affine(np.linalg.inv(matrix), bias)
        params = with_sensor(params, name, affine, SCALE, kept)
    exact = params.encode()
    run = engines.ENGINES[HOST]
    return {
        "warm_total": total(run(sampled(calm, params=known)), trial),
        "exact_total": total(run(sampled(felt, params=exact)), trial),
    }


def turned(estimate: Estimate, trial: Trial) -> Estimate:
    """The estimate in the frame of the body that suits the truth best: how the module's
    axes lie against the optical markers is no error of a filter.
    """
    motion = trial.motion
    assert motion.quat is not None
    times_s = np.arange(len(motion)) / motion.rate_hz
    truth = rotation.interpolate(estimate.times_s, times_s, motion.quat)
    is_seen = scoring.counted(estimate.times_s, motion) & np.isfinite(truth).all(axis=1)
    quats = estimate.quats
    for _ in range(3):
        error = rotation.multiply(rotation.inverse(quats), truth)
        mean = rotation.to_rotation_vector(error[is_seen]).mean(axis=0)
        quats = rotation.multiply(quats, rotation.from_rotation_vector(mean))
    return replace(estimate, quats=quats)


def total(estimate: Estimate, trial: Trial) -> float:
    return scoring.score_at(estimate.times_s, estimate.quats, trial.motion).total


def guided(module: Module, seed: int) -> bytes | None:
    """The params that a guided recording of the module gives; None: it gives none. How
    good the gyroscope's are is left out: the recordings have scale errors of their own.
    """
    ups = [*simulated.UPS, BASE_DOWN.up, None]
    recording = simulated.recorded(simulated.samples(module, seed, ups))
    fit = whole.fit(recording)
    if fit is None:
        return None
    params = result_of_fit(fit, SCALE, Params(), housing.found(recording, fit)).params
    gyr = params.plain("gyr") or {}
    return params.replaced("gyr", gyr | {"sigma": None}).encode()


def errors_of(estimate: Estimate, trial: Trial) -> dict[str, Any]:
    """Heading errors at the instants, degrees, and by phase the shares of true errors
    inside the stated 95 %, and of poses without a heading.
    """
    moving = scoring.counted(estimate.times_s, trial.motion)
    since_s = estimate.times_s - estimate.times_s[np.argmax(moving)]
    errors = scoring.errors_at(estimate.times_s, estimate.quats, trial.motion)
    is_seen = moving & np.isfinite(errors.total)
    found: dict[str, Any] = {}
    for instant_s in INSTANTS_S:
        near = is_seen & (np.abs(since_s - instant_s) < AROUND_S)
        if near.any():
            found[f"at {instant_s:g} s"] = _rms(errors.heading[near])
    tilt_sigma, heading_sigma = estimate.tilt_sigma_deg, estimate.heading_sigma_deg
    assert tilt_sigma is not None
    assert heading_sigma is not None
    for name, (begin_s, end_s) in PHASES.items():
        phase = is_seen & (since_s >= begin_s) & (since_s < end_s)
        if phase.any():
            found[name] = {
                "tilt": inside(errors.inclination[phase], tilt_sigma[phase]),
                "heading": inside(errors.heading[phase], heading_sigma[phase]),
                "null": float(np.isnan(heading_sigma[phase]).mean()),
            }
    return found


def inside(errors_deg: FloatArray, sigmas_deg: FloatArray) -> float | None:
    """The share of errors within the stated 95 %; None: none is stated."""
    is_stated = np.isfinite(sigmas_deg)
    if not is_stated.any():
        return None
    return float((errors_deg <= SIGMAS * sigmas_deg)[is_stated].mean())


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def tasks(seeds: Iterable[int]) -> list[tuple[Path, int]]:
    """Each public recording with a module of each seed; none where there are none."""
    paths = scoring.find_trials([RECORDINGS])
    return [(path, seed) for seed in seeds for path in paths if path.exists()]


def _without_procedure(
    rows: Sequence[dict[str, Any]], has_rotation: Sequence[bool], label: str
) -> list[Figure]:
    """Of what told() says of each recording. Only with what a host learns it has to be
    as good as required.
    """
    found = []
    limits = {30.0: ((4, 10), (2, 7)), 60.0: ((2, 6), (1.5, 4))}
    turning = [row for row, turns in zip(rows, has_rotation, strict=True) if turns]
    for instant_s, (must, goal) in limits.items():
        key = f"at {instant_s:g} s"
        errors = [row[key] for row in turning if key in row]
        for share, name, index in ((50, "median", 0), (95, "95th", 1)):
            value = float(np.percentile(errors, share)) if errors else np.nan
            most = must[index] if label == "no procedure" else np.inf
            name = f"{label}, heading {key}, {name}"
            found.append(Figure(name, value, (0, most), (0, goal[index])))
    for name in PHASES:
        for kind in ("tilt", "heading"):
            shares = [row[name][kind] for row in rows if name in row]
            value = 100 * float(np.mean([each for each in shares if each is not None]))
            title = f"{label}, {kind} inside, {name}, %"
            found.append(Figure(title, value, (93.0, 100.0), (95.0, 98.0)))
        null = 100 * float(np.mean([row[name]["null"] for row in rows if name in row]))
        title = f"{label}, no heading, {name}, %"
        found.append(Figure(title, null, (0, 100.0), (0, 100.0)))
    return found


def figures(rows: Sequence[dict[str, Any]]) -> list[Figure]:
    """The required figures."""
    found = []
    for source, label in ((None, "the probe alone"), ("learned", "no procedure")):
        found += _without_procedure(
            [row[source] if source else row for row in rows],
            [row["has_rotation"] for row in rows],
            label,
        )
    both = [row for row in rows if "guided_total" in row]
    if both:
        for name, key, base in (
            ("guided / own calibration", "guided_total", "own_total"),
            ("the same, without constant turn", "guided_turned", "own_turned"),
            ("the same, of a warm module", "warm_total", "own_total"),
            ("exact / own calibration", "exact_total", "own_total"),
        ):
            ratio = np.mean([row[key] for row in both]) / np.mean(
                [row[base] for row in both]
            )
            found.append(Figure(name, ratio, (0, 1.15), (0, 1.0)))
    return found
