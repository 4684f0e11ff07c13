# SPDX-License-Identifier: MIT
"""Joint angles and the path of a foot by three virtual probes on a leg:
docs/limb.md.

Runs the host build of the filter on the samples that the virtual Nano would read.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.common.engines import ENGINES, HOST
from benchmarks.common.feed import Feed, sampled
from benchmarks.harness import Report, Table
from imud.body import chain, contact, level, mounting, posture, tracks
from imud.body.chain import Chain
from imud.body.mounting import Mount
from imud.body.tracks import Track
from imud.probes.clock import ProbeClock
from imud.rotation import FloatArray
from imud.virtual import leg
from imud.virtual.leg_probes import RATE_HZ

SEEDS = {"tuning": (0, 6), "judging": (200, 10)}  # the first, and how many
COMMON_HZ = 100.0
FACING = 0.0  # the leg walks east
GROUND_S = (1.0, 5.5)  # of standing
STEPS = 10
SIGMAS = 1.96
JOINTS = {"knee": "shank", "ankle": "foot"}
PLANES = ("flexion", "abduction", "rotation")
MOTION = "aligned by motion"

# Clocks of several probes: each drifts, and the daemon dates its messages.
RATE_PPM = 3000.0  # of a Nano's ceramic resonator, at most
DRIFT_PPM_S = 0.5  # as it warms up
START_S = 20.0  # for which the probes were connected before
LATE_S = (0.5e-3, 2e-3)  # a message: at least, and the mean of what adds to it
STALL_S, STALLS = 16e-3, 0.02  # a USB adapter or a busy host; share of messages
ANSWER_S = 1.0  # between requests for the probe's time

Row = dict[str, float]


def track_of(feed: Feed) -> Track:
    """Poses of the host build at the samples, with the samples beside them."""
    found = ENGINES[HOST](feed)
    assert found.tilt_sigma_deg is not None
    assert found.heading_sigma_deg is not None
    poses = tracks.of_poses(
        found.times_s,
        found.quats,
        np.radians(found.tilt_sigma_deg),
        np.radians(found.heading_sigma_deg),
    )
    return with_samples(tracks.joined(poses, feed.times_s), feed)


def with_samples(poses: Track, feed: Feed) -> Track:
    samples = feed.samples
    bias = level.biases(samples.gyr, samples.acc, samples.rate_hz)
    return Track(
        feed.times_s,
        poses.quat,
        samples.gyr - bias,
        poses.tilt_sigma,
        poses.heading_sigma,
        samples.acc,
    )


def aligned(
    body: Chain, found: Mapping[str, Track], stages: leg.Stages
) -> dict[str, Mapping[str, Mount]]:
    """Mounts by each way of alignment."""
    standing = {name: each.between(*GROUND_S) for name, each in found.items()}
    span = stages["squat"][0], stages["raise"][1]
    moving = {name: each.between(*span) for name, each in found.items()}
    span = stages["walk"]
    walking = {name: each.between(*span) for name, each in found.items()}
    by_motion = mounting.by_motion(body, standing, moving, walking=walking)
    return {
        MOTION: by_motion.mounts,
        "aligned by pose, direction known": mounting.by_pose(
            body, standing, FACING
        ).mounts,
    }


def score(made: leg.Leg, found: posture.Posture) -> Row:
    """Errors of joint angles while walking, degrees, and the percentage inside 95 %."""
    first, last = made.stages["walk"]
    rows = (found.times_s >= first) & (found.times_s < last)
    at = np.rint(found.times_s[rows] * RATE_HZ).astype(int)
    row: Row = {}
    inside = []
    for joint, child in JOINTS.items():
        off = found.angles[child][rows] - made.angles[child][at]
        off = np.degrees((off + np.pi) % (2.0 * np.pi) - np.pi)
        rms = np.sqrt(np.nanmean(off**2, axis=0)).tolist()
        row |= {f"{joint} {plane}": rms[i] for i, plane in enumerate(PLANES)}
        if child in found.sigmas:
            is_in = np.abs(off) <= SIGMAS * np.degrees(found.sigmas[child][rows])
            inside.append(is_in.mean(axis=0))
    if inside:
        row["inside"] = 100.0 * float(np.mean(inside))
    return row


def strides(made: leg.Leg, foot: Track) -> Row:
    """Errors of the lengths of STEPS strides in the middle of the walk, percent."""
    first, last = made.stages["walk"]
    walked = contact.path(foot.between(first - 1.0, last + 1.0))
    ends = [walked.times_s[(a + b) // 2] for a, b in walked.rests]
    at = np.rint(np.array(ends) * RATE_HZ).astype(int)
    truth = np.linalg.norm(np.diff(made.ankle[at], axis=0)[:, :2], axis=1)
    middle = max(1, (len(truth) - STEPS) // 2)
    rows = slice(middle, middle + STEPS)
    share = 100.0 * np.abs(walked.strides[rows] / truth[rows] - 1.0)
    return {
        "stride median": float(np.median(share)),
        "stride p95": float(np.percentile(share, 95)),
    }


def dated(times_s: FloatArray, random: np.random.Generator) -> FloatArray:
    """The times that the daemon gives to samples of these true times, at once."""
    step = float(np.median(np.diff(times_s)))
    before = times_s[0] - step * np.arange(round(START_S / step), 0, -1)
    true = np.concatenate([before, times_s])
    since = true - true[0] + 1.0
    rate = random.uniform(-RATE_PPM, RATE_PPM) * 1e-6
    drift = random.uniform(-DRIFT_PPM_S, DRIFT_PPM_S) * 1e-6
    device_us = np.floor(1e6 * (since * (1.0 + rate) + 0.5 * drift * since**2))
    late = LATE_S[0] + random.exponential(LATE_S[1], len(true))
    late += (random.random(len(true)) < STALLS) * random.uniform(0, STALL_S, len(true))
    came = np.maximum.accumulate(since + late)
    clock = ProbeClock()
    found = np.empty(len(true))
    asked = 0.0
    for index, (at_us, came_s) in enumerate(
        zip(device_us.astype(int).tolist(), came.tolist(), strict=True)
    ):
        clock.arrived(at_us, round(came_s * 1e9))
        if since[index] - asked > ANSWER_S:
            asked = float(since[index])
            sent = asked - LATE_S[0] - random.exponential(LATE_S[1])
            clock.heard(at_us, round(sent * 1e9))
        found[index] = clock.moment(at_us).host_ns * 1e-9
    return np.asarray((found - 1.0 + true[0])[len(before) :])


def measure(seed: int, walk_s: float) -> dict[str, Row]:
    """All figures of one leg, by method."""
    made = leg.made(seed, leg.Manner(walk_s=walk_s))
    body = chain.read(leg.CHAIN, "leg")
    feeds = {name: sampled(each) for name, each in made.motions.items()}
    random = np.random.default_rng([seed, 0xC10C])
    found = {
        name: replace(track_of(feed), times_s=dated(feed.times_s, random))
        for name, feed in feeds.items()
    }
    times_s = tracks.common_times(list(found.values()), COMMON_HZ)
    together = {name: tracks.joined(each, times_s) for name, each in found.items()}
    rows: dict[str, Row] = {}
    for name, mounts in aligned(body, together, made.stages).items():
        rows[name] = score(made, posture.of(body, together, mounts))
    rows[MOTION] |= strides(made, found["foot"])
    bare = {
        name: tracks.joined(
            level.attitudes(
                each.samples.gyr, each.samples.acc, each.samples.rate_hz
            ).since(each.times_s[0]),
            times_s,
        )
        for name, each in feeds.items()
    }
    rows["by motion, without magnetometers"] = score(
        made, posture.of(body, bare, aligned(body, bare, made.stages)[MOTION])
    )
    return rows


def summary(legs: Sequence[dict[str, Row]]) -> list[dict[str, Any]]:
    """Over the legs: means by method; of those aligned by motion the worst values."""
    rows: list[dict[str, Any]] = [
        {"": name}
        | {key: float(np.mean([each[name][key] for each in legs])) for key in of}
        for name, of in legs[0].items()
    ]
    ours = [leg[MOTION] for leg in legs]
    worst = {key: max(row[key] for row in ours) for key in ours[0]}
    worst["inside"] = min(row["inside"] for row in ours)
    return [rows[0], {"": f"{MOTION}, worst leg"} | worst, *rows[1:]]


ANGLES = {f"{joint} {plane}": ".2f" for joint in JOINTS for plane in PLANES}
STRIDES = {"stride median": ".1f", "stride p95": ".1f"}


def tables_of(rows: Sequence[dict[str, Any]]) -> list[Table]:
    """Errors in degrees and percent."""
    columns = {"": "", **ANGLES, "inside": ".1f"} | STRIDES
    pairs = {head: (head, form) for head, form in columns.items()}
    return [Table.of("angles", pairs, rows)]


def measured(args: argparse.Namespace) -> Report:
    first, count = SEEDS[args.set]
    seeds = range(first, first + min(count, args.seeds))
    task = partial(measure, walk_s=args.walk)
    rows = [*harness.each(task, seeds, args.jobs, "legs")]
    return Report(tables_of(summary(rows)))


def more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--walk", metavar="S", type=float, default=60.0)


main = partial(
    harness.run,
    *("limb-legs", __doc__, measured),
    harness.options(seeds=SEEDS["judging"][1], jobs=1, more=more),
)
