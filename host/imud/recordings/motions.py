# SPDX-License-Identifier: MIT
"""A motion for a virtual probe, from whatever holds raw samples: a log, a capture of a
UART, a card's PROBE.LOG, a table.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from imud.errors import ConfigError, FileError
from imud.recordings.decode import Tally, decode_file
from imud.recordings.foreign_log import log_of_foreign
from imud.virtual import motion
from imud.virtual.motion import Motion, MotionError
from imud.wire.messages import Value

TABLES = (".npz", ".csv")

# The fewest samples that are worth a run.
SAMPLES_MIN = 20


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """A sensor's uncalibrated readings, and its params at that time."""

    motion: Motion
    probe: str = ""  # its name; empty: a table tells none
    board: str = ""
    records: bytes | None = None  # of its params; None: not known
    filled: int = 0  # samples that were missing and lie between their neighbours
    left_out_s: float = 0.0  # of what was recorded: before and after longer gaps


@dataclass(slots=True)
class _Samples:
    """The rows of one probe, a list for each stretch of its device time."""

    stretches: list[list[tuple[float, ...]]] = field(default_factory=list)
    last_us: int = 0
    mag: tuple[float, ...] = (0.0, 0.0, 0.0)  # it comes less often than the others
    has_mag: bool = False

    def add(self, t_us: int, raw: dict[str, Any]) -> None:
        if raw["acc_counts"] is None or raw["gyr_counts"] is None:
            return
        is_next = 0 < t_us - self.last_us <= motion.FILL_S * 1e6
        if not self.stretches or not is_next:
            self.stretches.append([])
        self.last_us = t_us
        if raw["mag_counts"] is not None:
            self.mag, self.has_mag = tuple(raw["mag_counts"]), True
        row = (t_us * 1e-6, *raw["gyr_counts"], *raw["acc_counts"], *self.mag)
        self.stretches[-1].append(row)


def load(path: Path, probe: str | None = None) -> RecordedMotion:
    """Reads a motion. Of several probes `probe` names one; of a log with gaps the
    longest stretch is taken. FileError or ConfigError say what is missing.
    """
    if path.suffix.lower() in TABLES:
        if probe is not None:
            raise ConfigError(f"{path} has only one probe: leave out --probe")
        try:
            return RecordedMotion(motion.load(path))
        except MotionError as error:
            # A table of others, perhaps with gaps: as a log.
            try:
                with log_of_foreign(path) as log:
                    return replace(load(log), probe="")
            except FileError:
                raise error from None
    tally = Tally()
    found: dict[str, _Samples] = defaultdict(_Samples)
    for item in decode_file(path, tally):
        if item["type"] == "raw":
            found[item["probe"]].add(item["t_device_us"], item)
    name = _chosen(path, probe, found)
    known = tally.probe(name)
    scales = _scales(known.hello)
    if scales is None:
        raise FileError(
            f"{path}: probe {name} has no hello with the scales of its counts"
        )
    stretch = max(found[name].stretches, key=len)
    if len(stretch) < SAMPLES_MIN:
        raise MotionError(f"{path}: {len(stretch)} raw samples in a row are too few")
    rows = np.array(stretch)
    try:
        rate_hz, table, filled = motion.evened(rows[:, 0], rows[:, 1:])
    except ValueError as error:
        raise MotionError(f"{path}: {error}") from error
    gyr, acc, mag = (
        table[:, at : at + 3] * scale
        for at, scale in zip((0, 3, 6), scales, strict=True)
    )
    return RecordedMotion(
        Motion(rate_hz, gyr, acc, mag),
        name,
        str(known.hello.get("board")),
        known.params,
        filled,
        sum(map(_seconds, found[name].stretches)) - _seconds(stretch),
    )


def _scales(hello: Mapping[str, Value]) -> tuple[float, float, float] | None:
    """Values of a count of gyroscope, accelerometer and magnetometer, in SI units and
    uT."""
    match [hello.get(key) for key in ("gyr_lsb", "acc_lsb", "mag_lsb")]:
        case [float(gyr), float(acc), float(mag)]:
            return gyr, acc, mag
    return None


def _seconds(stretch: list[tuple[float, ...]]) -> float:
    return stretch[-1][0] - stretch[0][0]


def _chosen(path: Path, probe: str | None, found: dict[str, _Samples]) -> str:
    names = ", ".join(sorted(found))
    if not found:
        raise FileError(
            f"{path} has no raw samples; set streams = "
            '["pose", "raw"] and raw_rate of the probe, and log again'
        )
    if probe is None and len(found) > 1:
        raise ConfigError(
            f"{path} has several probes; choose one with --probe: {names}"
        )
    if probe is not None and probe not in found:
        raise ConfigError(f"{path} has no raw samples of {probe}; there are {names}")
    return probe or next(iter(found))


def words_of(path: Path, found: RecordedMotion) -> str:
    """The summary of the recording, on one line."""
    motion_ = found.motion
    parts = [f"{len(motion_)} samples at {motion_.rate_hz:.0f} Hz"]
    if found.probe:
        parts[0] += f" of {found.probe}"
    if found.filled:
        parts.append(f"{found.filled} missing samples filled in")
    if found.left_out_s > 0.0:
        parts.append(f"{found.left_out_s:.1f} s across gaps left out")
    return f"{path}: {', '.join(parts)}"
