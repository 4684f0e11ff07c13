# SPDX-License-Identifier: MIT
"""`imud audit`: how good the poses of a log were that were computed on line, by those
that are estimated afterwards.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from imud import rotation
from imud.errors import FileError
from imud.recordings import audit_page
from imud.recordings.raw_samples import CAUSES
from imud.recordings.refining import How, Refined, all_refined
from imud.recordings.source import beside
from imud.refine.model import BoolArray
from imud.refine.rests import stretches
from imud.rotation import FloatArray

UNSEEN = (
    "What it can't see: a tilt that is always the same, and where north is: both "
    "estimates share the sensor and its room."
)
INSIDE = 1.96  # sigmas, of 95 %
UP, X = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Reference:
    """What a person knows beside the log, in degrees clockwise seen from above."""

    turn: float | None = None  # from its first rest to its last one
    bearing: float | None = None  # of the body's x axis at its first rest, from north


@dataclass(frozen=True, slots=True)
class Shares:
    """Of some poses: rms differences in degrees, NaN where nothing is known, and the
    share of them inside the stated 95 %.
    """

    name: str
    count: int
    tilt: float
    tilt_inside: float
    heading: float
    heading_inside: float


@dataclass(frozen=True)
class Audit:
    """Differences of on-line poses from the refined ones, in degrees."""

    probe: str
    time_s: FloatArray  # (m,), since its first sample
    tilt: FloatArray
    heading: FloatArray  # clockwise
    tilt_sigma: FloatArray  # as stated on line, and the refined one's beside it
    heading_sigma: FloatArray
    tilt_own: FloatArray  # of the refined poses alone
    heading_own: FloatArray
    cause: FloatArray  # index of CAUSES
    doubts: tuple[str, ...]

    @cached_property
    def all(self) -> Shares:
        return self._shares("all", np.ones(len(self.time_s), bool))

    def by_minute(self) -> Iterator[Shares]:
        minute = (self.time_s // 60.0).astype(int)
        for each in np.unique(minute).tolist():
            yield self._shares(f"minute {each + 1}", minute == each)

    def by_cause(self) -> Iterator[Shares]:
        for index, name in enumerate(CAUSES):
            if (chosen := self.cause == index).any():
                yield self._shares(name, chosen)

    def _shares(self, name: str, chosen: BoolArray) -> Shares:
        tilt, heading = self.tilt[chosen], self.heading[chosen]
        return Shares(
            name,
            int(chosen.sum()),
            _rms(tilt),
            _inside(tilt, np.hypot(self.tilt_sigma, self.tilt_own)[chosen]),
            _rms(heading),
            _inside(heading, np.hypot(self.heading_sigma, self.heading_own)[chosen]),
        )

    def lines(self) -> Iterator[str]:
        found = self.all
        yield (
            f"{self.probe}: {found.count} poses; tilt off by {_deg(found.tilt)}, "
            f"{_share(found.tilt_inside)} inside its stated 95 %; heading off by "
            f"{_deg(found.heading)}, {_share(found.heading_inside)} inside"
        )
        yield from (f"  {words}" for words in self.doubts)


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt((known**2).mean())) if len(known) else math.nan


def _inside(values: FloatArray, sigmas: FloatArray) -> float:
    known = np.isfinite(values) & np.isfinite(sigmas)
    if not known.any():
        return math.nan
    return float((np.abs(values[known]) < INSIDE * sigmas[known]).mean())


def _deg(value: float) -> str:
    return "an unknown angle" if math.isnan(value) else f"{value:.2f} deg"


def _share(value: float) -> str:
    return "none" if math.isnan(value) else f"{value:.0%}"


def audit_of(found: Refined) -> Audit | None:
    """None where it has no pose that refers to the world."""
    times_us, rows = found.stretch.online()
    t_us = np.asarray(found.stretch.t_us)
    poses, quats = found.poses, found.poses.quats
    at = np.minimum(np.searchsorted(t_us, times_us), len(t_us) - 1)
    is_used = (t_us[at] == times_us) & (at < len(quats)) & (rows[:, 6] == 0.0)
    if not is_used.any():
        return None
    at, rows = at[is_used], rows[is_used]
    tilt, heading = differences(rows[:, :4], quats[at])
    tilt_own, heading_own = poses.tilt_deg[at], poses.heading_deg[at]
    heading[~np.isfinite(rows[:, 5])] = np.nan
    return Audit(
        found.stretch.probe,
        (t_us[at] - t_us[0]) * 1e-6,
        tilt,
        heading,
        rows[:, 4],
        rows[:, 5],
        tilt_own,
        heading_own,
        rows[:, 7],
        tuple(doubt.words for doubt in poses.doubts),
    )


def differences(quats: FloatArray, others: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angles between their verticals, and turns about the vertical from the others,
    clockwise seen from above: degrees.
    """
    off = rotation.multiply(quats, rotation.inverse(others))
    w, x, y, z = off.T
    tilt = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(w, z))
    heading = -2.0 * np.arctan2(z, w)
    wrapped = (heading + math.pi) % (2.0 * math.pi) - math.pi
    return np.degrees(tilt), np.degrees(wrapped)


def referred(found: Refined, known: Reference) -> Iterator[str]:
    """What a person's reference says of the poses."""
    quats, rests = found.poses.quats, stretches(found.poses.is_rest)
    if known == Reference():
        return
    if not rests:
        yield "  no rest in it: nothing to compare the reference with"
        return
    times_us, rows = found.stretch.online()
    t_us = np.asarray(found.stretch.t_us)
    both = [sum(rests[at]) // 2 for at in (0, -1)]
    pairs = {"refined": quats[both]}
    if len(times_us):
        nearest = [int(np.argmin(np.abs(times_us - t_us[at]))) for at in both]
        pairs["on line"] = rows[nearest, :4]
    for name, (begin, end) in pairs.items():
        if known.turn is not None:
            _, turned = differences(end[None], begin[None])
            off = (float(turned[0]) - known.turn + 180.0) % 360.0 - 180.0
            yield f"  {name}: turned by {turned[0]:.2f} deg, off by {off:+.2f} deg"
        if known.bearing is not None:
            east, north, _ = rotation.rotate(begin, X).tolist()
            now = math.degrees(math.atan2(east, north))
            off = (now - known.bearing + 180.0) % 360.0 - 180.0
            yield f"  {name}: points to {now % 360.0:.2f} deg, off by {off:+.2f} deg"


def run(path: Path, source: Path, to: Path | None, how: How, known: Reference) -> int:
    """Writes the page and says what was found; 0. FileError where it can't."""
    to = beside(source, to, "-audit.html")
    if os.path.lexists(to) and not audit_page.is_page(to):
        raise FileError(f"{to} is no page of imud audit; choose another file with --to")
    found, damage = all_refined(path, how)
    audits = [audit_of(each) for each in found]
    compared = [each for each in audits if each is not None]
    sys.stdout.write(f"{UNSEEN}\n")
    for each, audit in zip(found, audits, strict=True):
        if audit is not None:
            sys.stdout.writelines(f"{line}\n" for line in audit.lines())
        sys.stdout.writelines(f"{line}\n" for line in referred(each, known))
    if not compared:
        raise FileError(
            f"{path} has no poses to the world's axes: without an origin, from the "
            "probe itself"
        )
    try:
        to.write_text(audit_page.page_of(source.name, UNSEEN, compared), "utf-8")
    except OSError as error:
        raise FileError(f"can't write {to}: {error.strerror}") from error
    sys.stdout.write(f"{to}: open it in a browser\n")
    if words := damage.words():
        raise FileError(f"{path} is {words}")
    return 0
