# SPDX-License-Identifier: MIT
"""Joint angles of made chains of five segments at 40 Hz, with probes fixed and on foam:
docs/limb.md.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.harness import Report, Table
from benchmarks.limb import made_chain
from benchmarks.limb.made_chain import Made
from imud import rotation
from imud.body import chain, fused, heading, posture, session, zero
from imud.body.posture import Posture
from imud.body.tracks import Track
from imud.progress import Progress
from imud.rotation import FloatArray
from imud.virtual.motion import Motion

FIRST = {"tuning": 0, "judging": 300}  # seeds
KINDS = {"arm": made_chain.ARM, "hand": made_chain.HAND}
# Whether probes are loose, and hinges point up at the start.
WAYS = (
    ("fixed", False, False),
    ("on foam", True, False),
    ("fixed, hinges upright", False, True),
    ("on foam, hinges upright", True, True),
)
SETTLED_S = 2.0  # of motion, before which nothing is scored
SIGMAS = 1.96


@dataclass(frozen=True, slots=True)
class Score:
    """Of one joint: rms error of its angles, deg; the share inside the stated 95 %; rms
    of the stated error, deg; the share of moments at which the angle is withheld.
    """

    kind: str
    rms: float
    inside: float
    stated: float
    withheld: float


def analysed(made: Made) -> session.BodyAnalysis:
    """The result of imud for the samples at 40 Hz, as by `imud export --body`."""
    tracks = {name: track_of(each) for name, each in made.motions.items()}
    return session.of(chain.read(made.toml, "made"), tracks)


def track_of(motion: Motion) -> Track:
    times_s = np.arange(len(motion)) / motion.rate_hz
    return fused.attitudes(times_s, motion.gyr, motion.acc, motion.mag)


def scored(made: Made, found: session.BodyAnalysis) -> list[Score]:
    body, times_s = chain.read(made.toml, "made"), found.posture.times_s
    true = upright(made, found.posture)
    rows = times_s > made_chain.STILL_S + SETTLED_S
    scores = []
    for parent, child in body.joints():
        known, seen = found.known[child.name], found.posture.angles[child.name]
        mounts = found.mounts[parent.name], found.mounts[child.name]
        both = true[parent.name], true[child.name]
        axes = posture.axes_of(known, mounts)
        truth = posture.angles_of(known, both, axes, body.side)
        if child.joint.freedom == 1:
            truth = hinge_truth(both, seen)
        off = (seen - truth + np.pi) % (2.0 * np.pi) - np.pi
        good = np.isfinite(off).all(axis=1) & rows
        sigmas = found.posture.sigmas[child.name][good]
        withheld = 1.0 - float(good.sum() / rows.sum())
        if not good.any():
            nan = math.nan
            scores.append(Score(child.kind, nan, nan, nan, withheld))
            continue
        is_in = np.abs(off[good]) <= SIGMAS * sigmas
        rms, stated = (
            float(np.degrees(np.sqrt((each**2).mean()))) for each in (off[good], sigmas)
        )
        inside = float(is_in.mean())
        scores.append(Score(child.kind, rms, inside, stated, withheld))
    return scores


def hinge_truth(both: tuple[FloatArray, FloatArray], found: FloatArray) -> FloatArray:
    """The true angle of a hinge about its own axis, whose positive end is that of
    `found`: rad, (n, 1).
    """
    turn = rotation.multiply(rotation.inverse(both[0]), both[1])
    turns = rotation.to_rotation_vector(turn)
    good = np.isfinite(turns).all(axis=1)
    axis = np.linalg.eigh(turns[good].T @ turns[good])[1][:, -1:]
    angle = turns @ axis
    return np.asarray(angle * np.sign(np.nansum(angle * found)))


def upright(made: Made, found: Posture) -> dict[str, FloatArray]:
    """True attitudes of segments that all stand upright in the pose, in the heading of
    the root that imud found.
    """
    stood = {}
    for name, quats in made.quats.items():
        quat = rotation.interpolate(found.times_s, made.times_s, quats)
        stood[name] = rotation.multiply(quat, rotation.inverse(quats[0]))
    # By how much the root that was found is turned about up, in the pose.
    first = found.quats["one"][found.times_s < made_chain.STILL_S - 1.0][-1]
    off = rotation.multiply(first, rotation.inverse(zero.UPRIGHT))
    back = heading.about_up(np.array(-2.0 * np.arctan2(off[3], off[0])))
    facing = rotation.multiply(back, zero.UPRIGHT)
    return {name: rotation.multiply(each, facing) for name, each in stood.items()}


def summary(way: str, scores: Sequence[Score]) -> list[dict[str, Any]]:
    """By kind of joint: root mean squares and the worst."""
    found = []
    for kind in dict.fromkeys(each.kind for each in scores):
        every = [each for each in scores if each.kind == kind]
        some = [each for each in every if each.withheld < 1.0]
        row: dict[str, Any] = {
            "joints": f"{kind}, {way}",
            "number": len(every),
            "never stated": len(every) - len(some),
            "withheld": 100.0 * float(np.mean([each.withheld for each in every])),
        }
        if some:
            row |= {
                "error": rms_of([each.rms for each in some]),
                "worst": max(each.rms for each in some),
                "stated": rms_of([each.stated for each in some]),
                "inside": 100.0 * float(np.mean([each.inside for each in some])),
            }
        found.append(row)
    return found


def rms_of(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


COLUMNS = {
    "joints": ("joints", ""),
    "number": ("number", "d"),
    "error": ("error", ".2f"),
    "worst": ("worst", ".2f"),
    "stated": ("stated", ".2f"),
    "inside, %": ("inside", ".1f"),
    "withheld, %": ("withheld", ".1f"),
    "never stated": ("never stated", "d"),
}


def measured(args: argparse.Namespace) -> Report:
    rows: list[dict[str, Any]] = []
    seeds = range(FIRST[args.set], FIRST[args.set] + args.seeds)
    for way, is_loose, is_upright in WAYS:
        progress = Progress(way, len(seeds) * len(KINDS))
        scores = []
        for seed, joints in product(seeds, KINDS.values()):
            made = made_chain.made(
                seed, joints, args.seconds, is_loose=is_loose, is_upright=is_upright
            )
            scores += scored(made, analysed(made))
            progress.advance()
        progress.end()
        rows += summary(way, scores)
    return Report([Table.of("joints", COLUMNS, rows)])


def more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", metavar="S", type=float, default=60.0)


main = partial(
    harness.run,
    *("limb-chains", __doc__, measured),
    harness.options(seeds=4, more=more),
)
