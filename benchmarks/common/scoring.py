# SPDX-License-Identifier: MIT
"""The errors of orientations, scored as by BROAD.

D. Laidig, M. Caruso, A. Cereatti, T. Seel, "BROAD - A Benchmark for Robust Inertial
Orientation Estimation", Data 6(7):72, 2021, doi:10.3390/data6070072.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from benchmarks.common.engines import Estimate
from imud import rotation
from imud.rotation import FloatArray
from imud.virtual import motion
from imud.virtual.motion import BoolArray, Motion

# The trials behind each line of the summary. Trials 32, 34 and 36 have a magnet on the
# sensor itself and are also among the disturbed ones.
GROUPS = {
    "undisturbed": "undisturbed",
    "disturbed": "disturbed",
    "attached magnet": "attached_magnet",
}
TRIALS = 21  # public ones

SIGMAS = 1.96  # 95 % of normal errors fall inside


@dataclass(frozen=True, slots=True)
class Trial:
    """A recording with optical truth."""

    path: Path
    motion: Motion
    groups: tuple[str, ...]

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def is_public(self) -> bool:
        return "all_trials" in self.groups

    def is_in(self, name: str) -> bool:
        """Whether a group or "all" has it."""
        return name == "all" or GROUPS.get(name) in self.groups


@dataclass(frozen=True, slots=True)
class Score:
    """Root mean square error over a trial's movement, degrees."""

    total: float
    heading: float
    inclination: float
    varying: float = np.nan  # heading less its mean, as a zero of north is a convention

    def __str__(self) -> str:
        heading = f"{self.heading:.2f} ({self.varying:.2f})"
        return f"{self.total:.2f} / {heading} / {self.inclination:.2f}"

    @staticmethod
    def mean(scores: Sequence[Score]) -> Score:
        """The plain mean over trials, whatever their lengths."""
        rows = [astuple(score) for score in scores]
        return Score(*np.mean(rows, axis=0).tolist())

    @staticmethod
    def means(rows: Sequence[Mapping[str, Score]]) -> dict[str, Score]:
        """The mean over trials, engine by engine; empty without a trial."""
        names = rows[0] if rows else ()
        return {name: Score.mean([row[name] for row in rows]) for name in names}


@dataclass(frozen=True, slots=True)
class Coverage:
    """Shares of the poses in a trial's movement, 0 to 1.

    Of poses with a sigma, those with an error inside SIGMAS of it; of all poses, those
    without a sigma. Beside them the medians of the sigmas, degrees.
    """

    tilt: float
    heading: float
    tilt_null: float
    heading_null: float
    tilt_sigma_deg: float = np.nan
    heading_sigma_deg: float = np.nan

    @staticmethod
    def mean(coverages: Sequence[Coverage]) -> Coverage:
        """The plain mean over trials, those without any sigma left out."""
        rows = np.array([astuple(each) for each in coverages])
        known = np.isfinite(rows)
        sums = np.where(known, rows, 0.0).sum(axis=0)
        count = known.sum(axis=0)
        means = np.where(count > 0, sums / np.maximum(count, 1), np.nan)
        return Coverage(*means.tolist())


@dataclass(frozen=True, slots=True)
class Errors:
    """The angles between estimate and truth over time, degrees; NaN without truth."""

    total: FloatArray
    heading: FloatArray
    inclination: FloatArray
    turned: FloatArray  # the heading's, from -360 to 360


def find_trials(paths: Iterable[Path], numbers: Sequence[str] = ()) -> list[Path]:
    """Recordings among files and in folders, those whose names begin with `numbers`."""
    files: list[Path] = []
    for path in paths:
        files += sorted(path.glob("*.npz")) if path.is_dir() else [path]
    return [
        path for path in files if not numbers or path.stem.startswith(tuple(numbers))
    ]


def load_trial(path: Path) -> Trial:
    """Reads one recording."""
    return Trial(path, motion.load(path), groups_of(path))


def groups_of(path: Path) -> tuple[str, ...]:
    """The groups that a recording's file names."""
    if path.suffix != ".npz":
        return ()
    with np.load(path) as archive:
        return tuple(archive["groups"].tolist()) if "groups" in archive.files else ()


def errors(estimate: FloatArray, truth: FloatArray) -> Errors:
    """Splits each difference, seen from the earth, into heading and inclination."""
    w, x, y, z = rotation.multiply(estimate, rotation.inverse(truth)).T
    return Errors(
        # 2 acos|w|, 2 atan|z/w| and 2 acos sqrt(w^2 + z^2), in a form that keeps its
        # precision near zero and needs no clipping.
        total=np.degrees(2.0 * np.arctan2(np.hypot(np.hypot(x, y), z), np.abs(w))),
        heading=np.degrees(2.0 * np.arctan2(np.abs(z), np.abs(w))),
        inclination=np.degrees(2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z))),
        turned=np.degrees(2.0 * np.arctan2(z, w)),
    )


def errors_at(times_s: FloatArray, estimate: FloatArray, truth: Motion) -> Errors:
    """Errors of estimates at any times of a recording that starts at 0 s."""
    if truth.quat is None:
        raise ValueError("this motion has no orientation to compare with")
    known_times = np.arange(len(truth)) / truth.rate_hz
    return errors(estimate, rotation.interpolate(times_s, known_times, truth.quat))


def counted(times_s: FloatArray, truth: Motion) -> BoolArray:
    """Which times have a moving record next to them."""
    nearest = np.rint(times_s * truth.rate_hz).astype(int)
    is_inside = (nearest >= 0) & (nearest < len(truth))
    moving = np.ones(len(truth), bool) if truth.movement is None else truth.movement
    return np.asarray(is_inside & moving[np.clip(nearest, 0, len(truth) - 1)])


def score_at(times_s: FloatArray, estimate: FloatArray, truth: Motion) -> Score:
    """Scores estimates at any times; counts those next to a moving record."""
    moving = counted(times_s, truth)
    found = errors_at(times_s[moving], estimate[moving], truth)
    turned = np.exp(1j * np.radians(found.turned))
    varying = np.degrees(np.angle(turned / np.nanmean(turned)))
    return Score(
        *(
            float(np.sqrt(np.nanmean(angle**2)))
            for angle in (found.total, found.heading, found.inclination, varying)
        )
    )


def coverage_at(found: Estimate, truth: Motion) -> Coverage:
    """Shares of true errors inside the stated sigmas."""
    return coverage_where(counted(found.times_s, truth), found, truth)


def coverage_where(rows: BoolArray, found: Estimate, truth: Motion) -> Coverage:
    """The same of some of the poses."""
    tilt_sigma_deg, heading_sigma_deg = found.sigmas_deg
    errors = errors_at(found.times_s[rows], found.quats[rows], truth)
    return coverage_of(errors, tilt_sigma_deg[rows], heading_sigma_deg[rows])


def coverage_of(
    found: Errors, tilt_sigma_deg: FloatArray, heading_sigma_deg: FloatArray
) -> Coverage:
    """From the true errors at the poses that count; sigmas may be NaN, degrees."""
    is_seen = np.isfinite(found.total)
    shares, nulls, medians = [], [], []
    for error, sigma in (
        (found.inclination, tilt_sigma_deg),
        (found.heading, heading_sigma_deg),
    ):
        is_stated = is_seen & np.isfinite(sigma)
        inside = error[is_stated] <= SIGMAS * sigma[is_stated]
        has_any = is_stated.any()
        shares.append(float(inside.mean()) if has_any else np.nan)
        nulls.append(float(1.0 - is_stated.sum() / max(1, is_seen.sum())))
        medians.append(float(np.median(sigma[is_stated])) if has_any else np.nan)
    return Coverage(*shares, *nulls, *medians)
