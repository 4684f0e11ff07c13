# SPDX-License-Identifier: MIT
"""Whether the errors that poses state since an origin are true, and inform: of a probe
that lies still, and of one that a hand aims with.

Every few seconds of a simulated motion is an origin (or of a recording, with
--recordings). At some times after each the change of the true error is compared with
the stated one. Prints a line for each time, and writes
build/benchmarks/honesty-since-origin.json, or with -recordings and the board in its
name. docs/since-origin.md explains the equations.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy import report
from benchmarks.common import engines, scoring
from benchmarks.common.boards import BOARDS, NANO
from benchmarks.common.engines import HOST, Estimate
from benchmarks.common.feed import sampled
from benchmarks.common.figure import SETS, Figure, degrees
from benchmarks.common.paths import RECORDINGS, RESULTS, write_results
from benchmarks.common.scoring import SIGMAS
from imud import rotation
from imud.params.trusted import CALIBRATED, known_to
from imud.params.value import Params
from imud.probes.references import References
from imud.rotation import FloatArray
from imud.virtual.motion import Motion
from imud.virtual.motions import aiming

SEEDS = 16  # of each set
AFTER_S = (1.0, 10.0, 30.0, 60.0, 120.0, 240.0)
FIRST_S = 30.0  # the first origin: all motions have begun
RECORDED_S = 15.0  # the same of recordings
ORIGINS = 60  # of a motion: not more than are kept

RECORDED = "broad"


@dataclass(frozen=True, slots=True)
class Pair:
    """An origin and a time after it; degrees. None: not stated."""

    after_s: float
    heading: float  # the true error, its magnitude
    heading_sigma: float | None
    tilt: float
    tilt_sigma: float | None


@dataclass(frozen=True, slots=True)
class Stated:
    """Of all pairs of one time, degrees."""

    count: int
    withheld: float  # share without a stated error
    sigma: float  # rms of the stated
    true: float  # rms of the true ones
    inside: float  # share of true errors within 1.96 of the stated sigma


@dataclass(frozen=True, slots=True)
class Line:
    motion: str
    after_s: float
    heading: Stated
    tilt: Stated


def known_params() -> bytes:
    """Params of a probe that knows the accuracy of its sensors as the motions draw
    them."""
    norm_ut = float(np.linalg.norm(aiming.FIELD_UT))
    dip_deg = float(np.degrees(-np.arcsin(aiming.FIELD_UT[2] / norm_ut)))
    params = Params.decode(known_to(0.007, aiming.MAG_OWN_UT))
    told: dict[str, dict[str, object]] = {
        "gyr": {"sigma": aiming.GYR_SCALE},
        "mag": {"norm_uT": norm_ut, "dip_deg": dip_deg},
    }
    for sensor, values in told.items():
        params = params.replaced(sensor, {**(params.plain(sensor) or {}), **values})
    return params.encode()


def wrong_of(found: Estimate, truth: Motion) -> FloatArray:
    """The error of each pose, as a rotation in the world."""
    assert truth.quat is not None
    known_s = np.arange(len(truth)) / truth.rate_hz
    true = rotation.interpolate(found.times_s, known_s, truth.quat)
    return rotation.multiply(found.quats, rotation.inverse(true))


def published(found: Estimate) -> Iterator[dict[str, Any]]:
    """The poses as a daemon publishes them, as far as their errors go."""
    assert found.heading_sigma_deg is not None
    assert found.tilt_sigma_deg is not None
    sigmas = zip(found.heading_sigma_deg, found.tilt_sigma_deg, strict=True)
    for number, pair in enumerate(sigmas):
        heading, tilt = (float(s) if np.isfinite(s) else None for s in pair)
        yield {
            "number": number,
            "q": tuple(found.quats[number].tolist()),
            "t_device_us": round(float(found.times_s[number]) * 1e6),
            "t_ns": None,
            "heading_sigma_deg": heading,
            "tilt_sigma_deg": tilt,
            "flags": () if tilt is not None else ("starting",),
            "since_origin": None,
        }


def pairs_of(
    found: Estimate,
    truth: Motion,
    params: bytes,
    step_s: float,
    first_s: float = FIRST_S,
) -> Iterator[Pair]:
    """Each origin, `step_s` apart, with the poses at AFTER_S after it."""
    wrong = wrong_of(found, truth)
    references = References()
    references.tell(params)
    due: dict[int, list[tuple[str, int, float]]] = {}
    next_s = first_s
    for index, pose in enumerate(published(found)):
        references.on_pose(pose)
        for name, origin, after_s in due.pop(index, ()):
            since = references.since_capture(name)
            assert since is not None
            errors = apart(wrong[index], wrong[origin])
            yield Pair(
                after_s,
                *(errors[0], since.heading_sigma_deg),
                *(errors[1], since.tilt_sigma_deg),
            )
        time_s = float(found.times_s[index])
        if time_s >= next_s:
            next_s += step_s
            captured = references.capture()
            if captured is None:
                continue
            ends = np.searchsorted(found.times_s, time_s + np.array(AFTER_S))
            for after_s, end in zip(AFTER_S, ends.tolist(), strict=True):
                due.setdefault(end, []).append((captured, index, after_s))


def apart(wrong: FloatArray, before: FloatArray) -> tuple[float, float]:
    """Heading and tilt of the turn between two errors, seen from the earth; degrees."""
    w, x, y, z = rotation.multiply(wrong, rotation.inverse(before)).tolist()
    heading = 2.0 * np.arctan2(abs(z), abs(w))
    tilt = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z))
    return float(np.degrees(heading)), float(np.degrees(tilt))


def thinned(found: Estimate, every: int) -> Estimate:
    """Every so manieth pose, as at a lower rate."""
    assert found.heading_sigma_deg is not None
    assert found.tilt_sigma_deg is not None
    return Estimate(
        found.times_s[::every],
        found.quats[::every],
        found.tilt_sigma_deg[::every],
        found.heading_sigma_deg[::every],
    )


def measure(run: tuple[str, int], board: str, every: int) -> tuple[str, list[Pair]]:
    """All pairs of a motion with a seed."""
    name, seed = run
    motion = aiming.MOTIONS[name](seed)
    params = known_params()
    found = engines.ENGINES[HOST](sampled(motion, BOARDS[board].chip, params))
    step_s = (motion.seconds - FIRST_S) / ORIGINS
    return name, [*pairs_of(thinned(found, every), motion, params, step_s)]


def measure_recording(path: Path, board: str, every: int) -> tuple[str, list[Pair]]:
    """The same of a recording with optical truth, whose gyroscope is not calibrated."""
    motion = scoring.load_trial(path).motion
    found = engines.ENGINES[HOST](sampled(motion, BOARDS[board].chip, CALIBRATED))
    step_s = (motion.seconds - RECORDED_S) / ORIGINS
    pairs = pairs_of(thinned(found, every), motion, CALIBRATED, step_s, RECORDED_S)
    return RECORDED, [pair for pair in pairs if np.isfinite(pair.heading)]


def stated(errors: Sequence[float], sigmas: Sequence[float | None]) -> Stated:
    """The quality of these sigmas for these errors."""
    known = [(e, s) for e, s in zip(errors, sigmas, strict=True) if s is not None]
    error, sigma = np.array(known).reshape(-1, 2).T
    return Stated(
        len(errors),
        1.0 - len(known) / max(1, len(errors)),
        float(np.sqrt(np.mean(sigma**2))),
        float(np.sqrt(np.mean(error**2))),
        float(np.mean(error <= SIGMAS * sigma)),
    )


def lines_of(found: Sequence[tuple[str, list[Pair]]]) -> Iterator[Line]:
    for name, after_s in product((*aiming.MOTIONS, RECORDED), AFTER_S):
        pairs = [p for n, all_ in found if n == name for p in all_]
        mine = [pair for pair in pairs if pair.after_s == after_s]
        if mine:
            yield Line(
                name,
                after_s,
                stated([p.heading for p in mine], [p.heading_sigma for p in mine]),
                stated([p.tilt for p in mine], [p.tilt_sigma for p in mine]),
            )


def figures(lines: Sequence[Line]) -> Iterator[Figure]:
    """The limits of the lines; degrees and shares in percent."""
    two = {(e.motion, e.after_s): 2.0 * e.heading.sigma for e in lines}
    inside = [min(e.heading.inside, e.tilt.inside) for e in lines]
    yield degrees("still, two sigma after 120 s", two["still", 120.0], 0.3, 0.2)
    yield degrees("aim, two sigma after 30 s", two["aim", 30.0], 1.1, 0.8)
    yield Figure(
        "inside the stated 95 %, least of all lines, %",
        100.0 * min(inside),
        must=(93.0, 100.0),
        goal=(95.0, 100.0),
    )


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", choices=SETS, default="judging")
    parser.add_argument("--motions", nargs="+", default=[*aiming.MOTIONS])
    parser.add_argument(
        "--recordings",
        metavar="PATH",
        nargs="*",
        type=Path,
        help="recordings or folders of them instead (default: ../shared/data/broad)",
    )
    parser.add_argument("--board", choices=BOARDS, default=NANO.name)
    parser.add_argument("--seeds", metavar="N", type=int, default=SEEDS)
    parser.add_argument("--quick", action="store_true", help="3 seeds")
    parser.add_argument(
        "--every", metavar="N", type=int, default=1, help="use one pose in N"
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="at a time")
    parser.add_argument("--output", metavar="FILE", type=Path)
    args = parser.parse_args(argv)
    args.seeds = 3 if args.quick else args.seeds
    return args


def output_of(args: argparse.Namespace) -> Path:
    """Where the results go, unless --output says."""
    board = "" if args.board == NANO.name else f"-{args.board}"
    on = "" if args.recordings is None else "-recordings"
    output: Path = args.output or RESULTS / f"honesty-since-origin{on}{board}.json"
    return output


def main(argv: Sequence[str] | None = None) -> int:
    args = parse(argv)
    how = {"board": args.board, "every": args.every}
    with ProcessPoolExecutor(args.jobs) as pool:
        if args.recordings is not None:
            paths = scoring.find_trials(args.recordings or [RECORDINGS])
            found = [*pool.map(partial(measure_recording, **how), paths)]
        else:
            seeds = range(SETS[args.set], 2 * args.seeds, 2)
            runs = product(args.motions, seeds)
            found = [*pool.map(partial(measure, **how), runs)]
    lines = [*lines_of(found)]
    print(
        f"{'':6}{'after':>7}{'heading: stated':>17}{'true':>7}{'inside':>8}{'null':>6}"
        f"{'tilt: stated':>14}{'true':>7}{'inside':>8}{'null':>6}"
    )
    for line in lines:
        parts = (
            f"{each.sigma:{width}.3f}{each.true:7.3f}{100.0 * each.inside:6.1f} %"
            f"{100.0 * each.withheld:4.0f} %"
            for each, width in ((line.heading, 17), (line.tilt, 14))
        )
        print(f"{line.motion:6}{line.after_s:5.0f} s", *parts, sep="")
    output = output_of(args)
    asked = {"set": args.set, "every": args.every, "runs": len(found)}
    document = asked | {"lines": [asdict(line) for line in lines]}
    write_results(output, document)
    if args.recordings is not None or {*args.motions} != {*aiming.MOTIONS}:
        return 0
    judged = [*figures(lines)]
    report.print_figures(judged, is_judged=True)
    return int(any(each.verdict == "MISSED" for each in judged))


if __name__ == "__main__":
    sys.exit(main())
