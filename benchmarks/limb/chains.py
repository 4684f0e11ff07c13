# SPDX-License-Identifier: MIT
"""Joint angles of made chains of five segments at 40 Hz, with probes fixed and on foam,
and those of hinges by a plain 1D correction: docs/limb-methods.md. Seeds for
tuning and for judging are kept apart.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.common.options import parser_of
from benchmarks.common.paths import RESULTS, write_results
from benchmarks.limb import made_chain, peers
from benchmarks.limb.made_chain import Made
from imud import rotation
from imud.body import chain, fused, heading, posture, session, zero
from imud.body.posture import Posture
from imud.body.tracks import Track
from imud.progress import Progress
from imud.rotation import FloatArray
from imud.virtual.motion import Motion

OUTPUT = RESULTS / "limb_chain.json"
SETS = {"tuning": range(4), "judging": range(300, 304)}
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
POSE_S = made_chain.STILL_S - 1.8, made_chain.STILL_S - 0.3  # as imud takes


@dataclass(frozen=True, slots=True)
class Score:
    """Of one joint: rms error of its angles, deg, and that of the peer, NaN if it has
    none; the share inside the stated 95 %; rms of the stated error, deg; the share of
    moments at which the angle is withheld.
    """

    kind: str
    rms: float
    plain: float
    inside: float
    stated: float
    withheld: float


def measured(made: Made) -> session.BodyAnalysis:
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
        plain = math.nan
        if child.joint.freedom == 1:
            truth = hinge_truth(both, seen)
            pair = made.motions[parent.name], made.motions[child.name]
            plain = plain_rms(pair, times_s[rows], truth[rows, 0])
        off = (seen - truth + np.pi) % (2.0 * np.pi) - np.pi
        good = np.isfinite(off).all(axis=1) & rows
        sigmas = found.posture.sigmas[child.name][good]
        withheld = 1.0 - float(good.sum() / rows.sum())
        if not good.any():
            nan = math.nan
            scores.append(Score(child.kind, nan, plain, nan, nan, withheld))
            continue
        is_in = np.abs(off[good]) <= SIGMAS * sigmas
        rms, stated = (
            float(np.degrees(np.sqrt((each**2).mean()))) for each in (off[good], sigmas)
        )
        inside = float(is_in.mean())
        scores.append(Score(child.kind, rms, plain, inside, stated, withheld))
    return scores


def plain_rms(
    pair: tuple[Motion, Motion], times_s: FloatArray, truth: FloatArray
) -> float:
    """Of a plain 1D correction, deg; the better end of its axis is the positive one."""
    known_s = np.arange(len(pair[0])) / pair[0].rate_hz
    angle = np.interp(times_s, known_s, peers.one_degree(*pair, POSE_S))
    offs = [np.angle(np.exp(1j * (sign * angle - truth))) for sign in (1.0, -1.0)]
    return float(np.degrees(min(np.sqrt((off**2).mean()) for off in offs)))


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


def summary(scores: Sequence[Score]) -> dict[str, dict[str, Any]]:
    """By kind of joint: root mean squares and the worst, and how many hinges are worse
    than with the plain correction.
    """
    found = {}
    for kind in dict.fromkeys(each.kind for each in scores):
        some = [each for each in scores if each.kind == kind and each.withheld < 1.0]
        plain = [each for each in some if math.isfinite(each.plain)]
        worse = [each.rms - each.plain for each in plain if each.rms > each.plain]
        found[kind] = {
            "joints": sum(each.kind == kind for each in scores),
            "never stated": sum(e.kind == kind and e.withheld == 1.0 for e in scores),
            "withheld": float(np.mean([e.withheld for e in scores if e.kind == kind])),
            "rms": rms_of([each.rms for each in some]),
            "worst": max((each.rms for each in some), default=None),
            "stated": rms_of([each.stated for each in some]),
            "inside": float(np.mean([each.inside for each in some])) if some else None,
            "plain rms": rms_of([each.plain for each in plain]),
            "plain worst": max((each.plain for each in plain), default=None),
            "worse than plain": len(worse),
            "worse by": max(worse, default=0.0),
        }
    return found


def rms_of(values: Sequence[float]) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if values else None


def table_of(found: Mapping[str, Mapping[str, Any]]) -> str:
    """A line for each kind of joint."""
    lines = []
    for kind, row in found.items():
        line = f"  {kind:10} of {row['joints']:2}, {row['never stated']} never stated"
        if row["rms"] is not None:
            line += (
                f": {row['rms']:5.2f} (worst {row['worst']:5.2f}), stated "
                f"{row['stated']:5.2f}, inside {100.0 * row['inside']:5.1f} %, "
                f"withheld {100.0 * row['withheld']:.1f} %"
            )
        if row["plain rms"] is not None:
            line += (
                f"; plain 1D {row['plain rms']:5.2f} (worst {row['plain worst']:5.2f}),"
                f" ahead in {row['worse than plain']} by {row['worse by']:.2f} at most"
            )
        lines.append(line)
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__, SETS, OUTPUT)
    parser.add_argument("--seconds", metavar="S", type=float, default=60.0)
    args = parser.parse_args(argv)
    sets: dict[str, Any] = {}
    for name in args.sets:
        sets[name] = {}
        for how, is_loose, is_upright in WAYS:
            what = f"{name}, {how}"
            progress = Progress(what, len(SETS[name]) * len(KINDS))
            rows = []
            for seed in SETS[name]:
                for kinds_of_joints in KINDS.values():
                    made = made_chain.made(
                        seed,
                        kinds_of_joints,
                        args.seconds,
                        is_loose=is_loose,
                        is_upright=is_upright,
                    )
                    rows += scored(made, measured(made))
                    progress.advance()
            progress.end()
            kinds = summary(rows)
            joints = [asdict(each) for each in rows]
            sets[name][how] = {"seeds": len(SETS[name]), "kinds": kinds, "rows": joints}
            print(f"{what}: rms of angles in degrees")
            print(table_of(kinds), flush=True)
    report = {"seconds": args.seconds, "sets": sets}
    write_results(args.output, report)
    return 0


if __name__ == "__main__":
    sys.exit(main())
