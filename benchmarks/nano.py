# SPDX-License-Identifier: MIT
"""What the image for the Nano costs: cycles a sample, stack, flash, RAM, time asleep.

Everything is on: pose and raw are sent 200 times a second while a hand turns the probe
any way up, strokes with it, rests, and works beside magnets.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import scoring
from capture import SAMPLE_RATE_HZ, Capture, RunFailed, run_nano

from imud import motion
from imud.errors import ImudError
from imud.motion import Magnet, World

OUTPUT = scoring.PROJECT / "build" / "benchmarks" / "nano.json"

CLOCK_HZ = 16e6
CYCLES_A_SAMPLE = int(CLOCK_HZ / SAMPLE_RATE_HZ)
# ATmega328P data sheet, table 2-1; the bootloader keeps 2 kB of the flash on old Nanos.
FLASH_BYTES = 32768 - 2048
RAM_BYTES = 2048

# Strong enough, and near enough to where the hand works, that the field leaves the
# Earth's by tens of microtesla on some strokes and by little on others.
MAGNETS = (
    Magnet((0.15, 0.05, 0.03), (0.0, 0.4, 0.1)),
    Magnet((-0.2, -0.1, 0.0), (0.5, 0.0, -0.3)),
)
# Offsets that the start-up calibration takes, and a magnetometer that needs one.
ERRORS = motion.SensorErrors(mag_offset_ut=3.0)


@dataclass(frozen=True, slots=True)
class Line:
    """One figure, its limit where there is one, and whether it keeps to it."""

    name: str
    value: float
    unit: str
    limit: float | None = None

    @property
    def is_kept(self) -> bool:
        return self.limit is None or self.value <= self.limit

    def __str__(self) -> str:
        limit = "" if self.limit is None else f"of {self.limit:g}"
        mark = "" if self.is_kept else "  <-- too much"
        return f"{self.name:34}{self.value:>10g} {self.unit:8}{limit:>10}{mark}"


def run(seconds: float, seed: int) -> Capture:
    """Moves the probe by hand near magnets, all streams on."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hand.npz"
        made = motion.generate(
            seconds, seed, world=World(magnets=MAGNETS), errors=ERRORS
        )
        made.save(path)
        return run_nano(path, ["--rate", f"{SAMPLE_RATE_HZ:g}", "--seed", str(seed)])


def figures(summary: dict[str, Any], lost: int, poses_hz: float) -> list[Line]:
    """The table's lines."""
    return [
        Line("cycles a sample, worst", summary["cycles_worst"], "", CYCLES_A_SAMPLE),
        Line("cycles a sample, mean", summary["cycles_mean"], "", CYCLES_A_SAMPLE),
        Line("asleep", round(100.0 * summary["idle"], 1), "%"),
        Line("samples late", summary["late"], "", 0),
        Line("samples or messages lost", lost, "", 0),
        Line("samples", summary["samples"], ""),
        Line("poses a second", round(poses_hz, 1), ""),
        Line("flash", summary["flash"], "bytes", FLASH_BYTES),
        Line("RAM: variables", summary["ram"], "bytes", RAM_BYTES),
        Line("RAM: deepest stack", summary["stack_max"], "bytes"),
        Line(
            "RAM: both",
            summary["ram"] + summary["stack_max"],
            "bytes",
            RAM_BYTES,
        ),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Measures, prints, writes JSON; 1 where a limit is broken."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: benchmarks/nano.py --seconds 60"
    )
    parser.add_argument("--seconds", metavar="N", type=float, default=120.0)
    parser.add_argument("--seed", metavar="N", type=int, default=1)
    parser.add_argument("--output", metavar="FILE", type=Path, default=OUTPUT)
    args = parser.parse_args(argv)
    capture = run(args.seconds, args.seed)
    times = capture.pose_times_s
    poses_hz = (len(times) - 1) / float(times[-1] - times[0])
    lines = figures(capture.summary, capture.lost, poses_hz)
    print(f"{args.seconds:g} s, pose and raw at {SAMPLE_RATE_HZ:g} Hz, at 16 MHz")
    for line in lines:
        print(line)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    found = {line.name: line.value for line in lines}
    args.output.write_text(
        json.dumps({"figures": found, "summary": capture.summary}, indent=1) + "\n"
    )
    return 0 if all(line.is_kept for line in lines) else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (ImudError, RunFailed) as error:
        sys.exit(f"nano: {error}")
