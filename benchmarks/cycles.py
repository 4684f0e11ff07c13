# SPDX-License-Identifier: MIT
"""Where a board's cycles, flash and RAM go.

The image as flashed, all streams on, while a hand turns the probe any way up, strokes
with it, rests, and works beside magnets: its figures against their limits, then by
part. Of the ATmega328P then the images of the papers' filters, and every filter alone
beside Madgwick's and VQF in floats. Of the STM32F405, which logs to a card meanwhile,
each of its filters, and both of its rates with every message on the wire: there a cycle
is an instruction, without what flash, buses and exceptions make the core wait.
"""

from __future__ import annotations

import argparse
import configparser
import contextlib
import dataclasses
import io
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import capture as captures
import filters
import parts
import scoring
from boards import BOARDS, F405, NANO, Board
from capture import Capture, RunFailed
from feed import Samples

from imud._core import encode_frame
from imud.cli import main as imud
from imud.errors import ImudError
from imud.virtual import motion, sensors
from imud.virtual.sensors import Magnet, World
from imud.wire import messages, schema

OUTPUT = scoring.PROJECT / "build" / "benchmarks"
OFFICIAL = "nano_pio"  # the Nano's by PlatformIO's own compiler


@dataclass(frozen=True, slots=True)
class Limits:
    """What an image has to keep to."""

    cycles: int  # of a sample
    flash: int
    variables: int  # bytes of RAM
    stack: int
    both: int


LIMITS = {
    "nano": Limits(
        int(0.9 * NANO.clock_hz / NANO.chip.rate_hz),
        # The bootloader keeps 2 kB of the flash on old Nanos.
        flash=filters.FLASH_BYTES - 2048,
        variables=filters.RAM_BYTES,
        stack=filters.RAM_BYTES,
        # 1.7 KiB: what is left of the 2 KiB is for what no run has met.
        both=1740,
    ),
    # Half of the time, because an instruction may take more than a cycle. Data sheet,
    # "Memory mapping"; the last two sectors of flash are for settings, and the stack is
    # in 8 KiB of its own (firmware/stm32/stm32f405.ld).
    "f405": Limits(
        int(0.5 * F405.clock_hz / F405.chip.rate_hz),
        flash=(1024 - 256) * 1024,
        variables=128 * 1024,
        stack=8 * 1024,
        both=(128 + 8) * 1024,
    ),
}

FAST = "stm32f405_760"  # of platformio.ini
RATES = ((F405.environment, 380), (FAST, 760))
# The image takes orders once the sensor is set up; every filter is in it.
FILTER_FROM_US = 1_500_000
CARD_BYTES_A_SECOND = 120_000  # more than raw and pose are at 760 Hz

# Strong enough, and near enough to where the hand works, that the field leaves the
# Earth's by tens of microtesla on some strokes and by little on others.
MAGNETS = (
    Magnet((0.15, 0.05, 0.03), (0.0, 0.4, 0.1)),
    Magnet((-0.2, -0.1, 0.0), (0.5, 0.0, -0.3)),
)
# Offsets that the start-up calibration takes, and a magnetometer that needs one.
ERRORS = sensors.SensorErrors(mag_offset_ut=3.0)
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
        if name.startswith(f"{NANO.environment}_") and name != OFFICIAL
    ]
    return [NANO.environment, *others]


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


def measure(
    board: Board, image: Path, hand: Path, seed: int, options: Sequence[str] = ()
) -> Measured:
    """Runs an image on a motion, all streams on, and profiles it."""
    rate_hz = int(board.chip.rate_hz)
    with tempfile.TemporaryDirectory() as folder:
        where, profile = Path(folder) / "parts", Path(folder) / "profile.json"
        parts.write(image, where)
        words = ["--seed", str(seed), *options]
        words += ["--profile", str(profile), "--parts", str(where)]
        if board is F405:
            words += ["--card", str(prepared(Path(folder), motion.load(hand).seconds))]
        capture = captures.run(
            board.name, hand, words, image=image, pose_rate_hz=rate_hz
        )
        return Measured(capture, json.loads(profile.read_text()))


def prepared(folder: Path, seconds: float) -> Path:
    """A card that takes the log of so long a run."""
    path = folder / "card.img"
    size = 48 + int(seconds * CARD_BYTES_A_SECOND) // 2**20
    with contextlib.redirect_stdout(io.StringIO()):
        if imud(["card", "prepare", str(path), "--size", f"{size}M"]):
            raise RunFailed("no card could be prepared")
    return path


def figures(
    summary: dict[str, Any], lost: int, poses_hz: float, name: str = NANO.name
) -> list[Line]:
    """The table of an image."""
    limits = LIMITS[name]
    return [
        Line("cycles a sample, worst", summary["cycles_worst"], "", limits.cycles),
        Line("cycles a sample, mean", summary["cycles_mean"], "", limits.cycles),
        Line("asleep", round(100.0 * summary["idle"], 1), "%"),
        Line("samples late", summary["late"], "", 0),
        Line("samples or messages lost", lost, "", 0),
        Line("samples", summary["samples"], ""),
        Line("poses a second", round(poses_hz, 1), ""),
        Line("flash", summary["flash"], "bytes", limits.flash),
        Line("RAM: variables", summary["ram"], "bytes", limits.variables),
        Line("RAM: deepest stack", summary["stack_max"], "bytes", limits.stack),
        Line("RAM: both", summary["ram"] + summary["stack_max"], "bytes", limits.both),
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


@dataclass(frozen=True, slots=True)
class Filtered:
    """Cycles of a filter in the image that has them all."""

    step_mean: float
    step_worst: int
    pose_mean: float


def each_filter(image: Path, hand: Path, seed: int) -> dict[str, dict[str, Any]]:
    """The filters of the STM32F405's image, one after the other: prints as it goes."""
    print("\nfilter in the image   step: mean     worst   pose: mean")
    found = {}
    for filter_ in schema.Filter:
        name = filter_.name.lower()
        if name not in filters.HOUSE:
            continue
        order = {"command": "restart", "token": 9, "arguments": (int(filter_), 0)}
        frame = encode_frame(schema.SEED, messages.encode("command", order, 9, 0))
        options = ["--send", f"{FILTER_FROM_US}:{frame.hex()}"]
        measured = measure(F405, image, hand, seed, options)
        cost = filtered(measured, name)
        print(
            f"{name:20}{cost.step_mean:>12.0f}{cost.step_worst:>10}"
            f"{cost.pose_mean:>13.0f}",
            flush=True,
        )
        found[name] = dataclasses.asdict(cost)
    return found


def filtered(measured: Measured, name: str) -> Filtered:
    """What a filter took of the samples behind the order to begin with it."""
    functions = measured.profile["functions"]
    times_us = measured.capture.feed.rows["time_us"]
    count = int((times_us > FILTER_FROM_US).sum())
    if name == "fuse":  # which an image begins with
        count = measured.profile["samples"]
    tallies = [functions.get(f"{name}_{what}") for what in ("step", "orientation")]
    if None in tallies or not count:
        raise RunFailed(f"{name} did not run")
    step, pose = (tally["inclusive"] for tally in tallies)
    return Filtered(
        step_mean=round(step["cycles"] / count, 1),
        step_worst=step["worst"],
        pose_mean=round(pose["cycles"] / count, 1),
    )


@dataclass(frozen=True, slots=True)
class Rate:
    """An image at its rate, each sample and its pose sent and logged."""

    sample_hz: int
    samples: int
    late: int
    lost: int  # samples or messages, on the wire
    poses_hz: float
    cycles_mean: float
    cycles_worst: int
    asleep: float  # shares of 1
    wire: float
    log_dropped: int  # messages that the card was too slow for


BITS_A_BYTE = 10  # of the wire, a start and a stop bit among them
BAUD = 921_600


def at_rate(image: Path, sample_hz: int, hand: Path, seed: int) -> Rate:
    """Runs an image with a pose for every sample."""
    with tempfile.TemporaryDirectory() as folder:
        card = prepared(Path(folder), motion.load(hand).seconds)
        capture = captures.run(
            F405.name,
            hand,
            ["--seed", str(seed), "--card", str(card)],
            image=image,
            sample_rate_hz=sample_hz,
            pose_rate_hz=sample_hz,
        )
    summary, times = capture.summary, capture.feed.times_s
    streamed_s = float(times[-1] - times[0])
    return Rate(
        sample_hz=sample_hz,
        samples=summary["samples"],
        late=summary["late"],
        lost=capture.lost,
        poses_hz=round(poses_a_second(capture), 1),
        cycles_mean=summary["cycles_mean"],
        cycles_worst=summary["cycles_worst"],
        asleep=summary["idle"],
        wire=round(summary["bytes"] * BITS_A_BYTE / BAUD / streamed_s, 4),
        log_dropped=capture.log_dropped,
    )


def poses_a_second(capture: Capture) -> float:
    times = capture.pose_times_s
    return (len(times) - 1) / float(times[-1] - times[0])


def print_rates(rates: Iterable[Rate]) -> None:
    print(
        "\nsamples/s   samples    late    lost   poses/s   cycles: mean   worst"
        "  asleep    wire   log dropped"
    )
    for rate in rates:
        print(
            f"{rate.sample_hz:>9}{rate.samples:>10}{rate.late:>8}{rate.lost:>8}"
            f"{rate.poses_hz:>10}{rate.cycles_mean:>15.0f}{rate.cycles_worst:>8}"
            f"{100 * rate.asleep:>6.1f} %{100 * rate.wire:>6.1f} %"
            f"{rate.log_dropped:>14}"
        )


def image_of(
    board: Board, image: Path, hand: Path, args: argparse.Namespace
) -> tuple[Measured, list[Line], dict[str, Any]]:
    """The flashed image: prints its tables."""
    measured = measure(board, image, hand, args.seed)
    capture, profile = measured.capture, measured.profile
    lines = figures(capture.summary, capture.lost, poses_a_second(capture), board.name)
    rate_hz, clock_mhz = board.chip.rate_hz, board.clock_hz / 1e6
    print(
        f"{board.title}: {args.seconds:g} s, pose and raw at {rate_hz:g} Hz, "
        f"at {clock_mhz:g} MHz"
    )
    for line in lines:
        print(line)
    found = by_part(profile)
    print_parts(found, profile["interrupts"], profile["samples"])
    result = {
        "board": board.name,
        "seconds": args.seconds,
        "figures": {line.name: line.value for line in lines},
        "summary": capture.summary,
        "parts": {part.name: dataclasses.asdict(part) for part in found},
        "functions": profile["functions"],
        "interrupts": profile["interrupts"],
    }
    return measured, lines, result


def of_nano(hand: Path, args: argparse.Namespace) -> tuple[list[Line], dict[str, Any]]:
    """Its image, those of the papers' filters, and the filters alone."""
    image = args.image or build(NANO.environment)
    measured, lines, result = image_of(NANO, image, hand, args)
    result["images"] = {NANO.environment: measured.capture.summary}
    if args.only is None:
        print("\nimage                       mean     worst     flash     RAM   stack")
        print_image(NANO.environment, measured.capture.summary)
        for environment in environments()[1:]:
            other = measure(NANO, build(environment), hand, args.seed)
            print_image(environment, other.capture.summary)
            result["images"][environment] = other.capture.summary
    if args.only != "image":
        samples = first(measured.capture.feed.samples, FILTER_SECONDS)
        result["engines"] = compare(samples)
    return lines, result


def of_f405(hand: Path, args: argparse.Namespace) -> tuple[list[Line], dict[str, Any]]:
    """Its image, that at both rates with all on the wire, and its filters."""
    image = args.image or build(F405.environment)
    _, lines, result = image_of(F405, image, hand, args)
    if args.only != "image":
        shorter = hand.with_name("shorter.npz")
        motion.load(hand)[: round(FILTER_SECONDS * sensors.HAND_RATE_HZ)].save(shorter)
        result["filters"] = each_filter(image, shorter, args.seed)
    if args.only is None:
        images = {F405.environment: image}
        rates = [
            at_rate(images.get(name) or build(name), rate_hz, hand, args.seed)
            for name, rate_hz in RATES
        ]
        print_rates(rates)
        result["rates"] = [dataclasses.asdict(rate) for rate in rates]
        lines += [
            Line(f"{what} at {rate.sample_hz} Hz", value, "", 0)
            for rate in rates
            for what, value in (
                ("late", rate.late),
                ("lost", rate.lost + rate.log_dropped),
            )
        ]
    return lines, result


def main(argv: Sequence[str] | None = None) -> int:
    """Measures, prints, writes JSON; 1 where a limit is broken."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: benchmarks/cycles.py --seconds 60"
    )
    parser.add_argument("--board", choices=BOARDS, default=NANO.name)
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
        help="the flashed image, or that and the filters (default: all)",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        type=Path,
        help="default: cycles-BOARD.json, of the Nano cycles.json",
    )
    args = parser.parse_args(argv)
    board = BOARDS[args.board]
    name = "" if board is NANO else f"-{board.name}"
    output = args.output or OUTPUT / f"cycles{name}.json"
    with tempfile.TemporaryDirectory() as folder:
        hand = Path(folder) / "hand.npz"
        sensors.generate(
            args.seconds, args.seed, world=World(magnets=MAGNETS), errors=ERRORS
        ).save(hand)
        lines, result = (of_nano if board is NANO else of_f405)(hand, args)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(json.dumps(result, indent=1) + "\n")
    broken = [line for line in lines if not line.is_kept]
    for line in broken:
        print(f"too much: {line.name}: {line.value:g}")
    return 1 if broken else 0


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
