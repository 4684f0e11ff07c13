# SPDX-License-Identifier: MIT
"""Poses that are estimated afterwards, as `imud refine` does, beside VQF offline: on
recordings with optical truth, with the errors of shops' modules laid over them, and on
made recordings.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.accuracy.compared import grouped
from benchmarks.accuracy.groups import EAST, KNOWN
from benchmarks.calibration.learning import module_of
from benchmarks.common import engines, scoring
from benchmarks.common.engines import HOST, OFFLINE, Estimate
from benchmarks.common.feed import MPU9250, Feed, sampled
from benchmarks.common.paths import RECORDINGS
from benchmarks.common.scoring import SIGMAS, Coverage, Score
from benchmarks.harness import Figure, Report, Table, degrees
from imud.params.trusted import known_to, place_of
from imud.params.value import Params
from imud.recordings import audit
from imud.recordings.refining import at_rest_alone
from imud.refine.known import priors_of
from imud.refine.model import CALIBRATED, SHOP, Priors, Recording
from imud.refine.whole import parts_of
from imud.rotation import FloatArray
from imud.virtual.motion import Motion
from imud.virtual.motions.groups import GROUPS, Recipe, recipes

DELAY_S = MPU9250.gyr_lowpass[1] - 0.5 / MPU9250.rate_hz
BROAD_DELAY_S = 0.0015  # of the recordings' own sensor
PUBLIC, SIMPLE, MODULES = "recordings", "field at rest alone", "shops' modules"
MODULE_SEED = 2
KINDS = (PUBLIC, SIMPLE, MODULES)
Task = tuple[str, Path | Recipe]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of one recording: errors of ours and of VQF's, and what ours states."""

    group: str
    score: Score
    other: Score
    coverage: Coverage
    change_deg: float  # rms error of the heading's change since the first moving pose
    change_sigma_deg: float
    change_inside: float
    is_withheld: bool
    audit_tilt: float  # what an audit finds of the on-line error, over the true one
    audit_heading: float
    cost: float  # seconds of processor a minute


def measure(task: Task) -> Outcome:
    """One recording."""
    group, source = task
    if isinstance(source, Recipe):
        motion, field_ut = source.made_in_field()
        params = known_to(*KNOWN[source.module], **place_of(field_ut))
        feed = sampled(motion, MPU9250, params)
        return outcome_of(
            group, motion, feed, priors_of(Params.decode(params)), DELAY_S
        )
    trial = scoring.load_trial(source)
    motion = trial.motion
    if group != MODULES:
        return outcome_of(group, motion, sampled(motion), CALIBRATED, BROAD_DELAY_S)
    felt = module_of(trial, MODULE_SEED).measures(motion, np.random.default_rng(2))
    feed = sampled(felt, MPU9250, b"")
    return outcome_of(group, motion, feed, SHOP, BROAD_DELAY_S)


def outcome_of(
    group: str, motion: Motion, feed: Feed, priors: Priors, delay_s: float
) -> Outcome:
    samples = feed.samples
    recording = Recording(samples.rate_hz, samples.gyr, samples.acc, samples.mag)
    if group == SIMPLE:
        recording = at_rest_alone(recording)
    began_s = time.process_time()
    parts = [part for part, _ in parts_of(recording, priors, delay_s)]
    spent_s = time.process_time() - began_s

    def joined(name: str) -> FloatArray:
        return np.concatenate([getattr(part, name) for part in parts])

    quats = joined("quats")
    times_s = feed.times_s[: len(quats)]
    mine = Estimate(times_s, quats, joined("tilt_deg"), joined("heading_deg"))
    other = engines.ENGINES[OFFLINE](feed)
    moving = scoring.counted(times_s, motion)
    turned = scoring.errors_at(times_s, quats, motion).turned[moving]
    known = np.isfinite(turned)
    turned, sigma = turned[known], joined("change_deg")[moving][known]
    change = np.degrees(np.angle(np.exp(1j * np.radians(turned - turned[0]))))
    stated = np.isfinite(sigma)
    found = audited(feed, motion, times_s, quats)
    return Outcome(
        group,
        scoring.score_at(times_s, quats, motion),
        scoring.score_at(other.times_s - delay_s, other.quats, motion),
        scoring.coverage_at(mine, motion),
        float(np.sqrt((change**2).mean())),
        float(np.median(sigma[stated])) if stated.any() else math.nan,
        _inside(change[stated], sigma[stated]),
        any(part.doubts for part in parts),
        *found,
        spent_s * 60.0 / (len(recording.gyr) / recording.rate_hz),
    )


def _inside(errors: FloatArray, sigmas: FloatArray) -> float:
    """The share of errors inside the stated 95 %; NaN without any."""
    is_inside = np.abs(errors) < SIGMAS * sigmas
    return float(is_inside.mean()) if len(errors) else math.nan


def audited(
    feed: Feed, motion: Motion, times_s: FloatArray, quats: FloatArray
) -> tuple[float, float]:
    """Errors of on-line poses by the refined ones, over the true ones: rms of tilt and
    of heading, where both are stated.
    """
    online = engines.ENGINES[HOST](feed)
    _, stated = online.sigmas_deg
    at = np.searchsorted(times_s, online.times_s).clip(max=len(times_s) - 1)
    is_used = scoring.counted(online.times_s, motion) & np.isfinite(stated)
    true = scoring.errors_at(online.times_s, online.quats, motion)
    is_used &= np.isfinite(true.total)
    tilt, heading = audit.differences(online.quats[is_used], quats[at][is_used])
    pairs = (tilt, true.inclination[is_used]), (heading, true.heading[is_used])
    one, other = (math.sqrt((a**2).mean() / (b**2).mean()) for a, b in pairs)
    return one, other


COLUMNS = {
    "group": ("group", ""),
    "recordings": ("count", "d"),
    "total": ("total", ".2f"),
    "heading / VQF offline": ("heading", ""),
    "less its mean": ("varying", ""),
    "inclination / VQF offline": ("inclination", ""),
    "tilt in %, sigma": ("tilt in", ""),
    "heading in %, sigma": ("heading in", ""),
    "change: error, sigma, in %": ("change", ""),
    "withheld, %": ("withheld", ".0f"),
    "audit within 2, %": ("audit", ""),
    "s/min": ("cost", ".1f"),
}


def row(name: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Means over recordings, as COLUMNS name them."""
    mine, other = (
        Score.mean([getattr(each, name) for each in outcomes])
        for name in ("score", "other")
    )
    inside = Coverage.mean([each.coverage for each in outcomes])
    change, sigma, share = np.nanmean(
        [(e.change_deg, e.change_sigma_deg, e.change_inside) for e in outcomes], axis=0
    )
    return {
        "group": name,
        "count": len(outcomes),
        "total": mine.total,
        "heading": f"{mine.heading:.2f} / {other.heading:.2f}",
        "varying": f"{mine.varying:.2f} / {other.varying:.2f}",
        "inclination": f"{mine.inclination:.2f} / {other.inclination:.2f}",
        "tilt in": f"{100 * inside.tilt:.0f}, {inside.tilt_sigma_deg:.2f}",
        "heading in": f"{100 * inside.heading:.0f}, {inside.heading_sigma_deg:.2f}",
        "change": f"{change:.2f}, {sigma:.2f}, {100 * share:.0f}",
        "withheld": 100.0 * float(np.mean([each.is_withheld for each in outcomes])),
        "audit": ", ".join(f"{share:.0f}" for share in audits(outcomes)),
        "cost": float(np.mean([each.cost for each in outcomes])),
    }


def audits(outcomes: Sequence[Outcome]) -> list[float]:
    """Shares of recordings, in percent, whose audit of tilt and of heading is right
    within a factor of two.
    """
    found = np.array([(each.audit_tilt, each.audit_heading) for each in outcomes])
    shares: list[float] = (100.0 * (np.abs(np.log2(found)) < 1.0).mean(axis=0)).tolist()
    return shares


def figures(groups: dict[str, list[Outcome]]) -> Iterator[Figure]:
    """The required figures."""
    if PUBLIC in groups:
        score = Score.mean([each.score for each in groups[PUBLIC]])
        yield degrees("recordings: total, deg", score.total, 1.0, 0.9)
        yield degrees("heading less its mean, deg", score.varying, 0.40, 0.33)
        yield degrees("inclination, deg", score.inclination, 0.33, 0.30)
        cost = float(np.mean([each.cost for each in groups[PUBLIC]]))
        yield Figure("seconds a minute", cost, (0.0, 2.0), (0.0, 1.0))
    if MODULES in groups:
        totals = [each.score.total for each in groups[MODULES]]
        yield degrees("modules: median total, deg", float(np.median(totals)), 1.5, 1.0)
        yield degrees("modules: worst total, deg", max(totals), 4.0, 3.0)
    every = [each for name in groups for each in groups[name] if name != SIMPLE]
    for kind, share in zip(("tilt", "heading"), audits(every), strict=True):
        name = f"audit of {kind} within a factor 2, % of recordings"
        yield Figure(name, share, (80.0, 100.0), (95.0, 100.0))
    made = {name: each for name, each in groups.items() if name not in KINDS}
    if not made:
        return
    for kind, must, goal in (("heading", 0.9, 0.6), ("inclination", 1.0, 0.8)):
        ratios = {
            name: _mean(outcomes, "score", kind) / _mean(outcomes, "other", kind)
            for name, outcomes in made.items()
            if name != EAST
        }
        worst = max(ratios, key=ratios.__getitem__)
        name = f"{kind} / VQF offline, worst group"
        yield Figure(name, ratios[worst], (0.0, must), (0.0, goal), worst)
    for kind in ("tilt", "heading"):
        shares = {name: _mean(each, "coverage", kind) for name, each in made.items()}
        worst = min(shares, key=shares.__getitem__)
        name = f"{kind} inside {SIGMAS:g} sigma, %, worst group"
        yield Figure(name, 100 * shares[worst], (90.0, 100.0), (93.0, 98.0), worst)
    withheld = [each.is_withheld for outcomes in made.values() for each in outcomes]
    value = 100.0 * float(np.mean(withheld))
    yield Figure("made recordings withheld, %", value, (0.0, 5.0), (0.0, 1.0))


def _mean(outcomes: Sequence[Outcome], of: str, kind: str) -> float:
    values = [getattr(getattr(each, of), kind) for each in outcomes]
    return float(np.nanmean(values))


def measured(args: argparse.Namespace) -> Report:
    paths = scoring.find_trials([RECORDINGS])
    tasks: list[Task] = [(kind, path) for kind in KINDS for path in paths]
    tasks += [(each.group, each) for each in recipes(args.set)]
    wanted = [task for task in tasks if task[0] in args.groups]
    found = list(harness.each(measure, wanted, args.jobs, "recordings"))
    groups = grouped(found, lambda each: each.group)
    rows = [row(name, outcomes) for name, outcomes in groups.items()]
    return Report([Table.of("groups", COLUMNS, rows)], [*figures(groups)])


def more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--set", choices=harness.SETS, default="judging", help="seeds")


main = partial(
    harness.run,
    *("afterwards", __doc__, measured),
    harness.options(groups=[*KINDS, *GROUPS], jobs=2, more=more),
)
