# SPDX-License-Identifier: MIT
"""The cost of a probe in MicroPython, on the virtual pyboard: samples without loss,
instructions and heap for a sample, the longest turn of its loop, and bytes of code.

An instruction is a cycle in the emulator, so instructions are a lower bound of cycles.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks import harness
from benchmarks.common.paths import PROJECT
from benchmarks.harness import Figure, Report, Table
from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode, encode

BUILD = PROJECT / "build" / "micropython"
MAINS = PROJECT / "tests" / "micropython" / "mains"
IMAGES = ("fast", "madgwick", "memory", "memory_plain", "pause", "pause_plain")

CLOCK_HZ = 168_000_000
SETTLED = 3  # statuses until all that is sent once is sent
CLICK = ("--press", "200000:300000")


def orders(rate_hz: int) -> list[str]:
    """Options of the emulator that have all poses and raw samples sent."""
    both = int(schema.StreamFlags.POSE | schema.StreamFlags.RAW)
    wanted = [("rate", (1, rate_hz)), ("rate", (0, rate_hz)), ("fields", (both, 0))]
    words = []
    for token, (name, arguments) in enumerate(wanted, start=1):
        fields = {"command": name, "token": token, "arguments": arguments}
        frame = b"\0" + encode_frame(encode("command", fields, token, 0))
        words += ["--send", f"{310_000 + token * 10_000}:{frame.hex()}"]
    return words


def run(name: str, seconds: float, *options: str) -> dict[str, Any]:
    """The figures of a run of an image."""
    with tempfile.TemporaryDirectory() as room:
        record, summary = Path(room) / "record", Path(room) / "summary"
        image = BUILD / "pyboard" / name
        words: list[object] = [PROJECT / "build" / "sim" / "f405", "--image", image]
        words += ["--record", record, "--summary", summary, "--fast"]
        words += ["--seconds", seconds, *CLICK, *options]
        subprocess.run(list(map(str, words)), check=True, capture_output=True)
        messages = [decode(each) for each in FrameDecoder().feed(record.read_bytes())]
        found = json.loads(summary.read_text())
    good = [message for message in messages if isinstance(message, Message)]
    statuses = [m.fields for m in good if m.name == "status"]
    first, last = statuses[SETTLED - 1], statuses[-1]
    span_s = int(str(last["uptime"])) - int(str(first["uptime"]))
    samples = int(str(last["samples_read"])) - int(str(first["samples_read"]))
    awake = 1.0 - found["idle"]
    return {
        "samples_hz": round(samples / span_s, 1),
        "lost": int(str(last["overruns"])) + int(str(last["messages_dropped"])),
        "awake": round(awake, 3),
        "instructions_a_sample": round(awake * CLOCK_HZ * span_s / samples),
        "told": [status["supply"] for status in statuses[SETTLED - 1 :]],
        "stack": found["stack_max"],
    }


def sizes() -> tuple[int, int]:
    """Bytes of the package's bytecode, and of the module in flash."""
    folder = BUILD / "pyboard"
    objects = [
        path
        for path in folder.rglob("*.o")
        if "imuprobe" in path.parts or "core" in path.parts
    ]
    lines = subprocess.run(
        ["arm-none-eabi-size", *objects], capture_output=True, text=True, check=True
    ).stdout.splitlines()[1:]
    text = sum(sum(map(int, line.split()[:2])) for line in lines)
    package = sum(path.stat().st_size for path in BUILD.glob("armv7emsp/probe/*.mpy"))
    return package, text


# Each run: what it is called, its image, and whether all is sent, at which rate.
KINDS: dict[str, tuple[str, int]] = {
    "with the module, 100 poses/s": ("micropython", 0),
    "with the module, all": ("micropython", 380),
    "with the module, `fast=True`, 100 poses/s": ("fast", 0),
    "with the module, `fast=True`, all": ("fast", 760),
    "without it, raw": ("plain", 0),
    "without it, Madgwick at 95 steps/s": ("madgwick", 0),
    "without it, Madgwick and raw": ("madgwick", 380),
}
WAYS = {"with the module": "", "without it": "_plain"}


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run")


def measured(args: argparse.Namespace) -> Report:
    """All runs; no sample may be lost in any of them."""
    tool = PROJECT / "tools" / "micropython_build.py"
    mains = [MAINS / f"{name}.py" for name in IMAGES]
    subprocess.run([sys.executable, tool, "pyboard", "plain", *mains], check=True)
    runs = {
        kind: run(name, args.seconds, *(orders(rate_hz) if rate_hz else ()))
        for kind, (name, rate_hz) in KINDS.items()
    }
    heaps = {
        kind: max(run(f"memory{name}", args.seconds)["told"]) - 1
        for kind, name in WAYS.items()
    }
    turns_ms = {
        kind: max(run(f"pause{name}", args.seconds)["told"]) / 1000
        for kind, name in WAYS.items()
    }
    package, module = sizes()
    memory = [
        ("heap used by a second of streaming, bytes", *heaps.values()),
        ("longest pass of the main loop, ms", *turns_ms.values()),
        ("code of the module and `core/`, kB", module / 1000, None),
        ("bytecode of the package for armv7emsp, kB", package / 1000, package / 1000),
    ]
    figures = [
        Figure(f"{kind}: lost", each["lost"], (0, 0), (0, 0))
        for kind, each in runs.items()
    ]
    return Report([rates_of(runs), memory_of(memory)], figures, {"runs": runs})


def rates_of(runs: Mapping[str, Mapping[str, Any]]) -> Table:
    columns = {"": "", "samples/s": ",.0f", "lost": "d", "processor awake": ".1%"}
    names = ("samples_hz", "lost", "awake", "instructions_a_sample")
    rows = [(kind, *(each[name] for name in names)) for kind, each in runs.items()]
    return Table("rates", columns | {"instructions a sample": ",d"}, rows)


def memory_of(rows: Sequence[tuple[str, float, float | None]]) -> Table:
    return Table("memory", {"": ""} | dict.fromkeys(WAYS, ".3g"), rows)


main = partial(harness.run, "micropython", __doc__, measured, options)
