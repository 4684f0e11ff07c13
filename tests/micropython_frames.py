# SPDX-License-Identifier: MIT
"""The frames of MicroPython, plain and viper, beside those of the C."""

from __future__ import annotations

import os
import re
import struct
import subprocess
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from imud import _core
from imud.wire.schema import HELLO_SEED
from reference import HELLO_ID

ROOT = Path(__file__).resolve().parent.parent
PROGRAMS = ROOT / "tests" / "micropython"
PACKAGE = ROOT / "firmware" / "micropython" / "probe"


def vectors() -> list[tuple[int, bytes, bytes]]:
    """Seed, content and frame of each vector that is a frame."""
    found = tomllib.loads((ROOT / "protocol" / "vectors.toml").read_text())
    frames = []
    for each in found["frame"] + found["good"]:
        if "frame" not in each:
            continue
        content, frame = bytes.fromhex(each["content"]), bytes.fromhex(each["frame"])
        is_hello = content[0] == HELLO_ID
        frames.append((HELLO_SEED if is_hello else each["seed"], content, frame))
    return frames


def random_contents(count: int) -> list[tuple[int, bytes]]:
    """Of any length, with many zeros and with none."""
    random = np.random.default_rng(18)
    contents = []
    for _ in range(count):
        length = int(random.integers(1, 121))
        low, high = random.choice([(0, 256), (0, 2), (1, 256)])
        data = random.integers(low, high, length, np.uint8).tobytes()
        contents.append((int(random.integers(0, 65536)), data))
    return contents


def assert_frames_are_those_of_c(
    program: Sequence[str | Path], count: int, folder: Path
) -> None:
    """All vectors and `count` random contents, by the command of a MicroPython."""
    known = vectors()
    assert len(known) >= 20
    contents = [(seed, content) for seed, content, _ in known] + random_contents(count)
    given, made = folder / "contents", folder / "frames"
    given.write_bytes(
        b"".join(struct.pack("<HH", seed, len(data)) + data for seed, data in contents)
    )
    done = subprocess.run(
        [*program, PROGRAMS / "frames.py", PACKAGE, given, made],
        env=os.environ | {"MICROPYPATH": str(PROGRAMS / "stock")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    frames = re.findall(rb"[^\0]+\0", made.read_bytes())
    assert frames[: len(known)] == [frame for _, _, frame in known]
    assert frames == [_core.encode_frame(seed, data) for seed, data in contents]
