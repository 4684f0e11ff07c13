# SPDX-License-Identifier: MIT
"""Whether `imud check --turn` judges rightly: modules from a shop, calibrated by the
guided procedure, that simulated hands turn by a known angle on a dividing plate or onto
a wedge; and the same modules with something wrong.

Prints a line for each angle and fault, and writes build/benchmarks/turns.json.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from benchmarks.calibration import simulated
from benchmarks.common import engines, jobs
from benchmarks.common.boards import NANO
from benchmarks.common.engines import HOST
from benchmarks.common.feed import NO_READING, Feed, sampled
from benchmarks.common.figure import SETS, Figure
from benchmarks.common.paths import RESULTS, write_results
from benchmarks.honesty.since_origin import published
from imud.calibration.algebra import units
from imud.calibration.guided import housing, whole
from imud.calibration.guided.result import result_of_fit
from imud.calibration.poses import BASE_DOWN
from imud.calibration.recording import Sample, Scale
from imud.check.rows import overall
from imud.check.turn import TurnGuide
from imud.check.turn_rows import LAID_DEG, rows
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.virtual.calibrating import SCALE
from imud.virtual.modules import shop
from imud.virtual.motion import Motion, join
from imud.virtual.motions.module import MG, Module
from imud.virtual.sensors import NO_ERRORS, stream
from imud.virtual.turning import AXES, EACH_S, MOVE_S, TurningHand

SALT = 0x7412
RATE_HZ = 400.0
FIRST_S = 20.0  # since power-on: the bias is found, the filter settled
ANGLES = (30.0, 90.0)
OUTPUT = RESULTS / "turns.json"

CHIP = NANO.chip
BOARD_SCALE = Scale(CHIP.acc_lsb, CHIP.gyr_lsb, CHIP.mag_lsb, CHIP.rate_hz)

Spoil = Callable[[Module, np.random.Generator], Module]


def _other(_: Module, random: np.random.Generator) -> Module:
    return shop(random)


def _acc_bias(module: Module, random: np.random.Generator) -> Module:
    off = units(random.standard_normal(3)) * 60.0 * MG
    return replace(module, acc_bias=module.acc_bias + off)


def _gyr_scale(module: Module, random: np.random.Generator) -> Module:
    share = 1.0 + random.choice([-0.05, 0.05])
    return replace(module, gyr=module.gyr * share)


def _iron(module: Module, random: np.random.Generator) -> Module:
    off = units(random.standard_normal(3)) * 15.0
    return replace(module, mag_bias=module.mag_bias + off)


SOUND, OTHER = "nothing wrong", "another module's params"
FAULTS: dict[str, Spoil] = {
    SOUND: lambda module, _: module,
    OTHER: _other,
    "accelerometer off by 60 mg": _acc_bias,
    "gyroscope's scale off by 5 %": _gyr_scale,
    "15 uT of iron on it": _iron,
}


def motion_of(module: Module, seed: int, axis: FloatArray, turn_deg: float) -> Motion:
    """One turn, as measured by a module."""
    exact = stream(
        seed,
        RATE_HZ,
        simulated.EARTH,
        NO_ERRORS,
        lambda random, hz: TurningHand(random, hz, axis, turn_deg, FIRST_S),
    )
    sensor = module.sensor(RATE_HZ, np.random.default_rng([seed, SALT, 2]))
    felt: list[Motion] = []
    for piece in exact:
        felt.append(sensor.feel(piece))
        if sum(each.seconds for each in felt) > FIRST_S + MOVE_S + EACH_S:
            break
    return join(felt)


def calibrated(module: Module, seed: int) -> Params:
    """The params of the guided procedure."""
    ups = [*simulated.UPS, BASE_DOWN.up, None]
    recording = simulated.recorded(simulated.samples(module, seed, ups))
    fit = whole.fit(recording)
    assert fit is not None
    return result_of_fit(fit, SCALE, Params(), housing.found(recording, fit)).params


def seen_by(guide: TurnGuide, feed: Feed, count: int | None = None) -> None:
    """Gives it raw samples, the first `count` of them, and poses in the order in which
    a probe sends them.
    """
    poses = zip(feed.pose_after, published(engines.ENGINES[HOST](feed)), strict=True)
    due = dict(poses)
    table = feed.rows
    for index, t_us in enumerate(table["time_us"].tolist()[:count]):
        mag = table["mag"][index].tolist()
        guide.on_sample(
            Sample(
                t_us,
                tuple(table["acc"][index].tolist()),
                tuple(table["gyr"][index].tolist()),
                None if mag[0] == NO_READING else tuple(mag),
            )
        )
        if index in due:
            guide.on_pose(due[index])


def judged(case: tuple[int, str, str, float]) -> dict[str, Any]:
    """The verdict on one turn, of a seed, a fault, a hand and an angle."""
    seed, fault, name, turn_deg = case
    random = np.random.default_rng([seed, SALT])
    module = shop(random)
    params = calibrated(module, seed)
    spoilt = FAULTS[fault](module, random)
    felt = motion_of(spoilt, seed, AXES[name], turn_deg)
    guide = TurnGuide(BOARD_SCALE, params, turn_deg)
    seen_by(guide, sampled(felt, CHIP, params.encode()))
    assert guide.found is not None
    table = rows(guide.found, BOARD_SCALE, params, turn_deg, LAID_DEG)
    return {
        "seed": seed,
        "fault": fault,
        "hand": name,
        "turn_deg": turn_deg,
        "verdict": str(overall(table)),
        "rows": {row.name: str(row.verdict) for row in table},
        "numbers": {row.name: dict(row.numbers) for row in table},
    }


def figures(found: Sequence[dict[str, Any]]) -> list[Figure]:
    """Of each fault, hand and angle the share of right verdicts."""
    groups: dict[tuple[str, str, float], list[bool]] = {}
    for row in found:
        is_right = (row["verdict"] == "good") == (row["fault"] == SOUND)
        key = (row["fault"], row["hand"], row["turn_deg"])
        groups.setdefault(key, []).append(is_right)
    return [
        Figure(
            f"{fault}, {hand}, {turn_deg:g} degrees: right verdicts, %",
            100.0 * float(np.mean(rights)),
            (99.0, 100.0) if fault in (SOUND, OTHER) else (0.0, 100.0),
            (99.5, 100.0) if fault in (SOUND, OTHER) else (90.0, 100.0),
            f"{len(rights)} turns",
        )
        for (fault, hand, turn_deg), rights in groups.items()
    ]


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: benchmarks/calibration/turns.py --count 50",
    )
    parser.add_argument("--count", type=int, default=200, help="modules of each case")
    parser.add_argument("--sets", nargs="+", choices=SETS, default=["judging"])
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args(arguments)
    report: dict[str, Any] = {}
    for which in args.sets:
        seeds = [2 * index + SETS[which] for index in range(args.count)]
        cases = list(product(seeds, FAULTS, AXES, ANGLES))
        report[which] = list(jobs.each(judged, cases, args.jobs, "turns"))
        print(f"\nseeds for {which}\n")
        for figure in figures(report[which]):
            print(figure)
    write_results(OUTPUT, report)


if __name__ == "__main__":
    main(sys.argv[1:])
