# SPDX-License-Identifier: MIT
"""Params of sensors that somebody has calibrated, in the way of recordings: values are
taken as they are, and the filter is told how good they are."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

from imud._core import encode_frame
from imud.params.value import Params
from imud.wire import messages, schema
from imud.wire.params import digest_of, words_of

IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
_VALUES = {"bias_counts": [0.0, 0.0, 0.0], "matrix": IDENTITY, "method": "measured"}


def known_to(sigma_m_s2: float, sigma_ut: float) -> bytes:
    """Records that tell the one-sigma errors of an axis of accelerometer and
    magnetometer, and none of the gyroscope.
    """
    return (
        Params()
        .replaced("acc", _VALUES | {"sigma_m_s2": sigma_m_s2})
        .replaced("gyr", _VALUES)
        .replaced("mag", _VALUES | {"sigma_uT": sigma_ut})
        .encode()
    )


# As uncertain as a guided calibration leaves them, but for the gyroscope: the scales
# of recordings are wrong by percents.
CALIBRATED = known_to(0.007, 0.05)

# Device times: the first order, the next, which waits for four bytes of memory, and the
# second request to apply, which waits for the first.
BEGIN_US, WORD_US, APPLY_US = 2_000_000, 60_000, 1_000_000
SECONDS_AFTER = 3.0


def orders_us(records: bytes) -> list[tuple[int, bytes]]:
    """Frames that put these records in force, each with its device time in us."""
    digest = digest_of(records)
    orders = [("params_write", words) for words in words_of(records)]
    apply = ("params_apply", (len(records), digest - (digest >> 31 << 32)))
    found = []
    at_us = BEGIN_US
    for number, (command, arguments) in enumerate([*orders, apply, apply]):
        fields = {"command": command, "token": 100 + number, "arguments": arguments}
        content = messages.encode("command", fields, number, 0)
        found.append((at_us, encode_frame(schema.SEED, content)))
        at_us += WORD_US if command == "params_write" else APPLY_US
    return found


def memory_with(image: Path, simulator: Path, records: bytes, path: Path) -> None:
    """Writes to `path` what a virtual board remembers once these are in force."""
    orders = orders_us(records)
    seconds = orders[-1][0] * 1e-6 + SECONDS_AFTER
    with tempfile.TemporaryDirectory() as folder:
        words: list[str | Path] = [simulator, "--image", image, "--eeprom", path]
        words += ["--record", Path(folder) / "uart.bin", "--fast"]
        words += ["--seconds", str(seconds)]
        for at_us, frame in orders:
            words += ["--send", f"{at_us}:{frame.hex()}"]
        subprocess.run(words, stdin=subprocess.DEVNULL, check=True, capture_output=True)
