# SPDX-License-Identifier: MIT
"""Joint angles of made chains of five segments at 40 Hz, with probes fixed and on foam:
docs/limb.md. Seeds for tuning and for judging are kept apart.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

import numpy as np

from benchmarks.common.options import parser_of
from benchmarks.common.paths import RESULTS
from benchmarks.limb import made_chain
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
SETTLED_S = 2.0  # of motion, before which nothing is scored
SIGMAS = 1.96


def measured(made: Made) -> session.BodyAnalysis:
    """What imud makes of the samples at 40 Hz, as `imud export --body` does."""
    tracks = {name: track_of(each) for name, each in made.motions.items()}
    return session.of(chain.read(made.toml, "made"), tracks)


def track_of(motion: Motion) -> Track:
    times_s = np.arange(len(motion)) / motion.rate_hz
    return fused.attitudes(times_s, motion.gyr, motion.acc, motion.mag)


def scored(made: Made, found: session.BodyAnalysis) -> list[tuple[str, float, float]]:
    """Of each joint its kind, the rms error of its angles (deg), the share in 95 %."""
    body, times_s = chain.read(made.toml, "made"), found.posture.times_s
    true = upright(made, found.posture)
    rows = times_s > made_chain.STILL_S + SETTLED_S
    scores: list[tuple[str, float, float]] = []
    for parent, child in body.joints():
        known = found.known[child.name]
        mounts = found.mounts[parent.name], found.mounts[child.name]
        both = true[parent.name], true[child.name]
        axes = posture.axes_of(known, mounts)
        truth = posture.angles_of(known, both, axes, body.side)
        if child.joint.freedom == 1:
            truth = hinge_truth(both, found.posture.angles[child.name])
        off = found.posture.angles[child.name] - truth
        off = ((off + np.pi) % (2.0 * np.pi) - np.pi)[rows]
        sigmas = found.posture.sigmas[child.name][rows]
        good = np.isfinite(off).all(axis=1)
        off, sigmas = off[good], sigmas[good]
        is_in = np.abs(off) <= SIGMAS * sigmas
        rms = float(np.degrees(np.sqrt((off**2).mean())))
        scores.append((child.kind, rms, float(is_in.mean())))
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


def table_of(rows: Sequence[tuple[str, float, float]]) -> str:
    """A line for each kind of joint: mean and worst error, share inside 95 %."""
    lines = []
    for kind in dict.fromkeys(each[0] for each in rows):
        errors = [rms for name, rms, _ in rows if name == kind]
        inside = np.mean([share for name, _, share in rows if name == kind])
        lines.append(
            f"  {kind:10} {np.mean(errors):5.2f} (worst {max(errors):5.2f}) of "
            f"{len(errors):2}, inside {100.0 * inside:5.1f} %"
        )
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__, SETS, OUTPUT)
    parser.add_argument("--seconds", metavar="S", type=float, default=60.0)
    args = parser.parse_args(argv)
    report = {}
    for name in args.sets:
        for is_loose in (False, True):
            what = f"{name}, {'on foam' if is_loose else 'fixed'}"
            progress = Progress(what, len(SETS[name]) * len(KINDS))
            rows = []
            for seed in SETS[name]:
                for joints in KINDS.values():
                    made = made_chain.made(
                        seed, joints, args.seconds, is_loose=is_loose
                    )
                    rows += scored(made, measured(made))
                    progress.advance()
            progress.end()
            report[what] = rows
            print(f"{what}: rms of angles in degrees")
            print(table_of(rows), flush=True)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
