# SPDX-License-Identifier: MIT
"""The main filter in doubles over a trial's samples, with any parameters.

tests/core/fuse_twin.c, whose parameters by default are the firmware's constants, behind
the calibration at rest that the firmware starts with.
"""

from __future__ import annotations

import argparse
import ctypes
import functools
import hashlib
import math
import multiprocessing
import os
import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt
import scoring
from engines import Estimate, vqf_defaults
from feed import Feed, Samples, sampled, with_bias
from scoring import Score, Trial

from imud import rotation
from imud.progress import Progress
from imud.rotation import FloatArray

Params = Mapping[str, float]
# As recorded, and the mean over the directions of a magnet, if any was there.
Pair = tuple[Score, Score | None]
IntArray = npt.NDArray[np.intp]

SOURCE = scoring.PROJECT / "tests" / "core" / "fuse_twin.c"
HEADER = SOURCE.with_suffix(".h")
BUILD = scoring.PROJECT / "build" / "benchmarks"
# No contraction to fused products: the same figures on every machine.
COMPILE = ("gcc", "-std=gnu11", "-O2", "-ffp-contract=off", "-fPIC", "-shared")

GYR_DELAY_S = 3.9e-3  # that the firmware has its MPU-9250 set to
CALIBRATION = 512  # samples: CALIBRATOR_SAMPLES of firmware/core/fusion/calibrate.h
STARTING_S = 3.0  # in which no error is stated
FREE_DEG = 30.0  # a heading of a larger error is free, and states none

# A magnet on the probe: accuracy.py's, along four of its diagonals, whose mean is zero.
BODY_BIAS_UT = 2.8
DIRECTIONS = np.array(
    [(1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0)]
) / math.sqrt(3.0)

# Of struct fuse_twin_params, in its order.
NAMES: tuple[str, ...] = tuple(
    re.findall(r"^ {4}double (\w+);", HEADER.read_text(), re.MULTILINE)
)


class _Params(ctypes.Structure):
    """The same struct."""

    _fields_: ClassVar = [(name, ctypes.c_double) for name in NAMES]


@functools.cache
def library() -> ctypes.CDLL:
    """The twin, compiled once for each content."""
    content = SOURCE.read_bytes() + HEADER.read_bytes()
    digest = hashlib.sha256(content).hexdigest()[:16]
    target = BUILD / f"fuse_twin_{digest}.so"
    if not target.exists():
        BUILD.mkdir(parents=True, exist_ok=True)
        made = target.with_suffix(f".{os.getpid()}")
        subprocess.run([*COMPILE, SOURCE, "-lm", "-o", made], check=True)
        made.replace(target)
    found = ctypes.CDLL(str(target))
    found.fuse_twin_run.restype = found.fuse_twin_defaults.restype = None
    return found


def defaults() -> dict[str, float]:
    """The firmware's constants."""
    params = _Params()
    library().fuse_twin_defaults(ctypes.byref(params))
    return {name: getattr(params, name) for name in NAMES}


@dataclass(frozen=True, slots=True)
class Track:
    """What the filter says after each sample."""

    quats: FloatArray  # world_from_body
    sigmas_deg: FloatArray  # rows of tilt and heading; NaN where none is stated


def run(
    samples: Samples, times_s: FloatArray, params: Params, *, is_calibrated: bool = True
) -> Track:
    """Runs it; without calibration it finds the gyroscope's bias in what follows."""
    gyr, acc, mag = (
        np.ascontiguousarray(rows, float)
        for rows in (samples.gyr, samples.acc, samples.mag)
    )
    has_mag = np.ascontiguousarray(samples.has_mag)
    interval_s = np.diff(times_s, prepend=times_s[0] - 1.0 / samples.rate_hz)
    bias = gyr[:CALIBRATION].mean(axis=0)
    # It is set before the step of the last of its samples.
    calibrated_at = CALIBRATION - 1 if is_calibrated else -1
    quats, sigmas_deg = np.empty((len(gyr), 4)), np.empty((len(gyr), 2))
    pointers = [ctypes.c_void_p(rows.ctypes.data) for rows in (gyr, acc, mag, has_mag)]
    library().fuse_twin_run(
        ctypes.byref(_Params(**params)),
        len(gyr),
        round(samples.rate_hz),
        ctypes.c_double(GYR_DELAY_S),
        *pointers,
        ctypes.c_void_p(interval_s.ctypes.data),
        calibrated_at,
        ctypes.c_void_p(bias.ctypes.data),
        ctypes.c_void_p(quats.ctypes.data),
        ctypes.c_void_p(sigmas_deg.ctypes.data),
    )
    # From the last sample of that time on.
    sigmas_deg[: round(STARTING_S * samples.rate_hz) - 1] = np.nan
    sigmas_deg[sigmas_deg[:, 1] > FREE_DEG, 1] = np.nan
    return Track(quats, sigmas_deg)


def estimate(feed: Feed, params: Params) -> Estimate:
    """At the poses that a probe would have sent."""
    track = run(feed.samples, feed.times_s, params)
    at = np.asarray(feed.pose_after)
    tilt, heading = track.sigmas_deg[at].T
    return Estimate(feed.pose_times_s, track.quats[at], tilt, heading)


@dataclass(frozen=True)
class Course:
    """A trial made ready to be run many times: samples, and the truth at the poses.

    Beside the samples as they are, the same with a magnet on the probe, in each of some
    directions; and what VQF at its defaults makes of both.
    """

    trial: Trial  # its motion cut down to nothing
    times_s: FloatArray
    samples: Samples
    biased: tuple[Samples, ...]
    is_calibrated: bool
    scored: IntArray  # indexes of the samples whose poses count
    truth: FloatArray  # there
    vqf: Pair

    def track(self, params: Params, samples: Samples) -> Track:
        """What the filter says at the samples that count."""
        whole = run(samples, self.times_s, params, is_calibrated=self.is_calibrated)
        return Track(whole.quats[self.scored], whole.sigmas_deg[self.scored])

    def score(self, params: Params) -> Pair:
        plain, *biased = (
            judge(self.track(params, each).quats, self.truth)
            for each in (self.samples, *self.biased)
        )
        return paired(plain, biased)


def course(
    trial: Trial,
    feed: Feed,
    biased: Sequence[Feed] = (),
    *,
    is_calibrated: bool = True,
    after_s: float = 0.0,
) -> Course:
    """A trial and its samples; poses before `after_s` don't count."""
    at = np.asarray(feed.pose_after)
    times_s = feed.times_s[at]
    is_scored = scoring.counted(times_s, trial.motion) & (times_s >= after_s)
    scored, times_s = at[is_scored], times_s[is_scored]
    assert trial.motion.quat is not None
    known_s = np.arange(len(trial.motion)) / trial.motion.rate_hz
    truth = rotation.interpolate(times_s, known_s, trial.motion.quat)
    plain_vqf, *biased_vqf = (
        judge(vqf_defaults(each).quats[scored], truth) for each in (feed, *biased)
    )
    return Course(
        replace(trial, motion=trial.motion[:0]),
        feed.times_s,
        feed.samples,
        # What a magnet doesn't change is there once.
        tuple(replace(feed.samples, mag=each.samples.mag) for each in biased),
        is_calibrated,
        scored,
        truth,
        paired(plain_vqf, biased_vqf),
    )


def paired(plain: Score, biased: Sequence[Score]) -> Pair:
    return plain, Score.mean(biased) if biased else None


def judge(quats: FloatArray, truth: FloatArray) -> Score:
    """As scoring.score_at, which interpolates the truth each time."""
    found = scoring.errors(quats, truth)
    return Score(
        *(
            float(np.sqrt(np.nanmean(angle**2)))
            for angle in (found.total, found.heading, found.inclination)
        )
    )


def load(path: Path) -> Course:
    """A recording as accuracy.py --host-only has it, and with magnets on the probe."""
    trial = scoring.load_trial(path)
    biased = [
        sampled(with_bias(trial.motion, BODY_BIAS_UT * each)) for each in DIRECTIONS
    ]
    return course(trial, sampled(trial.motion), biased)


def load_all(
    paths: Sequence[Path], how: Callable[[Path], Course], jobs: int
) -> list[Course]:
    """Some at a time, in processes: VQF is called from Python for each sample."""
    progress = Progress(f"{len(paths)} recordings", len(paths))
    found = []
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context) as pool:
        for each in pool.map(how, paths):
            found.append(each)
            progress.advance()
    progress.end()
    return found


def add_arguments(parser: argparse.ArgumentParser, output: Path) -> None:
    """Which recordings, and where the JSON goes."""
    scoring.add_arguments(parser)
    parser.add_argument("--output", metavar="FILE", type=Path, default=output)


def find(args: argparse.Namespace) -> list[Path]:
    """The recordings asked for; where they are absent none, and a line that says so."""
    absent = [path for path in args.paths if not path.exists()]
    if absent:
        print(f"skipped: no recordings at {absent[0]}; docs/motion-files.md says where")
        return []
    paths = scoring.find_trials(args.paths, args.trials)
    if not paths:
        print("no recording has such a name", file=sys.stderr)
        raise SystemExit(2)
    return paths
