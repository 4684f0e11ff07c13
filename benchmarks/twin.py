# SPDX-License-Identifier: MIT
"""The main filter in doubles over a trial's samples, with any parameters.

Runs tests/core/fuse_twin.c, whose default parameters are the firmware's constants,
after the firmware's calibration at rest.
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
from typing import ClassVar, TypeVar

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
# Scores as recorded, and the mean over the directions of a magnet, if there is one.
Pair = tuple[Score, Score | None]
T = TypeVar("T")
IntArray = npt.NDArray[np.intp]

FOLDER = scoring.PROJECT / "tests" / "core"
HEADER = FOLDER / "fuse_twin.h"
SOURCES = sorted(FOLDER.glob("fuse_twin*.c"))
BUILD = scoring.PROJECT / "build" / "benchmarks"
# No fused multiply-add, so that every machine gives the same figures.
COMPILE = ("gcc", "-std=gnu11", "-O2", "-ffp-contract=off", "-fPIC", "-shared")

GYR_DELAY_S = 3.9e-3  # of the MPU-9250 as the firmware sets it up
CALIBRATION = 512  # samples: CALIBRATOR_SAMPLES of firmware/core/fusion/calibrate.h
STARTING_S = 3.0  # in which level settles

# A magnet on the probe: accuracy.py's, along four of its diagonals, whose mean is zero.
BODY_BIAS_UT = 2.8
DIRECTIONS = np.array(
    [(1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0)]
) / math.sqrt(3.0)

# The members of struct fuse_twin_params, in its order.
NAMES: tuple[str, ...] = tuple(
    re.findall(r"^ {4}double (\w+);", HEADER.read_text(), re.MULTILINE)
)


class _Params(ctypes.Structure):
    """struct fuse_twin_params."""

    _fields_: ClassVar = [(name, ctypes.c_double) for name in NAMES]


@functools.cache
def library() -> ctypes.CDLL:
    """The twin, compiled once for each content."""
    files = (*SOURCES, *sorted(FOLDER.glob("fuse_twin*.h")))
    content = b"".join(path.read_bytes() for path in files)
    digest = hashlib.sha256(content).hexdigest()[:16]
    target = BUILD / f"fuse_twin_{digest}.so"
    if not target.exists():
        BUILD.mkdir(parents=True, exist_ok=True)
        made = target.with_suffix(f".{os.getpid()}")
        subprocess.run([*COMPILE, *SOURCES, "-lm", "-o", made], check=True)
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
    """The filter's output after each sample."""

    quats: FloatArray  # world_from_body
    sigmas_deg: FloatArray  # (n, 2): tilt, heading; NaN where none is stated


def run(
    samples: Samples, times_s: FloatArray, params: Params, *, is_calibrated: bool = True
) -> Track:
    """Run the twin; without calibration it must find the gyroscope's bias by itself."""
    gyr, acc, mag = (
        np.ascontiguousarray(rows, float)
        for rows in (samples.gyr, samples.acc, samples.mag)
    )
    has_mag = np.ascontiguousarray(samples.has_mag)
    interval_s = np.diff(times_s, prepend=times_s[0] - 1.0 / samples.rate_hz)
    bias = gyr[:CALIBRATION].mean(axis=0)
    # The bias is set before the step of the calibration's last sample.
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
    return Track(quats, sigmas_deg)


def estimate(feed: Feed, params: Params) -> Estimate:
    """Run the twin; return its estimates at the poses that a probe would send."""
    track = run(feed.samples, feed.times_s, params)
    at = np.asarray(feed.pose_after)
    tilt, heading = track.sigmas_deg[at].T
    return Estimate(feed.pose_times_s, track.quats[at], tilt, heading)


@dataclass(frozen=True)
class Course:
    """A trial prepared for many runs: samples, and the truth at the poses.

    Has the samples as recorded and with a magnet on the probe in several directions,
    and the scores of VQF with default parameters on both.
    """

    trial: Trial  # its motion cut down to nothing
    times_s: FloatArray
    samples: Samples
    biased: tuple[Samples, ...]
    is_calibrated: bool
    scored: IntArray  # indexes of samples whose poses are scored
    truth: FloatArray  # at those samples, world_from_body
    vqf: Pair

    def track(self, params: Params, samples: Samples) -> Track:
        """The filter's output at the samples that are scored."""
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
    """Prepare a trial; poses before `after_s` are not scored."""
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
        # Arrays that the magnet does not change are shared.
        tuple(replace(feed.samples, mag=each.samples.mag) for each in biased),
        is_calibrated,
        scored,
        truth,
        paired(plain_vqf, biased_vqf),
    )


def paired(plain: Score, biased: Sequence[Score]) -> Pair:
    return plain, Score.mean(biased) if biased else None


def judge(quats: FloatArray, truth: FloatArray) -> Score:
    """Score as scoring.score_at does, without interpolating the truth each time."""
    found = scoring.errors(quats, truth)
    return Score(
        *(
            float(np.sqrt(np.nanmean(angle**2)))
            for angle in (found.total, found.heading, found.inclination)
        )
    )


def load(path: Path) -> Course:
    """Load a recording as accuracy.py --host-only does, also with magnets on it."""
    trial = scoring.load_trial(path)
    biased = [
        sampled(with_bias(trial.motion, BODY_BIAS_UT * each)) for each in DIRECTIONS
    ]
    return course(trial, sampled(trial.motion), biased)


def load_all(
    recordings: Sequence[T], how: Callable[[T], Course], jobs: int
) -> list[Course]:
    """Load recordings in several processes: VQF takes a Python call for each sample."""
    progress = Progress(f"{len(recordings)} recordings", len(recordings))
    found = []
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context) as pool:
        for each in pool.map(how, recordings):
            found.append(each)
            progress.advance()
    progress.end()
    return found


def add_arguments(parser: argparse.ArgumentParser, output: Path) -> None:
    """Options for the recordings and the JSON's path."""
    scoring.add_arguments(parser)
    parser.add_argument("--output", metavar="FILE", type=Path, default=output)


def find(args: argparse.Namespace) -> list[Path]:
    """The chosen recordings; if they are absent, prints that and returns none."""
    absent = [path for path in args.paths if not path.exists()]
    if absent:
        print(f"skipped: no recordings at {absent[0]}; docs/motion-files.md says where")
        return []
    paths = scoring.find_trials(args.paths, args.trials)
    if not paths:
        print("no recording has such a name", file=sys.stderr)
        raise SystemExit(2)
    return paths
