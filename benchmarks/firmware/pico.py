# SPDX-License-Identifier: MIT
"""The Pico's images in rp2040js: whether their poses are the host's, what a sample
costs, and how well a sensor without a data-ready wire is followed.

A hand turns the probe, with poses and raw messages of every sample on the wire. The
emulator counts cycles without waits for memory.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.common import capture as captures
from benchmarks.common import scoring
from benchmarks.common.capture import Capture
from benchmarks.common.images import flashed
from benchmarks.common.paths import PROJECT
from benchmarks.harness import Figure, Report, Table
from imud.rotation import FloatArray
from imud.virtual import motion, sensors
from imud.virtual.motion import Motion
from imud.wire import messages
from imud.wire.frame import encode_frame

BOARD = "pico"
MICROPYTHON = PROJECT / "build" / "pico" / "pico-micropython.elf"
RATE_HZ = 200
PERIOD_US = 1e6 / RATE_HZ
STACK_BYTES = 4096
SRAM = range(0x2000_0000, 0x2004_2000)
RESTART_US = 2_000_000
SETTLED_S = 30.0  # from here on errors count: the level and the field are found
SHORTER = 3  # MicroPython runs this part of the motion: its emulation is slower


def ram_of(image: Path) -> int:
    """Bytes of an image's sections in RAM, with its stack and its copied code."""
    lines = subprocess.run(
        ["arm-none-eabi-size", "-A", "-d", image],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    words = [line.split() for line in lines]
    rows = [each for each in words if len(each) == 3 and each[2].isdigit()]
    return sum(int(size) for _, size, place in rows if int(place) in SRAM)


def told(capture: Capture) -> dict[str, Any]:
    """The figures of a run."""
    summary, twin = capture.summary, capture.twin()
    counted = ["late", "flash"]
    if summary["samples"]:  # of those that a pin shows; polled ones are not
        counted += ["cycles_mean", "cycles_worst"]
    return {
        "poses": twin.compared,
        "different": twin.differed,
        **{name: summary[name] for name in counted},
        "lost": capture.lost,
        "awake": 1.0 - summary["idle"],
        "stack_free": STACK_BYTES - summary["stack_max"],
    }


def off_grid_us(times_us: FloatArray, period_us: float = PERIOD_US) -> FloatArray:
    """From the nearest multiple of the sensor's period."""
    return np.asarray((times_us + period_us / 2) % period_us - period_us / 2)


def times_of(capture: Capture, wired: Capture) -> dict[str, float]:
    """Errors of the samples' times in us; with the wire they are those of the edges,
    and the sensor's clock is the same in both."""
    edges_us, times_us = (1e6 * each.feed.times_s for each in (wired, capture))
    phase_us = np.median(off_grid_us(edges_us - edges_us[0]))
    errors = np.abs(off_grid_us(times_us - edges_us[0] - phase_us))
    return {
        "rms_us": float(np.sqrt(np.mean(errors**2))),
        "99_us": float(np.percentile(errors, 99)),
    }


def errors_of(capture: Capture, hand: Motion) -> dict[str, float]:
    """Rms errors of the poses in degrees; of the heading about its median."""
    times_s = capture.pose_times_s
    late = (times_s > SETTLED_S) & (times_s < hand.seconds)
    found = scoring.errors_at(times_s[late], capture.poses[late], hand)
    heading = found.heading - np.median(found.heading)
    return {
        "tilt_deg": float(np.sqrt(np.mean(found.inclination**2))),
        "heading_deg": float(np.sqrt(np.mean(heading**2))),
    }


def run(hand: Path, *options: str, image: Path | None = None) -> Capture:
    """All poses and samples. The host's C begins with a restart of the filter: over
    USB it does not hear how the first one began."""
    order = {"command": "restart", "token": 9, "arguments": (0, 0)}
    frame = encode_frame(messages.encode("command", order, 9, 0))
    words = [*options, "--send", f"{RESTART_US}:{frame.hex()}"]
    return captures.run(BOARD, hand, words, image=image, pose_rate_hz=RATE_HZ)


# The figures of a run, their names and formats.
SHOWN = {
    "poses": ("poses compared with the host's", ",d"),
    "different": ("different ones", ",d"),
    "late": ("samples late", ",d"),
    "lost": ("samples or messages lost", ",d"),
    "cycles_mean": ("cycles a sample, mean", ",.0f"),
    "cycles_worst": ("cycles of the worst sample", ",d"),
    "awake": ("processor awake", ".1%"),
    "stack_free": ("stack never used, bytes", ",d"),
    "flash": ("flash, bytes", ",d"),
    "ram": ("RAM with code and stack, bytes", ",d"),
    "rms_us": ("error of a sample's time, rms, us", ".1f"),
    "99_us": ("the same, 99th percentile", ".0f"),
    "tilt_deg": ("error of tilt, rms, degrees", ".2f"),
    "heading_deg": ("error of heading, rms, degrees", ".2f"),
}
# With a data-ready wire, and with the registers polled.
TABLES = {
    "wired": {
        "usb": "C, USB",
        "uart": "C, UART",
        "micropython": "MicroPython, USB",
    },
    "polled": {
        "usb": "C, with the wire",
        "polled": "C, without",
        "micropython polled": "MicroPython, without",
    },
}


def table_of(
    name: str, heads: Mapping[str, str], found: Mapping[str, Mapping[str, Any]]
) -> Table:
    """Runs side by side; without the figures that none of them has."""
    runs = [found[each] for each in heads]
    rows = [
        (words, *(format(run[key], form) if key in run else None for run in runs))
        for key, (words, form) in SHOWN.items()
        if any(key in run for run in runs)
    ]
    return Table(name, {"": "", **dict.fromkeys(heads.values(), "")}, rows)


def report_of(found: Mapping[str, Mapping[str, Any]]) -> Report:
    """The tables; no pose may differ from the host's."""
    figures = [
        Figure(f"{name}: different poses", each["different"], (0, 0), (0, 0))
        for name, each in found.items()
    ]
    tables = [table_of(name, heads, found) for name, heads in TABLES.items()]
    return Report(tables, figures, found)


def measure(seconds: float, seed: int, folder: Path) -> dict[str, dict[str, Any]]:
    """The figures of all runs."""
    hand = sensors.generate(seconds, seed)
    whole, shorter = folder / "hand.npz", folder / "shorter.npz"
    hand.save(whole)
    motion.load(whole)[: len(hand) // SHORTER].save(shorter)
    _, image = flashed(BOARD)
    usb = run(whole, "--wire", "usb")
    uart = run(whole, "--wire", "uart")
    polled = run(whole, "--wire", "usb", "--ready", "none")
    wired = run(shorter, "--wire", "usb", image=MICROPYTHON)
    other = run(shorter, "--wire", "usb", "--ready", "none", image=MICROPYTHON)
    return {
        "usb": {**told(usb), "ram": ram_of(image), **errors_of(usb, hand)},
        "uart": told(uart),
        "polled": {**told(polled), **times_of(polled, usb), **errors_of(polled, hand)},
        "micropython": told(wired),
        "micropython polled": {**told(other), **times_of(other, wired)},
    }


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=60.0, help="of a motion")
    parser.add_argument("--seed", type=int, default=3)


def measured(args: argparse.Namespace) -> Report:
    with tempfile.TemporaryDirectory() as folder:
        return report_of(measure(args.seconds, args.seed, Path(folder)))


main = partial(harness.run, "pico", __doc__, measured, options)
