# SPDX-License-Identifier: MIT
"""Where the ATmega328P's cycles, flash and RAM go.

The image as flashed, all streams on, while a hand turns the probe any way up, strokes
with it, rests, and works beside magnets: its figures against their limits, then by
part. Then the images of the papers' filters, and every filter alone beside Madgwick's
and VQF in floats.
"""

from __future__ import annotations

import argparse
import configparser
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import filters
import parts
import scoring
from capture import SAMPLE_RATE_HZ, Capture, RunFailed, run_nano
from feed import Samples

from imud import motion
from imud.errors import ImudError
from imud.motion import Magnet, World

OUTPUT = scoring.PROJECT / "build" / "benchmarks" / "cycles.json"
ENVIRONMENT = "nano"  # of platformio.ini, the image that is flashed
OFFICIAL = "nano_pio"  # the same by PlatformIO's own compiler

CLOCK_HZ = 16e6
CYCLES_A_SAMPLE = int(CLOCK_HZ / SAMPLE_RATE_HZ)
WORST_CYCLES = CYCLES_A_SAMPLE * 9 // 10
# ATmega328P data sheet, table 2-1; the bootloader keeps 2 kB of the flash on old Nanos.
FLASH_BYTES = filters.FLASH_BYTES - 2048
# 1.7 KiB: what is left of the 2 KiB is for what no run has met.
RAM_BYTES = 1740

# Strong enough, and near enough to where the hand works, that the field leaves the
# Earth's by tens of microtesla on some strokes and by little on others.
MAGNETS = (
    Magnet((0.15, 0.05, 0.03), (0.0, 0.4, 0.1)),
    Magnet((-0.2, -0.1, 0.0), (0.5, 0.0, -0.3)),
)
# Offsets that the start-up calibration takes, and a magnetometer that needs one.
ERRORS = motion.SensorErrors(mag_offset_ut=3.0)
FILTER_SECONDS = 30.0  # of the same hand, for the filters alone


class SumsDiffer(Exception):
    """A profile whose parts don't make up its total."""


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


@dataclass(frozen=True, slots=True)
class Part:
    """Cycles a sample."""

    name: str
    mean: float
    worst: int
    in_worst: int  # in the sample that took longest in all
    outside: float  # before the sample's work and after it, mean


@dataclass(frozen=True, slots=True)
class Measured:
    """One image."""

    capture: Capture
    profile: dict[str, Any]


def environments() -> list[str]:
    """Those of platformio.ini that make a Nano's image, the flashed one first."""
    ini = configparser.ConfigParser(interpolation=None)
    ini.read(scoring.PROJECT / "platformio.ini")
    names = [section.removeprefix("env:") for section in ini if "env:" in section]
    others = [
        name
        for name in names
        if name.startswith(f"{ENVIRONMENT}_") and name != OFFICIAL
    ]
    return [ENVIRONMENT, *others]


def build(environment: str) -> Path:
    """Builds an image by PlatformIO."""
    done = subprocess.run(
        [sys.executable, "-m", "platformio", "run", "--silent", "-e", environment],
        cwd=scoring.PROJECT,
        env={
            key: os.environ[key] for key in os.environ if key != "PLATFORMIO_CORE_DIR"
        },
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    # One that has no place beside the bootloader is linked all the same; its own line
    # of the table says so.
    if done.returncode != 0 and "greater than maximum allowed" not in done.stderr:
        raise RunFailed(f"{environment}: {done.stderr.strip()}")
    return scoring.PROJECT / ".pio" / "build" / environment / "firmware.elf"


def measure(image: Path, hand: Path, seed: int) -> Measured:
    """Runs an image on a motion, all streams on, and profiles it."""
    with tempfile.TemporaryDirectory() as folder:
        where, profile = Path(folder) / "parts", Path(folder) / "profile.json"
        parts.write(image, where)
        options = ["--image", str(image), "--seed", str(seed)]
        options += ["--rate", f"{SAMPLE_RATE_HZ:g}"]
        options += ["--profile", str(profile), "--parts", str(where)]
        capture = run_nano(hand, options)
        return Measured(capture, json.loads(profile.read_text()))


def figures(summary: dict[str, Any], lost: int, poses_hz: float) -> list[Line]:
    """The table of an image."""
    return [
        Line("cycles a sample, worst", summary["cycles_worst"], "", WORST_CYCLES),
        Line("cycles a sample, mean", summary["cycles_mean"], "", WORST_CYCLES),
        Line("asleep", round(100.0 * summary["idle"], 1), "%"),
        Line("samples late", summary["late"], "", 0),
        Line("samples or messages lost", lost, "", 0),
        Line("samples", summary["samples"], ""),
        Line("poses a second", round(poses_hz, 1), ""),
        Line("flash", summary["flash"], "bytes", FLASH_BYTES),
        Line("RAM: variables", summary["ram"], "bytes"),
        Line("RAM: deepest stack", summary["stack_max"], "bytes"),
        Line("RAM: both", summary["ram"] + summary["stack_max"], "bytes", RAM_BYTES),
    ]


def by_part(profile: dict[str, Any]) -> list[Part]:
    """The parts by their mean, and all together; checked to add up."""
    count = profile["samples"]
    total = profile["total"]
    tallies = profile["parts"]
    for kind in ("cycles", "outside", "in_worst"):
        whole = sum(tally[kind] for tally in tallies.values())
        if whole != total[kind]:
            raise SumsDiffer(f"{kind}: parts {whole}, total {total[kind]}")
    found = [
        Part(
            name=name,
            mean=round(tally["cycles"] / count, 1),
            worst=tally["worst"],
            in_worst=tally["in_worst"],
            outside=round(tally["outside"] / count, 1),
        )
        for name, tally in {**tallies, "all": total}.items()
    ]
    return sorted(found, key=lambda part: (part.name == "all", -part.mean))


def print_parts(found: Iterable[Part], interrupts: dict[str, Any], count: int) -> None:
    print("\ncycles a sample             mean     worst  in worst sample   outside")
    for part in found:
        print(
            f"{part.name:20}{part.mean:>12.0f}{part.worst:>10}{part.in_worst:>17}"
            f"{part.outside:>10.0f}"
        )
    print("\ninterrupt              a sample      mean     worst cycles")
    for name, handler in interrupts.items():
        mean = handler["cycles"] / handler["calls"]
        print(
            f"{parts.HANDLERS.get(name, name):20}{handler['calls'] / count:>12.2f}"
            f"{mean:>10.1f}{handler['worst']:>10}"
        )


def print_image(name: str, summary: dict[str, Any]) -> None:
    print(
        f"{name:20}{summary['cycles_mean']:>12.0f}{summary['cycles_worst']:>10}"
        f"{summary['flash']:>10}{summary['ram']:>8}{summary['stack_max']:>8}"
    )


def compare(samples: Samples) -> dict[str, dict[str, Any]]:
    """Every filter alone: prints as it goes."""
    print(
        "\nfilter alone          step: mean     worst   pose: mean     flash     RAM"
        "   stack"
    )
    found: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for filter_ in filters.filters():
            try:
                cost = filters.cost(filter_, samples, Path(folder))
            except filters.Unmeasured as error:
                print(f"{filter_.name:20}  not measured: {error}")
                found[filter_.key] = {"unmeasured": str(error)}
                continue
            print(
                f"{filter_.name:20}{cost.step_mean:>12.0f}{cost.step_worst:>10}"
                f"{cost.answer_mean:>13.0f}{cost.flash:>10}{cost.ram:>8}{cost.stack:>8}"
                f"  {cost.checked}",
                flush=True,
            )
            found[filter_.key] = {
                "cycles_mean": cost.cycles_mean,
                "cycles_worst": cost.cycles_worst,
                **dataclasses.asdict(cost),
            }
    return found


def first(samples: Samples, seconds: float) -> Samples:
    count = round(seconds * samples.rate_hz)
    return Samples(
        samples.rate_hz, samples.gyr[:count], samples.acc[:count], samples.mag[:count]
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Measures, prints, writes JSON; 1 where a limit is broken."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: benchmarks/cycles.py --seconds 60"
    )
    parser.add_argument("--seconds", metavar="N", type=float, default=120.0)
    parser.add_argument("--seed", metavar="N", type=int, default=1)
    parser.add_argument(
        "--image",
        metavar="ELF",
        type=Path,
        help="the image to measure (default: builds the one that is flashed)",
    )
    parser.add_argument(
        "--only",
        choices=("image", "filters"),
        help="the flashed image, or that and the filters alone (default: all)",
    )
    parser.add_argument("--output", metavar="FILE", type=Path, default=OUTPUT)
    args = parser.parse_args(argv)
    result: dict[str, Any] = {"seconds": args.seconds, "images": {}}
    with tempfile.TemporaryDirectory() as folder:
        hand = Path(folder) / "hand.npz"
        motion.generate(
            args.seconds, args.seed, world=World(magnets=MAGNETS), errors=ERRORS
        ).save(hand)
        main_image = measure(args.image or build(ENVIRONMENT), hand, args.seed)
        capture, profile = main_image.capture, main_image.profile
        times = capture.pose_times_s
        poses_hz = (len(times) - 1) / float(times[-1] - times[0])
        lines = figures(capture.summary, capture.lost, poses_hz)
        print(f"{args.seconds:g} s, pose and raw at {SAMPLE_RATE_HZ:g} Hz, at 16 MHz")
        for line in lines:
            print(line)
        found = by_part(profile)
        print_parts(found, profile["interrupts"], profile["samples"])
        result["figures"] = {line.name: line.value for line in lines}
        result["summary"] = capture.summary
        result["parts"] = {part.name: dataclasses.asdict(part) for part in found}
        result["functions"] = profile["functions"]
        result["interrupts"] = profile["interrupts"]
        result["images"][ENVIRONMENT] = capture.summary
        if args.only is None:
            print(
                "\nimage                       mean     worst     flash     RAM   stack"
            )
            print_image(ENVIRONMENT, capture.summary)
            for environment in environments()[1:]:
                other = measure(build(environment), hand, args.seed)
                print_image(environment, other.capture.summary)
                result["images"][environment] = other.capture.summary
    if args.only != "image":
        result["engines"] = compare(first(capture.feed.samples, FILTER_SECONDS))
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(json.dumps(result, indent=1) + "\n")
    return 0 if all(line.is_kept for line in lines) else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (
        ImudError,
        RunFailed,
        SumsDiffer,
        filters.FilterFailed,
        parts.NoParts,
    ) as error:
        sys.exit(f"cycles: {error}")
