# SPDX-License-Identifier: MIT
"""The Pico's images in rp2040js: whether their poses are the host's, what a sample
costs, and how well a sensor without a data-ready wire is followed.

A hand turns the probe, with poses and raw messages of every sample on the wire. The
emulator counts cycles without waits for memory.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import capture as captures
from benchmarks.common import scoring
from benchmarks.common.capture import Capture
from benchmarks.common.images import RunFailed, flashed
from benchmarks.common.paths import PROJECT, RESULTS, write_results
from imud.errors import ImudError
from imud.rotation import FloatArray
from imud.virtual import motion, sensors
from imud.virtual.motion import Motion
from imud.wire import messages
from imud.wire.frame import encode_frame

BOARD = "pico"
MICROPYTHON = PROJECT / "build" / "pico" / "pico-micropython.elf"
OUTPUT = RESULTS / "pico.json"
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


def show(name: str, found: dict[str, Any]) -> None:
    words = (
        f"{key} {value:,.3f}" if isinstance(value, float) else f"{key} {value:,}"
        for key, value in found.items()
    )
    print(f"{name}: {', '.join(words)}", flush=True)


def measure(seconds: float, seed: int, folder: Path) -> dict[str, Any]:
    """All runs; each is printed as it ends."""
    hand = sensors.generate(seconds, seed)
    whole, shorter = folder / "hand.npz", folder / "shorter.npz"
    hand.save(whole)
    motion.load(whole)[: len(hand) // SHORTER].save(shorter)
    _, image = flashed(BOARD)
    found: dict[str, Any] = {"seconds": seconds}

    def keep(name: str, capture: Capture, **more: float) -> None:
        found[name] = told(capture) | more
        show(name, found[name])

    usb = run(whole, "--wire", "usb")
    keep("usb", usb, ram=ram_of(image), **errors_of(usb, hand))
    keep("uart", run(whole, "--wire", "uart"))
    polled = run(whole, "--wire", "usb", "--ready", "none")
    keep("polled", polled, **times_of(polled, usb), **errors_of(polled, hand))
    wired = run(shorter, "--wire", "usb", image=MICROPYTHON)
    keep("micropython", wired)
    polled = run(shorter, "--wire", "usb", "--ready", "none", image=MICROPYTHON)
    keep("micropython polled", polled, **times_of(polled, wired))
    return found


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", metavar="N", type=float, default=60.0)
    parser.add_argument("--seed", metavar="N", type=int, default=3)
    parser.add_argument("--output", metavar="FILE", type=Path, default=OUTPUT)
    args = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        found = measure(args.seconds, args.seed, Path(folder))
    write_results(args.output, found)
    differ = [
        name
        for name, each in found.items()
        if isinstance(each, dict) and each["different"]
    ]
    for name in differ:
        print(f"{name}: poses differ from the host's")
    return 1 if differ else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (ImudError, RunFailed) as error:
        sys.exit(f"pico: {error}")
