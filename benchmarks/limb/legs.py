# SPDX-License-Identifier: MIT
"""Joint angles and the path of a foot by three virtual probes on a leg:
docs/limb-methods.md.

Runs the host build of the filter on the samples that the virtual Nano would read.
Seeds for tuning and for judging are kept apart.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.common.engines import ENGINES, HOST
from benchmarks.common.feed import Feed, sampled
from benchmarks.common.options import parser_of
from benchmarks.common.paths import RESULTS, write_results
from benchmarks.limb import clocks, peers
from imud.body import chain, contact, level, mounting, posture, tracks
from imud.body.chain import Chain
from imud.body.mounting import Mount
from imud.body.tracks import Track
from imud.progress import Progress
from imud.rotation import FloatArray
from imud.virtual import leg
from imud.virtual.leg_probes import RATE_HZ

OUTPUT = RESULTS / "limb.json"
SETS = {"tuning": range(6), "judging": range(200, 210)}
COMMON_HZ = 100.0
FACING = 0.0  # the leg walks east
GROUND_S = (1.0, 5.5)  # of standing
STEPS = 10
SIGMAS = 1.96
JOINTS = {"knee": "shank", "ankle": "foot"}
PLANES = ("flexion", "abduction", "rotation")

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
        "motion": by_motion.mounts,
        "pose": mounting.by_pose(body, standing, FACING).mounts,
    }


def score(made: leg.Leg, found: posture.Posture) -> Row:
    """Errors of joint angles while walking, degrees, and the share inside 95 %."""
    first, last = made.stages["walk"]
    rows = (found.times_s >= first) & (found.times_s < last)
    at = np.rint(found.times_s[rows] * RATE_HZ).astype(int)
    row: Row = {}
    inside = []
    for joint, child in JOINTS.items():
        off = found.angles[child][rows] - made.angles[child][at]
        off = np.degrees((off + np.pi) % (2.0 * np.pi) - np.pi)
        row["missing"] = float(np.isnan(off).mean())
        rms = np.sqrt(np.nanmean(off**2, axis=0)).tolist()
        row |= {f"{joint} {plane}": rms[i] for i, plane in enumerate(PLANES)}
        if child in found.sigmas:
            is_in = np.abs(off) <= SIGMAS * np.degrees(found.sigmas[child][rows])
            share = is_in.mean(axis=0).tolist()
            row |= {f"{joint} {p} inside": share[i] for i, p in enumerate(PLANES)}
            inside.append(share)
    if inside:
        row["inside"] = float(np.mean(inside))
    return row


def strides(made: leg.Leg, foot: Track) -> Row:
    """Relative errors of the lengths of STEPS strides in the middle of the walk."""
    first, last = made.stages["walk"]
    walked = contact.path(foot.between(first - 1.0, last + 1.0))
    ends = [walked.times_s[(a + b) // 2] for a, b in walked.rests]
    at = np.rint(np.array(ends) * RATE_HZ).astype(int)
    truth = np.linalg.norm(np.diff(made.ankle[at], axis=0)[:, :2], axis=1)
    middle = max(1, (len(truth) - STEPS) // 2)
    rows = slice(middle, middle + STEPS)
    share = np.abs(walked.strides[rows] / truth[rows] - 1.0)
    return {
        "strides": float(len(share)),
        "stride median": float(np.median(share)),
        "stride p95": float(np.percentile(share, 95)),
    }


def measure(seed: int, walk_s: float) -> dict[str, Row]:
    """All figures of one leg, by method."""
    made = leg.made(seed, leg.Manner(walk_s=walk_s))
    body = chain.read(leg.CHAIN, "leg")
    feeds = {name: sampled(each) for name, each in made.motions.items()}
    random = np.random.default_rng([seed, 0xC10C])
    given = {name: clocks.dated(f.times_s, random) for name, f in feeds.items()}
    found = {
        name: replace(track_of(feed), times_s=given[name])
        for name, feed in feeds.items()
    }
    times_s = tracks.common_times(list(found.values()), COMMON_HZ)
    together = {name: tracks.joined(each, times_s) for name, each in found.items()}
    rows: dict[str, Row] = {}
    for name, mounts in aligned(body, together, made.stages).items():
        rows[name] = score(made, posture.of(body, together, mounts))
    rows["motion"] |= strides(made, found["foot"])
    true_s = [each.times_s for each in feeds.values()]
    rows["motion"]["apart ms"] = 1e3 * clocks.apart(true_s, list(given.values()))
    bare = {
        name: tracks.joined(
            level.attitudes(
                each.samples.gyr, each.samples.acc, each.samples.rate_hz
            ).since(each.times_s[0]),
            times_s,
        )
        for name, each in feeds.items()
    }
    rows["motion, no compass"] = score(
        made, posture.of(body, bare, aligned(body, bare, made.stages)["motion"])
    )
    rivals: dict[str, Callable[[Mapping[str, Feed], FloatArray], posture.Posture]] = {
        "OpenSense's way": peers.opensense,
        "Rozanowski's way": peers.rozanowski,
    }
    for name, rival in rivals.items():
        rows[name] = score(made, rival(feeds, times_s))
    return rows


def summary(rows: Sequence[dict[str, Row]]) -> dict[str, Any]:
    """Over the legs: means by method; of those aligned by motion the worst values."""
    means = {
        name: {key: float(np.mean([each[name][key] for each in rows])) for key in first}
        for name, first in rows[0].items()
    }
    ours = [each["motion"] for each in rows]
    worst = {key: max(each[key] for each in ours) for key in ours[0]}
    worst["inside"] = min(each["inside"] for each in ours)
    return {"legs": len(rows), "means": means, "worst": worst}


def table_of(found: Mapping[str, Any]) -> str:
    """A table of the means, for each method."""
    means = found["means"]
    keys = [f"{joint} {plane}" for joint in JOINTS for plane in PLANES]
    lines = [" " * 20 + " ".join(f"{key:>16}" for key in keys) + "   inside"]
    for name, row in means.items():
        cells = " ".join(f"{row[key]:16.2f}" for key in keys)
        lines.append(f"{name:20}{cells}   {100 * row.get('inside', np.nan):5.1f} %")
    apart = found["worst"]["apart ms"]
    lines.append(f"time between probes, p99 of the worst leg: {apart:.2f} ms")
    for key in ("stride median", "stride p95"):
        lines.append(f"{key}: {100 * means['motion'][key]:.1f} %")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__, SETS, OUTPUT)
    parser.add_argument("--walk", metavar="S", type=float, default=60.0)
    parser.add_argument("--legs", metavar="N", type=int, help="only N of each set")
    args = parser.parse_args(argv)
    sets = {}
    for name in args.sets:
        seeds = SETS[name][: args.legs]
        progress = Progress(f"{len(seeds)} legs", len(seeds))
        rows = []
        for seed in seeds:
            rows.append(measure(seed, args.walk))
            progress.advance()
        progress.end()
        sets[name] = summary(rows) | {"rows": rows}
        print(f"{name}: {len(seeds)} legs, rms in degrees, {args.walk:g} s of walking")
        print(table_of(sets[name]))
    report = {"walk_s": args.walk, "sets": sets}
    write_results(args.output, report)
    return 0


if __name__ == "__main__":
    sys.exit(main())
