# SPDX-License-Identifier: MIT
"""The STM32F405's load: each filter of its image, and all messages at both rates."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common import capture as captures
from benchmarks.common.boards import F405
from benchmarks.common.engines import MAIN, OURS
from benchmarks.common.images import RunFailed
from benchmarks.firmware.profiles import Measured, measure, poses_a_second, prepared
from imud.virtual import motion
from imud.wire import messages, schema
from imud.wire.frame import encode_frame

FAST = "stm32f405_760"  # an environment of platformio.ini
RATES = ((F405.environment, 380), (FAST, 760))
# The image accepts commands once its sensor is set up. It contains every filter.
FILTER_FROM_US = 1_500_000


@dataclass(frozen=True, slots=True)
class Filtered:
    """Cycles a sample of one filter in the image."""

    step_mean: float
    step_worst: int
    pose_mean: float


def each_filter(image: Path, hand: Path, seed: int) -> dict[str, dict[str, Any]]:
    """Measure each filter of the image; print a line for each when it is done."""
    print("\nfilter in the image   step: mean     worst   pose: mean")
    found = {}
    for name in OURS:
        number = int(schema.Filter[name.upper()])
        order = {"command": "restart", "token": 9, "arguments": (number, 0)}
        frame = encode_frame(messages.encode("command", order, 9, 0))
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
    """The cost of a filter for each sample after the command that selected it."""
    functions = measured.profile["functions"]
    times_us = measured.capture.feed.rows["time_us"]
    count = int((times_us > FILTER_FROM_US).sum())
    if name == MAIN:  # the filter at start-up
        count = measured.profile["samples"]
    # Ours takes the measurement in one function and works in another; the worst of both
    # is at most their sum.
    step = ("take", "work") if name == MAIN else ("step",)
    tallies = [functions.get(f"{name}_{what}") for what in (*step, "orientation")]
    if None in tallies or not count:
        raise RunFailed(f"{name} did not run")
    *steps, pose = (tally["inclusive"] for tally in tallies)
    return Filtered(
        step_mean=round(sum(each["cycles"] for each in steps) / count, 1),
        step_worst=sum(each["worst"] for each in steps),
        pose_mean=round(pose["cycles"] / count, 1),
    )


@dataclass(frozen=True, slots=True)
class Rate:
    """The load of an image that sends and logs each sample and its pose."""

    sample_hz: int
    samples: int
    late: int
    lost: int  # samples or messages, on the wire
    poses_hz: float
    cycles_mean: float
    cycles_worst: int
    asleep: float  # share of the time, 0 to 1
    wire: float
    log_dropped: int  # messages that the card was too slow for


BITS_A_BYTE = 10  # on the wire, with a start and a stop bit
BAUD = 921_600


def at_rate(image: Path, sample_hz: int, hand: Path, seed: int) -> Rate:
    """Run an image with a pose for every sample."""
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
