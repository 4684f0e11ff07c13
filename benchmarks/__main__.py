# SPDX-License-Identifier: MIT
"""Runs the programs of `make bench WHAT=...`, whether or not one misses a figure; or
one of them, with its options.

example: python -m benchmarks accuracy/groups.py --board f405
"""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
from collections.abc import Sequence

# The benchmarks: what each measures, then its programs with their options.
BENCHES: dict[str, tuple[str, ...]] = {
    "accuracy": (
        "errors on recordings and on simulated motions, beside VQF",
        "accuracy/recordings.py",
        "accuracy/recordings.py --board f405",
        "accuracy/groups.py",
        "accuracy/groups.py --board f405",
    ),
    "afterwards": (
        "errors of poses that imud refine estimates, beside VQF offline",
        "accuracy/afterwards.py",
        "strokes/afterwards.py",
        "accuracy/unsaid.py",
    ),
    "honesty": (
        "whether stated errors of poses are true and useful",
        "honesty/desk.py",
        "honesty/grounds.py",
        "honesty/since_origin.py",
        "honesty/since_origin.py --board f405",
        "honesty/since_origin.py --recordings",
        "honesty/aims.py",
    ),
    "nano": (
        "cycles, stack, flash and RAM of the image, its slowest samples",
        "firmware/cycles.py",
    ),
    "mega": (
        "the same of the Mega's image",
        "firmware/cycles.py --board mega",
    ),
    "f405": (
        "the same of the F405, in instructions, at both of its rates",
        "firmware/cycles.py --board f405",
        "firmware/cycles.py --board f405-760",
    ),
    "micropython": (
        "the module's file on RISC-V and Arm in qemu: poses, instructions, heap",
        "firmware/micropython.py",
    ),
    "pico": (
        "the Pico's images: poses beside the host's, cycles; without data-ready",
        "firmware/pico.py",
    ),
    "card": (
        "minutes of logging on the virtual F405, compared with its wire",
        "firmware/card.py",
    ),
    "faults": (
        "what faults of wire, network, log and host cost; how samples are dated",
        "host/faults.py",
    ),
    "host": (
        "the daemon: latency, CPU, memory",
        "host/daemon.py",
    ),
    "bridge": (
        "imud bridge: rate, loss, latency, CPU; Foxglove both ways",
        "host/bridge.py",
        "host/served.py",
    ),
    "attacks": (
        "an hour of attacks on the daemon, beside its clients",
        "host/attacks.py",
    ),
    "hosts": (
        "many probes, daemons, routers and consumers: cost, latency, loss",
        "host/hosts.py",
    ),
    "calibration": (
        "how well simulated modules are calibrated; 1,000 verdicts; learning",
        "calibration/modules.py",
        "calibration/verdicts.py",
        "calibration/learning.py",
    ),
    "limb": (
        "joint angles of legs that walk, and of chains; paths of feet",
        "limb/legs.py",
        "limb/chains.py",
        "limb/feet.py",
    ),
    "page": (
        "the page in Chromium: frames, latency; what a browser costs",
        "page/browser.py",
    ),
    "strokes": (
        "how well strokes are measured: a simulated hand, the firmware's C",
        "strokes/on_host.py",
        "strokes/on_host.py --board nano",
        "strokes/by_chip.py",
    ),
    "tip": (
        "how well the tip is found: a simulated hand that wobbles the probe",
        "tip/wobbles.py",
    ),
}
DEFAULT = "accuracy"
# Their processes would wait for each other's threads.
ONE_THREAD = {"calibration": {"OPENBLAS_NUM_THREADS": "1"}}


def run_one(program: str, arguments: Sequence[str]) -> int:
    """A program by its path in benchmarks/, in this process."""
    name = program.removesuffix(".py").replace("/", ".")
    status: int = importlib.import_module(f"benchmarks.{name}").main(
        arguments=arguments
    )
    return status


def main(arguments: Sequence[str] | None = None) -> int:
    words = sys.argv[1:] if arguments is None else arguments
    if words and words[0].endswith(".py"):
        return run_one(words[0], words[1:])
    width = max(map(len, BENCHES))
    lines = (f"  {name:{width}}  {says}" for name, (says, *_) in BENCHES.items())
    parser = argparse.ArgumentParser(
        prog="benchmarks",
        description="\n".join((f"{__doc__}\n", *lines)),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("what", nargs="?", default=DEFAULT, help="default: %(default)s")
    parser.add_argument(
        "--check", action="store_true", help="only check that it exists"
    )
    args = parser.parse_args(words)
    if args.what not in BENCHES:
        sys.exit(f"bench: no WHAT={args.what}; there are {', '.join(BENCHES)}")
    if args.check:
        return 0
    _, *programs = BENCHES[args.what]
    environment = {**os.environ, **ONE_THREAD.get(args.what, {})}
    status = 0
    for program in programs:
        command = [sys.executable, "-m", "benchmarks", *program.split()]
        done = subprocess.run(command, env=environment, check=False)
        status = status or done.returncode
    return status


if __name__ == "__main__":
    sys.exit(main())
