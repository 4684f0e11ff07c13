# SPDX-License-Identifier: MIT
"""Public recordings felt by modules from the shop: the filter's true and stated errors,
without any procedure and after a guided one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.calibration import simulated
from benchmarks.common import engines, scoring
from benchmarks.common.core import Replay
from benchmarks.common.engines import HOST, Estimate
from benchmarks.common.feed import NO_READING, Feed, sampled
from benchmarks.common.paths import RECORDINGS
from benchmarks.common.scoring import SIGMAS, Trial
from benchmarks.harness import Figure, Report, ratio
from imud.calibration.guided import housing, whole
from imud.calibration.guided.result import result_of_fit
from imud.calibration.poses import BASE_DOWN
from imud.calibration.recording import Sample, Scale
from imud.params.learned import filter_can_continue
from imud.params.value import Params
from imud.refine.learner import Learner, learned_of
from imud.rotation import FloatArray
from imud.virtual.calibrating import SCALE
from imud.virtual.modules import shop
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
ALONE, LEARNED = "the probe alone", "no procedure"

Row = dict[str, Any]


def module_of(trial: Trial, seed: int) -> Module:
    """A module as shops sell it. The recording has its own noise and its own delay."""
    number = int(trial.name[:2])
    module = shop(np.random.default_rng([seed, SALT, number]))
    return replace(module, noise=NO_ERRORS, mag_lag_s=0.0)


def measure(task: tuple[Path, int]) -> Row:
    """One recording with one module: true and stated errors."""
    path, seed = task
    trial = scoring.load_trial(path)
    module = module_of(trial, seed)
    felt = module.measures(trial.motion, np.random.default_rng([seed, 2]))
    feed = sampled(felt, params=b"")
    row: Row = {"trial": trial.name, "seed": seed}
    row["has_rotation"] = "translation" not in trial.name
    row["alone"] = errors_of(engines.ENGINES[HOST](feed), trial)
    learned, row["applied_s"] = with_learning(feed)
    row["learned"] = errors_of(learned, trial)
    own = engines.ENGINES[HOST](sampled(trial.motion))
    row["own_total"] = total(own, trial)
    known = guided(module, seed)
    if known is not None:
        found = engines.ENGINES[HOST](sampled(felt, params=known))
        row["guided_total"] = total(found, trial)
    return row


def with_learning(feed: Feed) -> tuple[Estimate, list[float]]:
    """The poses with a daemon that has `learn = "apply"`, and the times of its changes,
    each after the duration of the fit and of the change.
    """
    hello = messages.decode(feed.hello)
    assert isinstance(hello, messages.Message)
    acc, gyr, mag, rate = (float(hello.fields[key]) for key in LSBS)  # type: ignore[arg-type]
    learner, records = Learner(Scale(acc, gyr, mag, rate)), b""
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


def errors_of(estimate: Estimate, trial: Trial) -> Row:
    """Heading errors at the instants, degrees, and by phase the shares of true errors
    inside the stated 95 %, and of poses without a heading.
    """
    moving = scoring.counted(estimate.times_s, trial.motion)
    since_s = estimate.times_s - estimate.times_s[np.argmax(moving)]
    errors = scoring.errors_at(estimate.times_s, estimate.quats, trial.motion)
    is_seen = moving & np.isfinite(errors.total)
    found: Row = {}
    for instant_s in INSTANTS_S:
        near = is_seen & (np.abs(since_s - instant_s) < AROUND_S)
        if near.any():
            found[f"at {instant_s:g} s"] = _rms(errors.heading[near])
    tilt_sigma, heading_sigma = estimate.sigmas_deg
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


LIMITS = {30.0: ((4, 10), (2, 7)), 60.0: ((2, 6), (1.5, 4))}  # must, goal
SOURCES = {ALONE: "alone", LEARNED: "learned"}


def figures_of(
    label: str, rows: Sequence[Row], turning: Sequence[Row]
) -> Iterator[Figure]:
    """Only with what a host learns it has to be as good as required."""
    for instant_s, (must, goal) in LIMITS.items():
        key = f"at {instant_s:g} s"
        errors = [row[key] for row in turning if key in row]
        for share, name, index in ((50, "median", 0), (95, "95th", 1)):
            value = float(np.percentile(errors, share)) if errors else np.nan
            most = must[index] if label == LEARNED else np.inf
            name = f"{label}, heading {key}, {name}"
            yield Figure(name, value, (0, most), (0, goal[index]))
    for name in PHASES:
        for kind in ("tilt", "heading"):
            shares = [row[name][kind] for row in rows if name in row]
            value = 100 * float(np.mean([each for each in shares if each is not None]))
            title = f"{label}, {kind} inside, {name}, %"
            yield Figure(title, value, (93.0, 100.0), (95.0, 98.0))
        null = 100 * float(np.mean([row[name]["null"] for row in rows if name in row]))
        title = f"{label}, no heading, {name}, %"
        yield Figure(title, null, (0, 100.0), (0, 100.0))


def figures(rows: Sequence[Row]) -> Iterator[Figure]:
    """The required figures."""
    for label, source in SOURCES.items():
        turning = [row[source] for row in rows if row["has_rotation"]]
        yield from figures_of(label, [row[source] for row in rows], turning)
    both = [row for row in rows if "guided_total" in row]
    if both:
        guided, own = (
            float(np.mean([row[key] for row in both]))
            for key in ("guided_total", "own_total")
        )
        yield ratio("guided / own calibration", guided, own, 1.15, 1.0)


def measured(args: argparse.Namespace) -> Report:
    """Each public recording with a module of each seed."""
    paths = scoring.find_trials([RECORDINGS])
    tasks = [(path, seed) for seed in harness.seeds_of(args) for path in paths]
    rows = [*harness.each(measure, tasks, args.jobs, "recordings")]
    return Report(figures=[*figures(rows)], data=rows)


main = partial(
    harness.run,
    *("learning", __doc__, measured),
    harness.options(seeds=4, jobs=1),
)
