# SPDX-License-Identifier: MIT
"""Recordings of other programs, as a log like any other: the wire's messages of a probe
whose firmware is called `import`.

Gaps, jitter and missing readings stay what they are: each row keeps its time, and a
magnetometer that repeats a reading had nothing new.
"""

from __future__ import annotations

import contextlib
import hashlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imud.errors import FileError
from imud.log.undated import write_capture
from imud.probes.first_hello import first_hello, probe_in_file
from imud.probes.session import Probe
from imud.recordings import foreign_map, foreign_table
from imud.recordings.foreign_map import SENSORS, ForeignMap
from imud.rotation import FloatArray
from imud.wire import messages, schema
from imud.wire.frame import encode_frame

FIRMWARE = "import"
COUNTS_MAX = 32000.0  # of 16 bits
# 16 g, 2,000 deg/s, and what iron about a probe adds to the Earth's field.
RANGES = {"acc": 160.0, "gyr": 35.0, "mag": 400.0}
LEAST_LSB = {"acc": 1e-6, "gyr": 1e-7, "mag": 1e-3}
CLIPPED = {"acc": "acc_clipped", "gyr": "gyr_clipped"}
HELLO_S = 1.0
FIRST_US = 1000  # of the first row
PAUSE_US = 1_800_000_000  # without a message
REPEATED_MIN = 0.2  # a share of readings alike that no noise makes
BESIDE, OFTEN = 8, 5  # values below an extreme, and how many times as often it comes
SAMPLES_MIN = 20
LEFT_OUT_MAX = 0.05  # a share of rows


@dataclass(frozen=True, slots=True)
class Imported:
    """The samples, in SI units and uT in the body frame."""

    t_us: np.ndarray[Any, np.dtype[np.int64]]
    acc: FloatArray
    gyr: FloatArray
    mag: FloatArray  # NaN where there was nothing new
    told: ForeignMap
    left_out: int  # rows that lack a number, or go back in time
    why: str  # about the first of them
    texts: tuple[str, ...]  # columns without numbers
    began_s: float | None  # UTC of the first sample, if it is known

    @property
    def has_mag(self) -> bool:
        return bool(np.isfinite(self.mag).any())

    @property
    def rate_hz(self) -> float:
        """Rows over time, without gaps."""
        steps = np.diff(self.t_us)
        return 1e6 / float(steps[steps <= 3 * np.median(steps)].mean())

    def words(self) -> str:
        """On one line."""
        steps = np.diff(self.t_us)
        gaps = int((steps > 3 * np.median(steps)).sum())
        parts = [f"{len(self.t_us):,} samples at {self.rate_hz:.1f} Hz"]
        parts += [f"{gaps} gaps"] if gaps else []
        parts += [self.loss] if self.left_out else []
        for name in SENSORS:
            rows = getattr(self, name)
            if clipped := _is_clipped(rows, _lsb(name, rows)).sum():
                parts.append(f"{clipped} of {name} clipped")
        if not self.has_mag:
            parts.append("no magnetometer")
        if self.texts:
            parts.append(f"without columns {', '.join(self.texts)}")
        return ", ".join(parts)

    @property
    def loss(self) -> str:
        rows = "row" if self.left_out == 1 else "rows"
        return f"{self.left_out} {rows} left out ({self.why})"

    def check_complete(self, source: Path) -> None:
        """FileError if more was left out than a file may lack."""
        rows = self.left_out + len(self.t_us)
        if self.left_out > LEFT_OUT_MAX * rows:
            raise FileError(f"{source}: {self.loss} of {rows}: correct the file")


def read(path: Path, told: ForeignMap | None = None) -> Imported:
    """A foreign recording. FileError with what is wrong, or has to be told."""
    told = told or ForeignMap()
    table = foreign_table.read(path, told.only, told.topics)
    t_s = foreign_map.completed(table, told)
    acc, gyr = (foreign_map.vector(table, told, name) for name in ("acc", "gyr"))
    mag = np.full_like(acc, np.nan)
    if "mag" in told.columns:
        mag = _fresh(foreign_map.vector(table, told, "mag"))
    is_full = np.isfinite(t_s) & np.isfinite(np.hstack([acc, gyr])).all(axis=1)
    latest = np.maximum.accumulate(np.where(is_full, t_s, -np.inf))
    is_whole = is_full & (np.diff(latest, prepend=-np.inf) > 0.0)
    why = table.why
    if not why and not is_whole.all():
        at = int(np.argmin(is_whole))
        lack = "its time is not later" if is_full[at] else "a number is missing"
        why = f"row {1 + at}: {lack}"
    left_out = table.unread + len(table) - int(is_whole.sum())
    if is_whole.sum() < SAMPLES_MIN:
        raise FileError(
            f"{path}: {is_whole.sum()} samples are too few" + f"; {why}" * bool(why)
        )
    first_s = float(t_s[is_whole][0])
    t_us = np.rint(1e6 * (t_s[is_whole] - first_s)).astype(np.int64) + FIRST_US
    began_s = None if told.began_s is None else told.began_s + first_s
    vectors = acc[is_whole], gyr[is_whole], mag[is_whole]
    return Imported(t_us, *vectors, told, left_out, why, table.texts, began_s)


def _fresh(mag: FloatArray) -> FloatArray:
    """Without what a slower magnetometer repeats."""
    is_same = np.concatenate([[False], (np.diff(mag, axis=0) == 0.0).all(axis=1)])
    if is_same.mean() < REPEATED_MIN:
        return mag
    return np.where(is_same[:, None], np.nan, mag)


def frames(found: Imported, probe_id: bytes) -> Iterator[bytes]:
    """The frames that the probe would have sent."""
    lsbs = {
        "acc": _lsb("acc", found.acc),
        "gyr": _lsb("gyr", found.gyr),
        "mag": _lsb("mag", found.mag),
    }
    hello = _hello(found, probe_id, lsbs)
    counts = {name: _counts(getattr(found, name), lsb) for name, lsb in lsbs.items()}
    is_clipped = {
        name: _is_clipped(getattr(found, name), lsbs[name]) for name in CLIPPED
    }
    sequence, next_us, last_us = 0, 0, 0
    for at, t_us in enumerate(found.t_us.tolist()):
        while t_us - last_us > PAUSE_US:  # which the wire's 32 bits of us do not hold
            last_us += PAUSE_US
            yield _frame("hello", hello, sequence, last_us)
            sequence += 1
        last_us = t_us
        if t_us >= next_us:
            yield _frame("hello", hello, sequence, t_us)
            sequence, next_us = sequence + 1, t_us + round(HELLO_S * 1e6)
        fields = {
            "acc": _triple(counts["acc"][at]),
            "gyr": _triple(counts["gyr"][at]),
            "mag": _triple(counts["mag"][at]),
            "temperature": None,
            "sample_flags": [
                flag for name, flag in CLIPPED.items() if is_clipped[name][at]
            ],
        }
        yield _frame("raw", fields, sequence, t_us)
        sequence += 1


def _counts(rows: FloatArray, lsb: float) -> FloatArray:
    """A clipped reading has one more than all others."""
    return np.clip(np.rint(rows / lsb), -COUNTS_MAX - 1.0, COUNTS_MAX + 1.0)


def _is_clipped(rows: FloatArray, lsb: float) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Beyond all counts, or where the sensor was: at an extreme that comes far more
    often than the values next to it.
    """
    is_it = np.asarray((np.abs(_counts(rows, lsb)) > COUNTS_MAX).any(axis=1))
    for column in rows.T:
        values, counts = np.unique(column[np.isfinite(column)], return_counts=True)
        if len(values) <= BESIDE:
            continue
        # At rest some say 0.
        if values[-1] > 0.0 and counts[-1] >= OFTEN * counts[-1 - BESIDE : -1].max():
            is_it |= column == values[-1]
        if values[0] < 0.0 and counts[0] >= OFTEN * counts[1 : 1 + BESIDE].max():
            is_it |= column == values[0]
    return is_it


def _triple(counts: FloatArray) -> tuple[int, int, int] | None:
    if not np.isfinite(counts).all():
        return None
    x, y, z = (int(count) for count in counts)
    return x, y, z


def _frame(name: str, fields: dict[str, Any], sequence: int, t_us: int) -> bytes:
    return encode_frame(messages.encode(name, fields, sequence, t_us))


def _lsb(name: str, rows: FloatArray) -> float:
    """The value of a count, so that 16 bits hold the largest reading, but for a few
    that are far above all others and above a sensor's range.
    """
    sizes = np.abs(rows[np.isfinite(rows)])
    most = float(sizes.max(initial=0.0))
    if most > RANGES[name]:
        most = min(most, max(RANGES[name], 4.0 * float(np.percentile(sizes, 99.5))))
    return max(LEAST_LSB[name], most / COUNTS_MAX)


def _hello(found: Imported, probe_id: bytes, lsbs: dict[str, float]) -> dict[str, Any]:
    rate_hz = min(65535, max(1, round(found.rate_hz)))
    return {
        "protocol_version": schema.PROTOCOL_VERSION,
        "schema_fingerprint": schema.FINGERPRINT,
        "firmware": FIRMWARE,
        "board": "micropython",  # any board
        "probe_id": probe_id,
        # Nine axes, or six: which chip it was is not known.
        "sensor": "mpu9250" if found.has_mag else "mpu6500",
        "who_am_i": (0, 0),
        "mag_adjust": (0, 0, 0),
        "self_test": (),
        "sample_rate": rate_hz,
        "pose_rate": 0,
        "raw_rate": rate_hz,
        "acc_lsb": lsbs["acc"],
        "gyr_lsb": lsbs["gyr"],
        "mag_lsb": lsbs["mag"],
        "boot_count": 1,
        "reset_cause": (),
        "filter": "none",
        "reset_address": 0,
        "params_digest": 0,
        "own_field": (0.0, 0.0, 0.0),
        "own_sigma": 0.0,
    }


def _said(found: Imported, probe_id: bytes) -> Iterator[bytes]:
    return (b"\0" + each for each in frames(found, probe_id))


def write(found: Imported, source: Path, log: Path) -> str:
    """Writes the log; returns the probe's id, made of the file's name and samples."""
    digest = hashlib.sha256(source.name.encode())
    for rows in (found.t_us, found.acc, found.gyr):
        digest.update(rows.tobytes())
    probe_id = digest.digest()[:8]
    probe = probe_in_file(first_hello(_said(found, probe_id)), Probe)
    started_ns = 0
    if found.began_s is not None:
        started_ns = 1000 * (round(1e6 * found.began_s) - FIRST_US)
    if not write_capture(_said(found, probe_id), probe, log, started_ns):
        raise FileError(f"{source}: no rows could be written")
    return probe_id.hex()


@contextlib.contextmanager
def log_of_foreign(path: Path) -> Iterator[Path]:
    """A log of a foreign recording, for as long as it is used; all that is needed to
    know of it is guessed.
    """
    with tempfile.TemporaryDirectory(prefix="imud-") as folder:
        log = Path(folder) / f"{path.stem}.mcap"
        found = read(path)
        found.check_complete(path)
        write(found, path, log)
        yield log
