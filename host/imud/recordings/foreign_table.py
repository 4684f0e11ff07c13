# SPDX-License-Identifier: MIT
"""Tables of others: what text, NumPy, Parquet and ROS bags hold, as columns by name."""

from __future__ import annotations

import csv
import itertools
import re
import zipfile
import zlib
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imud.errors import FileError, reason
from imud.rotation import FloatArray
from imud.virtual.npz import arrays_of

TEXTS = (".csv", ".tsv", ".txt", ".dat")
KINDS = (*TEXTS, ".npz", ".parquet", ".bag", ".db3")
BAG = "metadata.yaml"  # in the folder of a bag of ROS 2

IMU, FIELD = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField"

LINE_MAX = 65536  # characters of a line of text
# Bytes that a packed file may become, and times its own size besides.
UNPACKED_MAX, UNPACKED_TIMES = 64_000_000, 16
SEPARATORS = (",", ";", "\t")
HEAD = 4096  # characters by which a text's separator is known


@dataclass(frozen=True, slots=True)
class ForeignTable:
    """Columns of numbers by name, each of shape (n,); NaN where there is nothing."""

    columns: Mapping[str, FloatArray]
    # In SI units with the times of ROS: nothing is to be guessed.
    is_known: bool = False

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def is_foreign(path: Path) -> bool:
    """Whether a file, or a folder, is one of these. What a UART said has zeros in it,
    and so is no text.
    """
    if path.suffix.lower() not in TEXTS:
        return path.suffix.lower() in KINDS or (path / BAG).is_file()
    try:
        with path.open("rb") as file:
            return b"\0" not in file.read(HEAD)
    except OSError:
        return False


def read(path: Path) -> ForeignTable:
    """FileError with what is wrong."""
    suffix = path.suffix.lower()
    try:
        if suffix in (".bag", ".db3") or (path / "metadata.yaml").exists():
            return _bag(path.parent if suffix == ".db3" else path)
        if suffix == ".npz":
            return ForeignTable(_flat(path, _npz(path)))
        if suffix == ".parquet":
            return ForeignTable(_flat(path, _parquet(path)))
        return ForeignTable(_text(path))
    except OSError as error:
        raise FileError(f"can't read {path}: {error.strerror or error}") from error


def _text(path: Path) -> dict[str, FloatArray]:
    """Reads lines with a separator. Names are in the last line before the first
    numbers; without one columns are called 1, 2, 3.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            separator = _separator(file.read(HEAD))
            file.seek(0)
            return _rows(path, _cells(path, file, separator))
    except UnicodeDecodeError as error:
        raise FileError(f"{path} is not a text file of numbers") from error


def _separator(head: str) -> str | None:
    """None: blanks."""
    lines = [line for line in head.splitlines() if line and not line.startswith("#")]
    for separator in SEPARATORS:
        if lines and all(separator in line for line in lines[-3:]):
            return separator
    return None


def _cells(
    path: Path, file: Iterator[str], separator: str | None
) -> Iterator[tuple[int, list[str]]]:
    def short() -> Iterator[str]:
        for number, line in enumerate(file, start=1):
            if len(line) > LINE_MAX:
                raise FileError(f"{path}:{number}: longer than {LINE_MAX} characters")
            yield line

    if separator is None:
        for number, line in enumerate(short(), start=1):
            yield number, line.split()
        return
    rows = csv.reader(short(), delimiter=separator)
    for row in rows:
        yield rows.line_num, [cell.strip() for cell in row]


def _rows(path: Path, cells: Iterator[tuple[int, list[str]]]) -> dict[str, FloatArray]:
    names: list[str] = []
    table, width = array("d"), 0  # eight bytes a cell
    for number, row in cells:
        if not any(row):
            continue
        values = _numbers(row)
        if values is None and not width:
            first = row[0].lstrip("#% ")
            names = [first, *row[1:]]
        elif values is None:
            raise FileError(f"{path}:{number}: not all values are numbers")
        elif width and len(values) != width:
            raise FileError(f"{path}:{number}: {len(values)} columns, not {width}")
        else:
            width = len(values)
            table.extend(values)
    if not width:
        raise FileError(f"{path} holds no numbers")
    if len(names) != width:
        names = [str(1 + at) for at in range(width)]
    return dict(zip(names, np.frombuffer(table).reshape(-1, width).T, strict=True))


def _numbers(row: list[str]) -> list[float] | None:
    """The numbers of cells; an empty one is NaN. None if one is something else."""
    try:
        return [float(cell) if cell else np.nan for cell in row]
    except ValueError:
        return None


def _npz(path: Path) -> dict[str, Any]:
    try:
        with zipfile.ZipFile(path) as archive:
            keys = [name.removesuffix(".npy") for name in archive.namelist()]
        return dict(arrays_of(path, keys))
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise FileError(f"{path}: not a .npz of plain arrays: {error}") from error


def _parquet(path: Path) -> dict[str, Any]:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise FileError(
            f"{path}: reading Parquet needs pyarrow: pip install 'imu-probe[parquet]'"
        ) from error
    try:
        about = parquet.read_metadata(path)
        size = 8 * about.num_rows * about.num_columns
        if size > UNPACKED_MAX + UNPACKED_TIMES * path.stat().st_size:
            raise FileError(f"{path} takes too much memory: {size / 1e6:.0f} MB")
        table = parquet.read_table(path)
    except (pyarrow.ArrowException, OSError) as error:
        raise FileError(f"{path} is not a Parquet file: {reason(error)}") from error
    found = {}
    for name in table.column_names:
        column = table.column(name)
        if pyarrow.types.is_timestamp(column.type):
            column = column.cast(pyarrow.int64())
        found[name] = column.to_numpy()
    return found


def _flat(path: Path, arrays: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Arrays of shape (n, 3) as three columns; a lone number is a rate and the like."""
    rows = max((len(a) for a in map(np.atleast_1d, arrays.values())), default=0)
    found: dict[str, FloatArray] = {}
    for name, values in arrays.items():
        array = np.atleast_1d(values)
        if array.dtype.kind not in "fiu":
            continue
        if array.ndim == 2 and array.shape == (3, rows) and rows != 3:
            array = array.T
        if array.ndim == 1 and len(array) == rows:
            found[name] = array.astype(float)
        elif array.ndim == 2 and array.shape == (rows, 3):
            for axis, column in zip("xyz", array.T, strict=True):
                found[f"{name}_{axis}"] = column.astype(float)
        elif array.size == 1:
            found[name] = np.full(rows, float(array.ravel()[0]))
    if not found or rows == 0:
        raise FileError(f"{path} holds no columns of numbers")
    return found


def _bag(path: Path) -> ForeignTable:
    """The topics with sensor_msgs/Imu and sensor_msgs/MagneticField, if there is one of
    each.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
    except ImportError as error:
        raise FileError(
            f"{path}: reading bags needs rosbags: pip install 'imu-probe[rosbag2]'"
        ) from error
    try:
        with AnyReader([path]) as reader:
            wanted = [*_only(path, reader, IMU), *_only(path, reader, FIELD)]
            moved, fields = [], []
            for connection, _, raw in reader.messages(connections=wanted):
                message: Any = reader.deserialize(raw, connection.msgtype)
                stamp = message.header.stamp
                t_s = stamp.sec + stamp.nanosec * 1e-9
                if connection.msgtype == IMU:
                    acc, gyr = message.linear_acceleration, message.angular_velocity
                    moved.append((t_s, acc.x, acc.y, acc.z, gyr.x, gyr.y, gyr.z))
                else:
                    field = message.magnetic_field
                    fields.append((t_s, field.x, field.y, field.z))
    except (AnyReaderError, KeyError, ValueError) as error:
        raise FileError(f"{path} is not a readable bag: {error}") from error
    if not moved:
        raise FileError(f"{path} has no topic of sensor_msgs/Imu")
    return ForeignTable(_beside(np.array(moved), np.array(fields)), is_known=True)


def _only(path: Path, reader: Any, kind: str) -> list[Any]:
    """The connections of the one topic of a kind, or none."""
    found = [each for each in reader.connections if each.msgtype == kind]
    if len({each.topic for each in found}) > 1:
        topics = ", ".join(sorted({each.topic for each in found}))
        raise FileError(f"{path} has several topics of {kind}: {topics}")
    return found


def _beside(moved: FloatArray, fields: FloatArray) -> dict[str, FloatArray]:
    """Each reading of the field goes to the next sample of the others."""
    order = np.argsort(moved[:, 0], kind="stable")
    moved = moved[order]
    mag = np.full((len(moved), 3), np.nan)
    if len(fields):
        at = np.searchsorted(moved[:, 0], fields[:, 0])
        there = at < len(moved)
        mag[at[there]] = fields[there, 1:]
    names = [
        f"{what}_{axis}" for what, axis in itertools.product(("acc", "gyr"), "xyz")
    ]
    columns = dict(zip(["time", *names], moved.T, strict=True))
    return columns | {f"mag_{axis}": mag[:, at] for at, axis in enumerate("xyz")}


def words(name: str) -> list[str]:
    """The parts of a column's name: AccX(m/s^2) is acc, x, m/s^2."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return [part for part in re.split(r"[\s_.,:()\[\]]+", spaced.lower()) if part]
