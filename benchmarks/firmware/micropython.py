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
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.common.paths import PROJECT, RESULTS, write_results
from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode, encode

BUILD = PROJECT / "build" / "micropython"
MAINS = PROJECT / "tests" / "micropython" / "mains"
IMAGES = ("fast", "madgwick", "memory", "memory_plain", "pause", "pause_plain")
RESULT = RESULTS / "micropython.json"

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


def sizes() -> dict[str, int]:
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
    return {"package_mpy": package, "module_objects": text}


def measure(seconds: float) -> dict[str, Any]:
    tool = PROJECT / "tools" / "micropython_build.py"
    mains = [MAINS / f"{name}.py" for name in IMAGES]
    subprocess.run([sys.executable, tool, "pyboard", "plain", *mains], check=True)
    kinds = {
        "module, 100 poses/s": ("micropython", ()),
        "module, all poses and raw": ("micropython", tuple(orders(380))),
        "module, 760 Hz": ("fast", ()),
        "module, 760 Hz, all": ("fast", tuple(orders(760))),
        "without, raw": ("plain", ()),
        "without, Madgwick": ("madgwick", ()),
        "without, Madgwick and raw": ("madgwick", tuple(orders(380))),
    }
    result: dict[str, Any] = {"seconds": seconds}
    for kind, (name, options) in kinds.items():
        result[kind] = run(name, seconds, *options)
    for kind, name in (("module", ""), ("without", "_plain")):
        taken = [supply - 1 for supply in run(f"memory{name}", seconds)["told"]]
        result[f"{kind}: heap a second, bytes"] = max(taken)
        result[f"{kind}: longest turn, us"] = max(run(f"pause{name}", seconds)["told"])
    return result | {"bytes": sizes()}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run")
    args = parser.parse_args(arguments)
    result = measure(args.seconds)
    print(f"{'':28}{'samples/s':>10}{'lost':>6}{'awake':>8}{'instructions':>14}")
    for kind, row in result.items():
        if isinstance(row, dict) and "samples_hz" in row:
            print(
                f"{kind:28}{row['samples_hz']:10.1f}{row['lost']:6}"
                f"{row['awake']:8.1%}{row['instructions_a_sample']:14,}"
            )
        else:
            print(f"{kind:40}{row}")
    write_results(RESULT, result)


if __name__ == "__main__":
    main()
