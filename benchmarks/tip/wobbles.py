# SPDX-License-Identifier: MIT
"""How well the tip is found by a wobble in a dimple: a simulated hand, and the guide.

docs/tip.md explains the columns.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.common import feed
from benchmarks.common.modules import module_of
from benchmarks.harness import SETS, Figure, Report, Table
from imud.calibration.algebra import units
from imud.calibration.faults import CalibrationFault
from imud.calibration.recording import Sample, Scale
from imud.calibration.tip import guide as tip_guide
from imud.calibration.tip.guide import Dimpling
from imud.calibration.tip.score import INSIDE
from imud.calibration.tip_found import TipFound
from imud.cli.calibrate_source import of_file
from imud.params.value import Params
from imud.progress import Progress
from imud.rotation import FloatArray
from imud.virtual.dimpling import DimplingHand, Wobble
from imud.virtual.motion import Motion
from imud.virtual.sensors import World

RECORDS_HZ = 500.0
CHIPS = {"nano": feed.MPU9250, "f405": feed.LSM9DS0}

ONE = np.eye(3).tolist()
# What the params say: the sigma of both sensors.
SIGMAS = {"calibrated": (0.0075, 0.0005), "gyroscope not": (0.0075, None), "raw": ()}

# It leans on something and is held for so long before; no guide waits longer.
USUAL = Wobble(still_s=2.0, pause_s=2.0, wobble_s=60.0)
IN_HAND = replace(USUAL, support="hand")
CHIPS_QUIET = ("MPU-9250", "LSM6DSOX", "LSM6DSV")
BEFORE_S = USUAL.still_s + USUAL.pause_s
LONGEST_S = BEFORE_S + tip_guide.LONGEST_S + 1.0
ENDED_S = BEFORE_S + 22.0  # hands of all kinds then press Enter
FIT_S = 8.0  # between two fits of the guide, which takes 1 s
BAD_M = 0.002


@dataclass(frozen=True, slots=True)
class Case:
    """What is measured, how often; without a wobble each run draws its own."""

    name: str
    runs: int
    wobble: Wobble | None = None
    module: str = "calibrated"
    chip: str = "BROAD"  # whose noise it has


CROWD = "of all kinds"
CASES = (
    *(
        Case(f"{deg} degrees", 25, replace(USUAL, swing_deg=float(deg)))
        for deg in (15, 20, 25, 30)
    ),
    Case(CROWD, 500),
    Case("slip of 0.5 mm", 10, replace(USUAL, slip_m=5e-4)),
    Case("base gives by 1 %", 10, replace(USUAL, give=0.01)),
    Case("base gives by 2 %", 10, replace(USUAL, give=0.02)),
    Case("base gives by 3 %", 10, replace(USUAL, give=0.03)),
    Case("gyroscope not calibrated", 10, USUAL, "gyroscope not"),
    Case("raw module", 10, USUAL, "raw"),
    # A hand that trembles as real ones in the air; the others rest on paper.
    *(
        Case(f"{deg} degrees, hand", 25, replace(IN_HAND, swing_deg=float(deg)))
        for deg in (20, 25)
    ),
    *(Case(f"25 degrees, {chip}", 25, USUAL, chip=chip) for chip in CHIPS_QUIET),
)
GOOD = tuple(case.name for case in CASES[:4])


@dataclass(frozen=True, slots=True)
class Run:
    """The result of a wobble. `error_mm`: None if it was refused."""

    kind: str  # "found", or why it was refused
    base: str  # firm, slips, soft
    error_mm: float | None = None
    score_mm: float | None = None  # 95 % are smaller
    seconds: float | None = None


def any_wobble(random: np.random.Generator) -> Wobble:
    """In half of the runs the tip stays, in a fifth it slips; in the others the base
    yields."""
    wobble = replace(
        USUAL,
        swing_deg=random.uniform(8.0, 35.0),
        hz=random.uniform(0.4, 1.3),
        twist_deg=random.uniform(0.0, 40.0),
        directions=1 if random.random() < 0.15 else 2,
        loss_deg=random.uniform(2.0, 20.0),
    )
    kind = random.random()
    if kind < 0.5:
        return wobble
    if kind < 0.7:
        return replace(wobble, slip_m=random.uniform(2e-4, 1.5e-3))
    return replace(wobble, give=random.uniform(0.005, 0.05))


def params_of(kind: str) -> Params:
    """The probe's params."""
    params = Params()
    none = {
        "bias_counts": (0.0, 0.0, 0.0),
        "matrix": ONE,
        "method": "guided",
    }
    names = (("acc", "sigma_m_s2"), ("gyr", "sigma"))
    for (name, key), sigma in zip(names, SIGMAS[kind], strict=False):
        params = params.replaced(name, {**none, key: sigma})
    return params


def motion_of(
    case: Case, seed: int, seconds: float = LONGEST_S
) -> tuple[Motion, FloatArray, Wobble]:
    """A module's samples, the place of the tip, and the wobble."""
    random = np.random.default_rng([seed, 0x719])
    wobble = case.wobble or any_wobble(random)
    # Along the probe, which is x, and as far aside as a sensor may sit.
    tip = random.uniform(0.08, 0.2) * units(np.array([1.0, *random.normal(0, 0.2, 2)]))
    hand = DimplingHand(random, RECORDS_HZ, wobble, tip)
    exact = next(hand.pieces(World(tip_m=tuple(tip)), seconds))
    module = module_of(case.module, random, chip=case.chip)
    return module.measures(exact, random), tip, wobble


def samples_of(felt: Motion, chip: feed.Chip) -> tuple[Scale, list[Sample]]:
    """The raw samples of a board."""
    sampled = feed.sampled(felt, chip)
    rows = sampled.rows
    scale = Scale(chip.acc_lsb, chip.gyr_lsb, chip.mag_lsb, chip.rate_hz)
    columns = (rows["time_us"], rows["acc"], rows["gyr"])
    counts = zip(*(column.tolist() for column in columns), strict=True)
    return scale, [Sample(t, tuple(acc), tuple(gyr)) for t, acc, gyr in counts]


def judged(
    scale: Scale, samples: Sequence[Sample], case: Case, tip: FloatArray, wobble: Wobble
) -> Run:
    """The guide's result for these samples."""
    base = "slips" if wobble.slip_m else "soft" if wobble.give else "firm"
    guide = Dimpling(scale, params_of(case.module))
    found: TipFound | CalibrationFault | None = None
    for sample in samples:
        if (found := guide.feed(sample)) is not None:
            break
    if found is None:
        found = guide.end()
    if isinstance(found, CalibrationFault):
        return Run(found.kind, base, seconds=guide.seconds)
    assert found.offset_m is not None
    assert found.sigma_m is not None
    error_mm = 1000.0 * float(np.linalg.norm(found.offset_m - tip))
    score_mm = 1000.0 * INSIDE * found.sigma_m
    return Run("found", base, error_mm, score_mm, found.seconds)


def measure(case: Case, seed: int) -> Run:
    """One wobble, as one of the two boards samples it."""
    felt, tip, wobble = motion_of(
        case, seed, LONGEST_S if case.name in GOOD else ENDED_S
    )
    chip = list(CHIPS.values())[seed // 2 % 2]
    return judged(*samples_of(felt, chip), case, tip, wobble)


def through_image(board: str, seed: int) -> Run:
    """One wobble, as the image of a board sends it."""
    case = replace(CASES[1], wobble=replace(USUAL, swing_deg=20.0, still_s=4.0))
    felt, tip, wobble = motion_of(case, seed, 25.0)
    with tempfile.TemporaryDirectory() as folder:
        motion, path = Path(folder) / "motion.npz", Path(folder) / "raw.bin"
        felt.save(motion)
        words = ["sim", board, "--fast", "--stream", "--raw", "--motion", str(motion)]
        command = [sys.executable, "-m", "imud", *words, "--record", str(path)]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        _, subject, samples = of_file(path, None)
    return judged(subject.scale, samples, case, tip, wobble)


def row_of(name: str, runs: Sequence[Run]) -> dict[str, Any]:
    """Percent, mm and s; what is stated is for 95 %."""
    found = [run for run in runs if run.error_mm is not None]
    why = Counter(run.kind for run in runs if run.error_mm is None)
    refused = ", ".join(f"{kind} {count}" for kind, count in why.most_common())
    row = {
        "wobble": name,
        "runs": len(runs),
        "found": 100.0 * len(found) / len(runs),
        "seconds": float(np.median([run.seconds for run in runs])),
        "refused": refused.replace("_", " "),
    }
    if found:
        errors = [run.error_mm for run in found if run.error_mm is not None]
        row |= {
            "median": float(np.median(errors)),
            "p95": float(np.quantile(errors, 0.95)),
            "bad": 100.0 * share_bad(found),
            "inside": inside(found),
            "stated": float(np.median([run.score_mm for run in found])),
        }
    return row


def share_bad(found: Sequence[Run]) -> float:
    """The share of bad ones among accepted runs."""
    return float(np.mean([(run.error_mm or 0.0) > 1000.0 * BAD_M for run in found]))


def inside(found: Sequence[Run]) -> float:
    """Percent of the errors that are smaller than what is stated for 95 %."""
    each = [(run.error_mm or 0.0) <= (run.score_mm or 0.0) for run in found]
    return 100.0 * float(np.mean(each))


COLUMNS = {
    "wobble": ("wobble", ""),
    "runs": ("runs", "d"),
    "found, %": ("found", ".0f"),
    "median, mm": ("median", ".2f"),
    "p95": ("p95", ".2f"),
    "worse than 2 mm, %": ("bad", ".1f"),
    "inside, %": ("inside", ".0f"),
    "stated, mm": ("stated", ".2f"),
    "after, s": ("seconds", ".0f"),
    "refused as": ("refused", ""),
}


def figures_of(done: dict[str, list[Run]]) -> Iterator[Figure]:
    good = [run for name in GOOD for run in done.get(name, [])]
    found = [run for run in good if run.error_mm is not None]
    if found:
        p95 = float(np.quantile([run.error_mm for run in found], 0.95))
        name = "tip, calibrated, 0.8 Hz, 15 to 30 deg, p95, mm"
        yield Figure(name, p95, (0, 2), (0, 1), f"{len(found)} of {len(good)} found")
        yield Figure("of these inside 95 %, %", inside(found), (90, 100), (93, 98))
    crowd = done.get(CROWD, [])
    accepted = [run for run in crowd if run.error_mm is not None]
    if accepted:
        bad = 100.0 * share_bad(accepted)
        detail = f"{len(accepted)} of {len(crowd)} accepted"
        yield Figure("accepted and worse than 2 mm, %", bad, (0, 2), (0, 0.5), detail)
        firm = [run for run in accepted if run.base == "firm"]
        known = f"{CROWD}, firm base: inside 95 %, %"
        yield Figure(known, inside(firm), (90, 100), (93, 98))


def measured(args: argparse.Namespace) -> Report:
    """All cases, and some wobbles through images."""
    tip_guide.FIT_S = FIT_S
    cases = [case for case in CASES if args.only in case.name]
    progress = Progress("tip", float(sum(case.runs for case in cases)))
    done: dict[str, list[Run]] = {}
    count = 0
    for case in cases:
        # Each case has seeds of its own.
        first = 2000 * CASES.index(case) + SETS[args.set]
        runs = done[case.name] = []
        for number in range(max(1, round(args.share * case.runs))):
            runs.append(measure(case, first + 2 * number))
            count += 1
            progress.update(float(count))
    images = [
        through_image([*CHIPS][number % 2], 50_000 + SETS[args.set] + 2 * number)
        for number in range(args.images)
    ]
    rows = [row_of(name, runs) for name, runs in done.items()]
    if images:
        rows.append(row_of("20 degrees, through the images of both boards", images))
    data = {name: [asdict(run) for run in runs] for name, runs in done.items()}
    return Report([Table.of("wobbles", COLUMNS, rows)], [*figures_of(done)], data)


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--set", choices=SETS, default="judging", help="of seeds")
    parser.add_argument("--only", default="", help="cases whose name contains this")
    parser.add_argument("--share", type=float, default=1.0, help="of the runs")
    parser.add_argument("--images", type=int, default=10, help="runs through images")


main = partial(harness.run, "tip", __doc__, measured, options)
