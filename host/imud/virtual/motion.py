# SPDX-License-Identifier: MIT
"""The samples of a virtual probe: recordings read from files, and the stream that
reaches the simulator.

A motion is a series of records at a constant rate, each with the angular rate, the
specific force and the magnetic field in the sensor's frame. `docs/motions.md`
describes the formats: .npz, .csv, and the simulator's binary stream.
"""

from __future__ import annotations

import csv
import struct
import zipfile
import zlib
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from imud.columns import parts_of
from imud.errors import FileError
from imud.rotation import FloatArray
from imud.virtual.npz import arrays_of

BoolArray = npt.NDArray[np.bool_]

STREAM_MAGIC = b"IMUMOT1\0"
# Magic, rate in Hz, number of records (0: up to the end), flags.
STREAM_HEADER = struct.Struct("<8sdQQ")
STREAM_RECORDED = 1

# As `imud export` names them.
CSV_COLUMNS = {
    "gyr": parts_of("gyr_rad_s"),
    "acc": parts_of("acc_m_s2"),
    "mag": parts_of("mag_uT"),
}
# Columns of the time, of which one is needed, and their seconds.
CSV_TIMES = {"t_s": 1.0, "t_device_us": 1e-6}

# Above every sensor's rate and range in these units.
RATE_MAX_HZ = 100_000.0
VALUE_MAX = 1e6

# Characters of a line of a table: some hundred columns.
LINE_MAX = 10_000

# Records that are missing for no longer than this are drawn between their neighbours.
FILL_S = 0.1


class MotionError(FileError):
    """A motion can't be read: the file, the place in it, and the reason."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Records at a constant rate, with the truth where it is known. Vectors are arrays
    of shape (n, 3), flags of shape (n,).

    `quat` is world_from_body, shape (n, 4), world east-north-up; NaN where not seen.
    `is_recorded`: it holds a sensor's low-pass, so the simulator applies none.
    """

    rate_hz: float
    gyr: FloatArray  # rad/s, sensor frame
    acc: FloatArray  # specific force, m/s2, sensor frame: +g up at rest
    mag: FloatArray  # uT, sensor frame
    quat: FloatArray | None = None
    position: FloatArray | None = None  # of the sensor, m, world
    velocity: FloatArray | None = None  # of the sensor, m/s, world
    tip: FloatArray | None = None  # of the probe's tip, m, world
    movement: BoolArray | None = None  # scored: all after the rest at the start
    is_rest: BoolArray | None = None  # the probe lies still
    is_stroke: BoolArray | None = None  # the tip moves along the surface
    is_recorded: bool = True

    def __len__(self) -> int:
        return len(self.gyr)

    @property
    def seconds(self) -> float:
        """How long the motion lasts."""
        return len(self) / self.rate_hz

    def __getitem__(self, records: slice) -> Motion:
        arrays: dict[str, Any] = {
            entry.name: value[records]
            for entry in fields(self)
            if isinstance(value := getattr(self, entry.name), np.ndarray)
        }
        return replace(self, **arrays)

    def save(self, path: Path) -> None:
        """Writes a `.npz`, vectors as float32, that `load` and the benchmarks read."""
        arrays: dict[str, Any] = {
            "sampling_rate": np.array(self.rate_hz),
            "is_recorded": np.array(self.is_recorded),
        }
        for name, key in NPZ_KEYS.items():
            value = getattr(self, name)
            if value is not None:
                is_flag = value.dtype == np.bool_
                arrays[key] = value if is_flag else value.astype(np.float32)
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays)


def join(pieces: list[Motion]) -> Motion:
    """One motion from its pieces, given in order."""
    arrays: dict[str, Any] = {
        entry.name: np.concatenate([getattr(piece, entry.name) for piece in pieces])
        for entry in fields(Motion)
        if isinstance(getattr(pieces[0], entry.name), np.ndarray)
    }
    return replace(pieces[0], **arrays)


# Fields of Motion and their keys in a .npz: those of BROAD, then our own.
NPZ_KEYS = {
    "gyr": "gyr",
    "acc": "acc",
    "mag": "mag",
    "quat": "opt_quat",
    "position": "opt_pos",
    "movement": "movement",
    "velocity": "velocity",
    "tip": "tip_pos",
    "is_rest": "is_rest",
    "is_stroke": "is_stroke",
}
NPZ_OTHERS = ("sampling_rate", "is_recorded")
NPZ_WIDTHS = {"quat": 4, "movement": 0, "is_rest": 0, "is_stroke": 0}  # 3 otherwise


def load(path: Path) -> Motion:
    """Reads a `.npz` or `.csv`; MotionError names the record that can't be used."""
    readers = {".npz": load_npz, ".csv": load_csv}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise MotionError(f"{path}: a motion is a .npz or a .csv file")
    try:
        motion = reader(path)
    except OSError as error:
        raise MotionError(f"{path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise MotionError(f"{path}: not a text file") from error
    if len(motion) < 2:
        raise MotionError(f"{path}: {len(motion)} records; at least 2 are needed")
    for name in CSV_COLUMNS:
        values = getattr(motion, name)
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if bad.size:
            raise MotionError(f"{path}: record {bad[0]}: {name} is not a finite number")
        bad = np.flatnonzero((np.abs(values) > VALUE_MAX).any(axis=1))
        if bad.size:
            raise MotionError(
                f"{path}: record {bad[0]}: {name} exceeds every sensor's range "
                f"({VALUE_MAX:g}); check that its unit is rad/s, m/s2 or uT"
            )
    return motion


def load_npz(path: Path) -> Motion:
    """Reads a `.npz` with the keys of BROAD; only sensors and rate are required."""
    try:
        stored = arrays_of(path, (*NPZ_KEYS.values(), *NPZ_OTHERS))
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise MotionError(f"{path}: not a .npz of plain arrays: {error}") from error
    required = ("gyr", "acc", "mag", "sampling_rate")
    missing = [key for key in required if key not in stored]
    if missing:
        raise MotionError(f"{path}: no {', '.join(missing)} in it")
    numbers = {key: stored[key] for key in NPZ_KEYS.values() if key in stored}
    for key, values in (numbers | {"sampling_rate": stored["sampling_rate"]}).items():
        if values.dtype.kind not in "fiub":
            raise MotionError(f"{path}: {key} holds {values.dtype.name}, not numbers")
    if stored["sampling_rate"].size != 1:
        raise MotionError(f"{path}: sampling_rate is not one number")
    rate_hz = float(stored["sampling_rate"].reshape(-1)[0])
    if not 0.0 < rate_hz <= RATE_MAX_HZ:
        raise MotionError(
            f"{path}: sampling_rate is {rate_hz:g} Hz; the maximum is {RATE_MAX_HZ:g}"
        )
    count = len(np.atleast_1d(stored["gyr"]))
    arrays: dict[str, Any] = {}
    for name, key in NPZ_KEYS.items():
        if key not in stored:
            continue
        width = NPZ_WIDTHS.get(name, 3)
        shape = (count, width) if width else (count,)
        if stored[key].shape != shape:
            raise MotionError(
                f"{path}: {key} has shape {stored[key].shape}, not {shape}"
            )
        arrays[name] = stored[key].astype(np.float64 if width else np.bool_)
    is_recorded = bool(np.all(stored.get("is_recorded", True)))
    return Motion(rate_hz=rate_hz, is_recorded=is_recorded, **arrays)


def load_csv(path: Path) -> Motion:
    """Reads a `.csv` whose first line names the columns, units and all: also a table of
    raw samples that `imud export` wrote. An empty field of the magnetometer repeats the
    last one: it measures less often.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = csv.reader(_short(path, file))
        header = [name.strip() for name in next(rows, [])]
        time = next((name for name in CSV_TIMES if name in header), "t_s")
        wanted = [time, *(name for names in CSV_COLUMNS.values() for name in names)]
        missing = [name for name in wanted if name not in header]
        if missing:
            raise MotionError(f"{path}:1: no column {', '.join(missing)}")
        places = [header.index(name) for name in wanted]
        table, lines = array("d"), array("L")
        mag = ["0"] * 3
        for row in rows:
            if not row:
                continue
            try:
                cells = [row[place] for place in places]
                mag = cells[-3:] = cells[-3:] if any(cells[-3:]) else mag
                table.extend([float(cell) for cell in cells])
            except IndexError:
                raise MotionError(
                    f"{path}:{rows.line_num}: {len(row)} columns, not {len(header)}"
                ) from None
            except ValueError as error:
                raise MotionError(f"{path}:{rows.line_num}: {error}") from None
            lines.append(rows.line_num)
    if len(lines) < 2:
        raise MotionError(f"{path}: {len(lines)} records; at least 2 are needed")
    values = np.frombuffer(table).reshape(len(lines), -1)
    try:
        rate_hz, even, _ = evened(values[:, 0] * CSV_TIMES[time], values[:, 1:])
    except UnevenTimes as error:
        raise MotionError(f"{path}:{lines[error.row]}: {error}") from error
    return Motion(rate_hz, gyr=even[:, :3], acc=even[:, 3:6], mag=even[:, 6:])


def _short(path: Path, file: Iterable[str]) -> Iterator[str]:
    """The lines of a file. MotionError for one that no table has: each would become a
    list of its cells.
    """
    for number, line in enumerate(file, start=1):
        if len(line) > LINE_MAX:
            raise MotionError(f"{path}:{number}: longer than {LINE_MAX} characters")
        yield line


class UnevenTimes(ValueError):
    """Times from which no constant rate follows; `row` is the first that is off."""

    def __init__(self, row: int, text: str) -> None:
        super().__init__(text)
        self.row = row


def evened(t_s: FloatArray, table: FloatArray) -> tuple[float, FloatArray, int]:
    """Rate in Hz, and a row for each moment of it: of `table`, shape (n, m), with times
    t_s, and between its neighbours where one is missing. Also how many are. UnevenTimes
    if more than FILL_S are, or the rate is not constant.
    """
    steps = np.diff(t_s)
    usual = float(np.median(steps))
    if not usual > 0.0:
        raise UnevenTimes(1, "times do not increase")
    # Rounding to milliseconds moves a record by less, up to 500 Hz.
    counts = np.rint(steps / usual)
    bad = np.flatnonzero((counts < 1) | (steps > max(FILL_S, 1.5 * usual)))
    if bad.size:
        raise UnevenTimes(
            int(bad[0]) + 1,
            f"{steps[bad[0]]:g} s after the record before, where {usual:g} s are "
            f"usual: records may be missing for {FILL_S:g} s, and none twice",
        )
    places = np.concatenate([[0.0], np.cumsum(counts)])
    rate_hz = float(places[-1] / (t_s[-1] - t_s[0]))
    drift = np.abs(t_s - t_s[0] - places / rate_hz) * rate_hz
    worst = int(np.argmax(drift))
    if drift[worst] > 1.0:
        raise UnevenTimes(
            worst,
            f"{drift[worst]:.1f} records off a constant rate of {rate_hz:g} Hz",
        )
    every = np.arange(int(places[-1]) + 1)
    even = np.column_stack([np.interp(every, places, each) for each in table.T])
    return rate_hz, even, len(every) - len(t_s)


def write_stream(file: IO[bytes], motions: Iterable[Motion], count: int = 0) -> None:
    """Writes the pieces of a motion as the simulator's binary stream.

    A `count` of 0 leaves the number of records open. Each piece is flushed, so that the
    reader can begin at once.
    """
    is_begun = False
    for piece in motions:
        if not is_begun:
            flags = STREAM_RECORDED if piece.is_recorded else 0
            file.write(STREAM_HEADER.pack(STREAM_MAGIC, piece.rate_hz, count, flags))
            is_begun = True
        records = np.hstack([piece.gyr, piece.acc, piece.mag]).astype("<f4")
        file.write(records.tobytes())
        file.flush()
