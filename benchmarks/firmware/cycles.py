# SPDX-License-Identifier: MIT
"""Where a board's cycles, flash and RAM go.

Runs the board's image with all streams on, while a hand turns the probe any way up,
draws strokes, rests, and works beside magnets. Shows the image's figures against their
limits, and its cycles by part. Then it runs the image again while the host restarts its
filter or changes its params, and shows the slowest samples of these runs by function.

For the ATmega328P alone it also measures the images with the papers' filters, and every
filter alone, beside Madgwick's and VQF in floats. The STM32F405 also logs to a card;
measured besides are each of its filters, and both of its rates with every message on
the wire. Its cycles are counted as instructions, without wait states of flash, buses
and exceptions.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.common.boards import F405, MEGA, NANO, Board
from benchmarks.common.feed import Samples
from benchmarks.common.images import RunFailed, build, environments
from benchmarks.common.paths import RESULTS, write_results
from benchmarks.firmware import commanded, filters, parts
from benchmarks.firmware.budget import Line, SumsDiffer, by_part, figures, print_parts
from benchmarks.firmware.f405_load import RATES, at_rate, each_filter, print_rates
from benchmarks.firmware.profiles import (
    Measured,
    measure,
    poses_a_second,
)
from imud.errors import ImudError
from imud.virtual import motion, sensors
from imud.virtual.sensors import Magnet, World

# So strong and so near that the field differs from the Earth's by tens of microtesla on
# some strokes and by little on others.
MAGNETS = (
    Magnet((0.15, 0.05, 0.03), (0.0, 0.4, 0.1)),
    Magnet((-0.2, -0.1, 0.0), (0.5, 0.0, -0.3)),
)
# Offsets that the calibration at start-up removes, and one of the magnetometer.
ERRORS = sensors.SensorErrors(mag_offset_ut=3.0)
BOARDS = {board.name: board for board in (NANO, MEGA, F405)}
FILTER_SECONDS = 30.0  # of the same motion, for the filters alone


def print_image(name: str, summary: dict[str, Any]) -> None:
    print(
        f"{name:20}{summary['cycles_mean']:>12.0f}{summary['cycles_worst']:>10}"
        f"{summary['flash']:>10}{summary['ram']:>8}{summary['stack_max']:>8}"
    )


def compare(samples: Samples) -> dict[str, dict[str, Any]]:
    """Measure every filter alone; print a line for each when it is done."""
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


def image_of(
    board: Board, image: Path, hand: Path, args: argparse.Namespace
) -> tuple[Measured, list[Line], dict[str, Any]]:
    """Measure the board's image and print its tables."""
    measured = measure(board, image, hand, args.seed)
    capture, profile = measured.capture, measured.profile
    lines = figures(capture.summary, capture.lost, poses_a_second(capture), board.name)
    rate_hz, clock_mhz = board.chip.rate_hz, board.clock_hz / 1e6
    print(
        f"{board.title}: {args.seconds:g} s, pose and raw at {rate_hz:g} Hz, "
        f"at {clock_mhz:g} MHz"
    )
    obeying = commanded.measure_all(board, image, hand, args.seed)
    lines[1:1] = [each.line(board) for each in obeying]
    for line in lines:
        print(line)
    found = by_part(profile)
    print_parts(found, profile["interrupts"], profile["samples"])
    commanded.show(obeying)
    result = {
        "board": board.name,
        "seconds": args.seconds,
        "figures": {line.name: line.value for line in lines},
        "summary": capture.summary,
        "parts": {part.name: dataclasses.asdict(part) for part in found},
        "functions": profile["functions"],
        "interrupts": profile["interrupts"],
        "commanded": [dataclasses.asdict(each) for each in obeying],
    }
    return measured, lines, result


def of_nano(hand: Path, args: argparse.Namespace) -> tuple[list[Line], dict[str, Any]]:
    """Measure the Nano's image, those of the papers' filters, and the filters alone."""
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
    """Measure the F405's image, its filters, and both rates with all on the wire."""
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


def of_mega(hand: Path, args: argparse.Namespace) -> tuple[list[Line], dict[str, Any]]:
    """Measure the Mega's image."""
    _, lines, result = image_of(MEGA, args.image or build(MEGA.environment), hand, args)
    return lines, result


OF = {NANO: of_nano, MEGA: of_mega, F405: of_f405}


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print the tables, write the JSON; return 1 if a limit is broken."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: benchmarks/firmware/cycles.py --seconds 60",
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
    output = args.output or RESULTS / f"cycles{name}.json"
    with tempfile.TemporaryDirectory() as folder:
        hand = Path(folder) / "hand.npz"
        sensors.generate(
            args.seconds, args.seed, world=World(magnets=MAGNETS), errors=ERRORS
        ).save(hand)
        lines, result = OF[board](hand, args)
    write_results(output, result)
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
