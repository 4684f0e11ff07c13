# SPDX-License-Identifier: MIT
"""Tables of others: what text, NumPy, Parquet and ROS bags hold, as columns by name."""

from __future__ import annotations

import itertools
import re
import subprocess
import sys
import unicodedata
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from imud.errors import FileError, reason
from imud.recordings import foreign_mat
from imud.recordings.foreign_text import (
    UNPACKED_MAX,
    UNPACKED_TIMES,
    UTF16,
    ForeignTable,
    is_alike,
    is_packed,
    opened,
    read_text,
)
from imud.rotation import FloatArray
from imud.virtual.npz import arrays_of

TEXTS = (".csv", ".tsv", ".txt", ".dat")
KINDS = (*TEXTS, ".npz", ".mat", ".parquet", ".bag", ".db3")
BAG = "metadata.yaml"  # in the folder of a bag of ROS 2

IMU, FIELD = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField"

HEAD = 4096  # bytes by which a text is known


def is_foreign(path: Path) -> bool:
    """Whether a file, or a folder, is one of these. What a UART said has zeros in it,
    and so is no text.
    """
    inner = path.with_suffix("") if is_packed(path) else path
    if inner.suffix.lower() not in TEXTS:
        return path.suffix.lower() in KINDS or (path / BAG).is_file()
    try:
        with opened(path) as file:
            head = file.read(HEAD)
            return head[:2] in UTF16 or b"\0" not in head
    except OSError:
        return False


def parts(
    path: Path, only: Mapping[str, str] | None = None, topics: tuple[str, ...] = ()
) -> Iterator[ForeignTable]:
    """The rows whose columns hold what `only` says; `topics`: those of a bag, or the
    structs of a .mat, that are read, empty: any. FileError with what is wrong.
    """
    only = only or {}
    suffix = path.suffix.lower()
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise FileError(f"{path} is a pipe, and is read more than once: use a file")
    try:
        if suffix in (".bag", ".db3", ".mcap") or (path / "metadata.yaml").exists():
            yield _bag(path, topics)
        elif suffix in READERS:
            yield _chosen(path, READERS[suffix](path, topics), only)
        else:
            yield from read_text(path, only)
    except OSError as error:
        raise FileError(f"can't read {path}: {error.strerror or error}") from error


def _chosen(path: Path, table: ForeignTable, only: Mapping[str, str]) -> ForeignTable:
    """Its rows that hold what `only` says. FileError if there are none."""
    is_it = np.ones(len(table), bool)
    for name, wanted in only.items():
        if name not in table.columns:
            there = ", ".join(table.columns)
            raise FileError(f"{path} has no column of numbers {name}: {there}")
        is_it &= [is_alike(str(cell), wanted) for cell in table.columns[name].tolist()]
    if not is_it.any():
        raise FileError(f"{path}: --only fits no row")
    columns = {name: column[is_it] for name, column in table.columns.items()}
    return replace(table, columns=columns)


def _npz(path: Path, _: tuple[str, ...]) -> ForeignTable:
    try:
        with zipfile.ZipFile(path) as archive:
            keys = [name.removesuffix(".npy") for name in archive.namelist()]
        return _flat(path, arrays_of(path, keys))
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise FileError(f"{path}: not a .npz of plain arrays: {error}") from error


def _mat(path: Path, topics: tuple[str, ...]) -> ForeignTable:
    """Of several structs with a force one has to be chosen. FileError names them."""
    arrays, others = foreign_mat.arrays_of(path)
    structs = {name.rpartition(".")[0] for name in arrays if _is_force(name)}
    if not topics and len(structs) > 1:
        there = ", ".join(sorted(structs, key=lambda name: (len(name), name)))
        raise FileError(f"{path} has several: choose one with --topic: {there}")
    for topic in topics:
        inner = [n for n in arrays if n == topic or n.startswith(f"{topic}.")]
        if not inner:
            raise FileError(f"{path} has no {topic}: {', '.join(arrays)}")
        arrays = {name: arrays[name] for name in inner}
    return _flat(path, arrays, others)


def _parquet(path: Path, _: tuple[str, ...]) -> ForeignTable:
    """Of a file of texts or long lists only the columns of numbers are unpacked."""
    try:
        import pyarrow
        from pyarrow import parquet, types
    except ImportError as error:
        raise FileError(
            f"{path}: reading Parquet needs pyarrow: pip install 'imu-probe[parquet]'"
        ) from error
    try:
        file = parquet.ParquetFile(path)
        kinds = {field.name: field.type for field in file.schema_arrow}
        wanted = [name for name in kinds if _is_numeric(kinds[name])]
        lists = [name for name in wanted if types.is_nested(kinds[name])]
        flat = file.metadata.num_rows * (len(wanted) - len(lists))
        size = 8 * (flat + _values_in(path, lists))
        if size > UNPACKED_MAX + UNPACKED_TIMES * path.stat().st_size:
            raise FileError(f"{path} takes too much memory: {size / 1e6:.0f} MB")
        table = file.read(columns=wanted)
        arrays = dict(zip(wanted, map(_array_of, table.columns), strict=True))
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise FileError(f"{path} is not a Parquet file: {reason(error)}") from error
    return _flat(path, arrays, tuple(name for name in kinds if name not in wanted))


def _is_numeric(kind: Any) -> bool:
    from pyarrow import types

    if types.is_list(kind) or types.is_fixed_size_list(kind):
        kind = kind.value_type
    tests = types.is_integer, types.is_floating, types.is_decimal
    times = types.is_timestamp, types.is_duration
    return any(test(kind) for test in (*tests, *times))


# pyarrow aborts at damaged statistics of a column, so a process of its own asks.
COUNT_VALUES = """
import sys
from pyarrow.parquet import ParquetFile
path, *names = sys.argv[1:]
about = ParquetFile(path).metadata
groups = [about.row_group(at) for at in range(about.num_row_groups)]
leaves = [group.column(at) for group in groups for at in range(group.num_columns)]
names = {*names}
print(sum(x.num_values for x in leaves if x.path_in_schema.split(".")[0] in names))
"""


def _values_in(path: Path, names: list[str]) -> int:
    """How many values columns of lists hold. ValueError: its head is damaged."""
    if not names:
        return 0
    words = [sys.executable, "-c", COUNT_VALUES, str(path), *names]
    done = subprocess.run(words, capture_output=True, check=False)
    if done.returncode != 0:
        raise ValueError("its statistics are damaged")
    return int(done.stdout)


def _array_of(column: Any) -> Any:
    """Lists of one length become rows."""
    from pyarrow import types

    if types.is_nested(column.type):
        flat = column.combine_chunks().flatten().to_numpy(zero_copy_only=False)
        return flat.reshape(len(column), -1)
    is_decimal = types.is_decimal(column.type)
    return (column.cast("float64") if is_decimal else column).to_numpy()


def _is_force(name: str) -> bool:
    return any(part.startswith("acc") for part in words(name))


def _flat(
    path: Path, arrays: Mapping[str, Any], texts: tuple[str, ...] = ()
) -> ForeignTable:
    """Rows are as many as a force has, else the most; arrays of shape (n, k) or (k, n)
    are k columns; a lone number is a rate and the like.
    """
    sizes = {name: max(np.shape(array), default=1) for name, array in arrays.items()}
    forces = [sizes[name] for name in sizes if _is_force(name) and sizes[name] > 1]
    rows = max(forces or sizes.values(), default=0)
    found: dict[str, FloatArray] = {}
    clocks = set()
    for name, values in arrays.items():
        array = np.atleast_1d(values)
        if array.dtype.kind in "mM" and array.shape == (rows,):
            since = np.array(0, array.dtype)  # 1970, or no duration
            array = (array - since) / np.timedelta64(1, "s")
            clocks.add(name)
        if array.dtype.kind not in "fiu":
            continue
        if array.size == 1:
            found[name] = np.full(rows, float(array.ravel()[0]))
        elif array.shape == (rows,):
            found[name] = array.astype(float)
        elif array.ndim == 2 and rows in array.shape:
            array = array if len(array) == rows else array.T
            tags = "xyz" if array.shape[1] == 3 else range(1, 1 + array.shape[1])
            for tag, column in zip(tags, array.T, strict=True):
                found[f"{name}_{tag}"] = column.astype(float)
    if not found or rows == 0:
        raise FileError(f"{path} holds no columns of numbers")
    return ForeignTable(found, in_seconds=frozenset(clocks), texts=texts)


READERS = {".npz": _npz, ".mat": _mat, ".parquet": _parquet}


def _bag(path: Path, topics: tuple[str, ...]) -> ForeignTable:
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
        # Its YAML is warned of on lines of their own.
        with warnings.catch_warnings(action="ignore"), AnyReader([path]) as reader:
            if strange := {*topics} - {each.topic for each in reader.connections}:
                names = ", ".join(sorted(reader.topics))
                raise FileError(f"{path} has no topic {min(strange)}: {names}")
            wanted = [
                each
                for kind in (IMU, FIELD)
                for each in _of_kind(path, reader, kind, topics)
            ]
            if not any(each.msgtype == IMU for each in wanted):
                there = sorted(f"{e.topic} ({e.msgtype})" for e in reader.connections)
                raise FileError(
                    f"{path} has no topic of {IMU}; it has {', '.join(there) or 'none'}"
                )
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
    except (AnyReaderError, KeyError, ValueError, RecursionError) as error:
        raise FileError(f"{path} is not a readable bag: {error}") from error
    if not moved:
        raise FileError(f"{path} has no topic of sensor_msgs/Imu")
    return ForeignTable(_beside(np.array(moved), np.array(fields)), is_known=True)


def _of_kind(path: Path, reader: Any, kind: str, topics: tuple[str, ...]) -> list[Any]:
    """The connections of the one topic of a kind, the named one if there are several,
    or none.
    """
    found = [each for each in reader.connections if each.msgtype == kind]
    found = [each for each in found if each.topic in topics] or found
    if len({each.topic for each in found}) > 1:
        there = ", ".join(sorted({each.topic for each in found}))
        raise FileError(
            f"{path} has several topics of {kind}: choose one with --topic: {there}"
        )
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
    plain = unicodedata.normalize("NFKC", name)
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", plain)
    return [part for part in re.split(r"[\s_.,:()\[\]]+", spaced.lower()) if part]
