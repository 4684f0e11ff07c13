# SPDX-License-Identifier: MIT
"""Our filter beside VQF on simulated recordings, group by group."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from benchmarks.common import engines, scoring
from benchmarks.common.boards import BOARDS
from benchmarks.common.engines import HOST, VQF, Estimate
from benchmarks.common.feed import sampled
from benchmarks.common.scoring import Coverage, Score
from imud.virtual.motion import Motion

NAMES = (HOST, VQF)  # the engines that are compared

# A recording is worse if both hold: our error over VQF's, and our error less VQF's.
WORSE_RATIO, WORSE_DEG = 1.2, 0.5
KINDS = ("heading", "inclination")

Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class Outcome:
    """The errors of the engines on one recording; ours is HOST."""

    group: str
    seed: int
    scores: Mapping[str, Score]
    coverage: Coverage
    first: Coverage | None = None  # of the first seconds of motion

    def __str__(self) -> str:
        return f"{self.group} {self.seed}"

    def with_first(self, first: Coverage) -> Outcome:
        return replace(self, first=first)

    @property
    def is_worse(self) -> bool:
        """Whether our heading or inclination is clearly worse than VQF's."""
        return any(
            mine > WORSE_RATIO * other and mine > other + WORSE_DEG
            for mine, other in (pair_of(self.scores, kind) for kind in KINDS)
        )


def pair_of(scores: Mapping[str, Score], kind: str) -> tuple[float, float]:
    """Our error, and VQF's."""
    return getattr(scores[HOST], kind), getattr(scores[VQF], kind)


def compared(motion: Motion, board: str, params: bytes) -> dict[str, Estimate]:
    """The poses of each engine for a motion as a board with these params samples it."""
    feed = sampled(motion, BOARDS[board].chip, params)
    return {name: engines.ENGINES[name](feed) for name in NAMES}


def outcome_of(
    group: str, seed: int, motion: Motion, found: Mapping[str, Estimate]
) -> Outcome:
    scores = {
        name: scoring.score_at(each.times_s, each.quats, motion)
        for name, each in found.items()
    }
    return Outcome(group, seed, scores, scoring.coverage_at(found[HOST], motion))


@dataclass(frozen=True, slots=True)
class Summary:
    """Means over the recordings of a group."""

    count: int
    scores: Mapping[str, Score]
    coverage: Coverage
    worse: float  # the share of recordings
    tilt_stated: float  # median stated sigma / true rms
    heading_stated: float

    @staticmethod
    def of(outcomes: Sequence[Outcome]) -> Summary:
        scores = Score.means([each.scores for each in outcomes])
        coverage = Coverage.mean([each.coverage for each in outcomes])
        return Summary(
            len(outcomes),
            scores,
            coverage,
            float(np.mean([each.is_worse for each in outcomes])),
            coverage.tilt_sigma_deg / scores[HOST].inclination,
            coverage.heading_sigma_deg / scores[HOST].heading,
        )

    def ratio(self, kind: str) -> float:
        """Our error divided by VQF's."""
        mine, other = pair_of(self.scores, kind)
        return mine / other

    def row(self, name: str) -> dict[str, Any]:
        """As COLUMNS name it."""
        pairs = {kind: pair_of(self.scores, kind) for kind in KINDS}
        tilt, heading = 100.0 * self.coverage.tilt, 100.0 * self.coverage.heading
        return {
            kind: f"{mine:.2f} / {other:.2f} = {mine / other:.2f}"
            for kind, (mine, other) in pairs.items()
        } | {
            "group": name,
            "count": self.count,
            "varying": f"{self.scores[HOST].varying:.2f}",
            "worse": 100.0 * self.worse,
            "tilt in": f"{tilt:.0f}, {self.tilt_stated:.2f}",
            "heading in": f"{heading:.0f}, {self.heading_stated:.2f}",
            "withheld": 100.0 * self.coverage.heading_null,
        }


COLUMNS = {
    "group": ("group", ""),
    "recordings": ("count", "d"),
    "heading, ours / VQF": ("heading", ""),
    "ours, less its mean": ("varying", ""),
    "inclination, ours / VQF": ("inclination", ""),
    "worse, %": ("worse", ".0f"),
    "tilt in %, sigma/rms": ("tilt in", ""),
    "heading in %, sigma/rms": ("heading in", ""),
    "heading withheld, %": ("withheld", ".1f"),
}


def grouped(items: Iterable[Item], key: Callable[[Item], str]) -> dict[str, list[Item]]:
    """The items of each key, in the order in which they come."""
    found: dict[str, list[Item]] = {}
    for item in items:
        found.setdefault(key(item), []).append(item)
    return found


def worst_of(shares: Mapping[str, float]) -> tuple[float, str]:
    """The least share in percent, and whose it is."""
    name = min(shares, key=lambda each: shares[each])
    return 100.0 * shares[name], name
