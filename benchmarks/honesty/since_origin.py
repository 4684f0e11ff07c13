# SPDX-License-Identifier: MIT
"""Whether the errors that poses state since an origin are true, and inform: of a probe
that lies still, and of one that a hand aims with.

Every few seconds of a simulated motion is an origin (or of a recording, with
--recordings). At some times after each the change of the true error is compared with
the stated one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.common import engines, scoring
from benchmarks.common.boards import BOARDS
from benchmarks.common.engines import HOST, Estimate
from benchmarks.common.feed import sampled
from benchmarks.common.paths import RECORDINGS
from benchmarks.common.scoring import SIGMAS
from benchmarks.harness import Figure, Report, Table, degrees
from imud import rotation
from imud.params.trusted import CALIBRATED, known_to
from imud.params.value import Params
from imud.probes.references import References
from imud.rotation import FloatArray
from imud.virtual.motion import Motion
from imud.virtual.motions import aiming

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
class Paired:
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
    heading: Paired
    tilt: Paired


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
    for number, pair in enumerate(zip(*found.sigmas_deg, strict=True)):
        tilt, heading = (float(s) if np.isfinite(s) else None for s in pair)
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
            # What is wrong alike at both ends is no error since the origin.
            errors = scoring.errors(wrong[index], wrong[origin])
            yield Pair(
                after_s,
                *(float(errors.heading), since.heading_sigma_deg),
                *(float(errors.inclination), since.tilt_sigma_deg),
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


def measure(run: tuple[str, int], board: str) -> tuple[str, list[Pair]]:
    """All pairs of a motion with a seed."""
    name, seed = run
    motion = aiming.MOTIONS[name](seed)
    params = known_params()
    found = engines.ENGINES[HOST](sampled(motion, BOARDS[board].chip, params))
    step_s = (motion.seconds - FIRST_S) / ORIGINS
    return name, [*pairs_of(found, motion, params, step_s)]


def measure_recording(path: Path, board: str) -> tuple[str, list[Pair]]:
    """The same of a recording with optical truth, whose gyroscope is not calibrated."""
    motion = scoring.load_trial(path).motion
    found = engines.ENGINES[HOST](sampled(motion, BOARDS[board].chip, CALIBRATED))
    step_s = (motion.seconds - RECORDED_S) / ORIGINS
    pairs = pairs_of(found, motion, CALIBRATED, step_s, RECORDED_S)
    return RECORDED, [pair for pair in pairs if np.isfinite(pair.heading)]


def stated(errors: Sequence[float], sigmas: Sequence[float | None]) -> Paired:
    """The quality of these sigmas for these errors."""
    known = [(e, s) for e, s in zip(errors, sigmas, strict=True) if s is not None]
    error, sigma = np.array(known).reshape(-1, 2).T
    return Paired(
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
        *(100.0 * min(inside), (93.0, 100.0), (95.0, 100.0)),
    )


COLUMNS = {
    "motion": ("motion", ""),
    "after, s": ("after", ".0f"),
    "heading: stated": ("heading sigma", ".3f"),
    "true": ("heading true", ".3f"),
    "inside, %": ("heading inside", ".0f"),
    "tilt: stated": ("tilt sigma", ".3f"),
    "tilt: true": ("tilt true", ".3f"),
    "tilt: inside, %": ("tilt inside", ".0f"),
}


def row_of(line: Line) -> dict[str, Any]:
    """As COLUMNS name it."""
    row: dict[str, Any] = {"motion": line.motion, "after": line.after_s}
    for kind, each in (("heading", line.heading), ("tilt", line.tilt)):
        row[f"{kind} sigma"], row[f"{kind} true"] = each.sigma, each.true
        row[f"{kind} inside"] = 100.0 * each.inside
    return row


def measured(args: argparse.Namespace) -> Report:
    """Of simulated motions or of recordings, for which no figure is required."""
    if args.recordings:
        task = partial(measure_recording, board=args.board)
        paths = scoring.find_trials([RECORDINGS])
        found = [*harness.each(task, paths, args.jobs, "recordings")]
    else:
        runs = [*product(args.groups, harness.seeds_of(args))]
        task = partial(measure, board=args.board)
        found = [*harness.each(task, runs, args.jobs, "motions")]
    lines = [*lines_of(found)]
    is_judged = {each.motion for each in lines} >= {*aiming.MOTIONS}
    judged = [*figures(lines)] if is_judged else []
    return Report([Table.of("lines", COLUMNS, map(row_of, lines))], judged)


def more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--recordings", action="store_true", help="../shared/data/broad instead"
    )


main = partial(
    harness.run,
    *("since-origin", __doc__, measured),
    harness.options(seeds=16, groups=aiming.MOTIONS, boards=BOARDS, jobs=2, more=more),
    variants=["recordings", "board"],
)
