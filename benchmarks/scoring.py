# SPDX-License-Identifier: MIT
"""How far an orientation is from the truth, as BROAD scores it.

D. Laidig, M. Caruso, A. Cereatti, T. Seel, "BROAD - A Benchmark for Robust Inertial
Orientation Estimation", Data 6(7):72, 2021, doi:10.3390/data6070072.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imud import motion, rotation
from imud.motion import Motion
from imud.rotation import FloatArray

PROJECT = Path(__file__).resolve().parents[1]
RECORDINGS = PROJECT.parent / "shared" / "data" / "broad"

# Which trials a line of the summary averages. Trials 32, 34 and 36 carry a magnet on
# the sensor itself and count among the disturbed ones, too.
GROUPS = {
    "undisturbed": "undisturbed",
    "disturbed": "disturbed",
    "attached magnet": "attached_magnet",
}


@dataclass(frozen=True, slots=True)
class Trial:
    """A recording with optical truth."""

    path: Path
    motion: Motion
    groups: tuple[str, ...]

    @property
    def name(self) -> str:
        return self.path.stem


@dataclass(frozen=True, slots=True)
class Score:
    """Root mean square error over a trial's movement, degrees."""

    total: float
    heading: float
    inclination: float

    def __str__(self) -> str:
        return f"{self.total:6.2f} {self.heading:6.2f} {self.inclination:6.2f}"

    @staticmethod
    def mean(scores: Sequence[Score]) -> Score:
        """The plain mean over trials, whatever their lengths."""
        rows = [(score.total, score.heading, score.inclination) for score in scores]
        return Score(*np.mean(rows, axis=0).tolist())


@dataclass(frozen=True, slots=True)
class Errors:
    """The angles between estimate and truth over time, degrees; NaN without truth."""

    total: FloatArray
    heading: FloatArray
    inclination: FloatArray


def load_trials(paths: Iterable[Path], numbers: Sequence[str] = ()) -> list[Trial]:
    """Reads trials from files and folders; `numbers` picks by how a name begins."""
    files: list[Path] = []
    for path in paths:
        files += sorted(path.glob("*.npz")) if path.is_dir() else [path]
    return [
        Trial(path, motion.load(path), _groups(path))
        for path in files
        if not numbers or path.stem.startswith(tuple(numbers))
    ]


def _groups(path: Path) -> tuple[str, ...]:
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
    )


def errors_at(times_s: FloatArray, estimate: FloatArray, truth: Motion) -> Errors:
    """Errors of estimates at any times of a recording that starts at 0 s."""
    if truth.quat is None:
        raise ValueError("this motion has no orientation to compare with")
    known_times = np.arange(len(truth)) / truth.rate_hz
    return errors(estimate, rotation.interpolate(times_s, known_times, truth.quat))


def score_at(times_s: FloatArray, estimate: FloatArray, truth: Motion) -> Score:
    """Scores estimates at any times; counts those next to a moving record."""
    nearest = np.rint(times_s * truth.rate_hz).astype(int)
    is_inside = (nearest >= 0) & (nearest < len(truth))
    moving = np.ones(len(truth), bool) if truth.movement is None else truth.movement
    counted = is_inside & moving[np.clip(nearest, 0, len(truth) - 1)]
    found = errors_at(times_s[counted], estimate[counted], truth)
    return Score(
        *(
            float(np.sqrt(np.nanmean(angle**2)))
            for angle in (found.total, found.heading, found.inclination)
        )
    )
