# SPDX-License-Identifier: MIT
"""`imud export`: writes logs as tables, one file for each probe and topic."""

from __future__ import annotations

import contextlib
import csv
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import lru_cache
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
from msgspec import inspect

from imud import published
from imud.columns import inert, parts_of
from imud.errors import FileError
from imud.log.reader import Logged
from imud.probes.signs import Signs
from imud.recordings.damage import DamageCount
from imud.recordings.each_log import each_of, items_of, tell_flaws, tell_fused
from imud.recordings.fused import FusedLog
from imud.rotation import Quat, to_yaw_pitch_roll
from imud.stages import COMPUTED

# The range of an integer column, and of the integers that a double holds exactly.
_INT64, _EXACT = 1 << 63, 1 << 53

UTC_LEAST_S = 946_684_800  # the year 2000: a time before it is since a start
UTC_END_S = 253_402_300_800  # the year 10,000

GROUP = 16384  # rows in a Parquet group: more than a minute of one probe
BLOCK = 1024  # objects that become rows at once

Cell = int | float | str | None
Columns = list[Sequence[Cell]]


def _word(value: Any) -> Cell:
    if isinstance(value, list | tuple):
        value = " ".join(map(str, value))
    return _inert(value) if isinstance(value, str) else None


_inert = lru_cache(maxsize=64)(inert)  # most columns hold few different words


def _integer(value: Any) -> Cell:
    if not isinstance(value, int) or isinstance(value, bool):
        return None
    return value if -_INT64 <= value < _INT64 else None


def _number(value: Any) -> Cell:
    if isinstance(value, float):
        return value
    if not isinstance(value, int) or isinstance(value, bool):
        return None
    return value if -_EXACT <= value < _EXACT else None


class Column(NamedTuple):
    """The columns of one value of the JSON, and what their cells hold."""

    names: tuple[str, ...]
    cell: Callable[[Any], Cell]


def _named(cell: Callable[[Any], Cell], *keys: str) -> dict[str, Column]:
    """Columns that are keys of the JSON; a dot reaches into an object."""
    return {key: Column((key.replace(".", "_"),), cell) for key in keys}


def _columns(of: type[msgspec.Struct], *first: str) -> dict[str, Column]:
    """The columns of an object in order, these first; `time_utc` is one, too."""
    found = _named(_word, "time_utc")
    for field in inspect.type_info(of).fields:  # type: ignore[attr-defined] # a struct
        found |= _columns_of(field.name, field.type)
    rest = found.keys() - {"time_utc", "probe"}
    return {key: found[key] for key in (*first, *(k for k in found if k in rest))}


def _columns_of(key: str, kind: inspect.Type) -> dict[str, Column]:
    match kind:
        case inspect.UnionType(types=(one, inspect.NoneType())):
            return _columns_of(key, one)
        case inspect.StructType(fields=fields):
            parts = [_columns_of(f"{key}.{part.name}", part.type) for part in fields]
            return {name: each for part in parts for name, each in part.items()}
        case inspect.TupleType(item_types=items):
            cell = _integer if isinstance(items[0], inspect.IntType) else _number
            found = {key: Column(parts_of(key, "wxyz"[-len(items) :]), cell)}
            if key == "q":
                found["angles_deg"] = Column(("yaw_deg", "pitch_deg", "roll_deg"), cell)
            return found
        case inspect.IntType():
            return _named(_integer, key)
        case inspect.FloatType():
            return _named(_number, key)
        case inspect.StrType() | inspect.LiteralType():
            return _named(_word, key)
        case inspect.VarTupleType(item_type=inspect.StrType()):
            return _named(_word, key)
    return {}  # no cell holds it


_HEAD = (
    *("t_ns", "time_utc", "t_bound_us", "age_us", "utc_host", "utc_bound_us"),
    *("t_device_us", "seq", "number", "missing"),
)
_TWIN = _columns(published.Twin)
_PLACES = ("path_m", "closed_m", "closed_sigma_m")

# Of each topic: a key of the JSON, and its columns, in order.
COLUMNS: dict[str, dict[str, Column]] = {
    "pose": _columns(published.PoseFields, *_HEAD),
    "raw": _columns(published.Raw, *_HEAD),
    "event": _columns(published.Event, *_HEAD),
    "stroke": _columns(published.Stroke, *_HEAD),
    # A closed path: a row for each of its places.
    "path": {
        **_columns(published.Path, "t_ns", "time_utc"),
        **_named(_integer, "stroke"),
        **{key: Column(parts_of(key, "xyz"), _number) for key in _PLACES},
    },
    "command": _columns(published.Command, "t_ns", "time_utc"),
    "mark": _columns(published.Mark, "t_ns", "time_utc"),
    # The parts of a status that are numbers at each moment.
    "status": {
        **_named(_integer, "t_ns"),
        **_named(_word, "time_utc", "state", "port"),
        **_named(_number, "pose_rate_hz"),
        **_named(_integer, "ledger.sent", "ledger.received", "ledger.lost"),
        **_named(_integer, "ledger.duplicated", "ledger.corrupt", "clock.offset_ns"),
        **_named(_number, "clock.skew_ppm"),
        **_named(_integer, "clock.bound_us", "counters.samples_ready"),
        **_named(_integer, "counters.samples_read", "counters.samples_fused"),
        **_named(_integer, "counters.overruns", "counters.bus_faults"),
        **_named(_integer, "counters.messages_sent", "counters.messages_dropped"),
        **_named(_word, "log.state", "twin.state"),
    },
    "twin": {
        key: _TWIN[key]
        for key in ("t_ns", "t_device_us", "seq", "state", "compared", "differed")
    },
    "clock": _columns(published.Clock),
    "log": _columns(published.Log),
}


class Table(Protocol):
    """A file to write rows to."""

    rows: int

    def add(self, columns: Columns) -> None: ...
    def close(self) -> None: ...


class CsvTable:
    """CSV with a line of names; an empty cell means not available."""

    def __init__(self, path: Path, topic: str) -> None:
        self._file = path.open("x", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(names_of(topic))
        self.rows = 0

    def add(self, columns: Columns) -> None:
        self._writer.writerows(zip(*columns, strict=True))
        self.rows += len(columns[0])

    def close(self) -> None:
        self._file.close()


class ParquetTable:
    """Parquet with typed columns, by pyarrow."""

    def __init__(self, path: Path, topic: str) -> None:
        import pyarrow
        from pyarrow import parquet

        kinds: dict[Callable[[Any], Cell], Any] = {
            _word: pyarrow.string(),
            _integer: pyarrow.int64(),
            _number: pyarrow.float64(),
        }
        fields = [
            (name, kinds[column.cell])
            for column in COLUMNS[topic].values()
            for name in column.names
        ]
        self._arrow = pyarrow
        self._schema = pyarrow.schema(fields)
        self._file = path.open("xb")
        self._writer = parquet.ParquetWriter(
            self._file, self._schema, compression="zstd"
        )
        self._waiting: list[list[Cell]] = [[] for _ in fields]
        self.rows = 0

    def add(self, columns: Columns) -> None:
        for waiting, column in zip(self._waiting, columns, strict=True):
            waiting += column
        self.rows += len(columns[0])
        if len(self._waiting[0]) >= GROUP:
            self._write()

    def close(self) -> None:
        try:
            self._write()
            self._writer.close()
        finally:
            self._file.close()

    def _write(self) -> None:
        if self._waiting[0]:
            arrays = [
                self._arrow.array(column, field.type)
                for column, field in zip(self._waiting, self._schema, strict=True)
            ]
            self._writer.write_table(
                self._arrow.Table.from_arrays(arrays, schema=self._schema)
            )
            for column in self._waiting:
                column.clear()


def names_of(topic: str) -> list[str]:
    return [name for column in COLUMNS[topic].values() for name in column.names]


def columns_of(topic: str, objects: Sequence[Mapping[str, Any]]) -> Columns:
    """The columns of a table. A value of an unexpected type counts as not available."""
    columns: Columns = []
    for key, column in COLUMNS[topic].items():
        first, *rest = key.split(".")
        values: list[Any] = [each.get(first) for each in objects]
        for part in rest:
            values = [v.get(part) if isinstance(v, dict) else None for v in values]
        count = len(column.names)
        if count == 1:
            columns.append(_cells(column.cell, values))
            continue
        none = (None,) * count
        rows = [
            v if isinstance(v, list | tuple) and len(v) == count else none
            for v in values
        ]
        columns += [_cells(column.cell, each) for each in zip(*rows, strict=True)]
    return columns


def _cells(cell: Callable[[Any], Cell], values: Sequence[Any]) -> Sequence[Cell]:
    kinds = {*map(type, values)}
    is_plain = cell is _number and kinds <= {float, type(None)}
    return values if is_plain else [*map(cell, values)]


class _Objects:
    """Those of one probe and topic, which become rows of a table."""

    def __init__(self, topic: str, table: Table) -> None:
        self.table = table
        self._topic = topic
        self._signs = Signs()
        self._waiting: list[dict[str, Any]] = []

    def add(self, fields: dict[str, Any]) -> None:
        self._waiting.append(fields)
        if len(self._waiting) == BLOCK:
            self.write()

    def write(self) -> None:
        if self._waiting:
            self._complete()
            self.table.add(columns_of(self._topic, self._waiting))
            self._waiting.clear()

    def _complete(self) -> None:
        """Adds a time that people read. A quaternion, if it is one, gets the sign that
        continues the last pose's, and its nautical angles.
        """
        turned, quats = [], []
        for fields in self._waiting:
            fields["time_utc"] = _utc(fields.get("t_ns"))
            try:
                q = msgspec.convert(fields.get("q"), Quat)
            except msgspec.ValidationError:
                continue
            if self._topic == "pose":
                t_us = fields.get("t_device_us")
                q = self._signs.steady(q, t_us if isinstance(t_us, int) else None)
                fields["q"] = q
            turned.append(fields)
            quats.append(q)
        if turned:
            angles = np.degrees(to_yaw_pitch_roll(np.array(quats))).tolist()
            for fields, each in zip(turned, angles, strict=True):
                fields["angles_deg"] = each


def _utc(t_ns: object) -> str | None:
    """A time as people and spreadsheets read it. A capture has the probe's alone."""
    if not isinstance(t_ns, int) or not UTC_LEAST_S <= t_ns // 10**9 < UTC_END_S:
        return None
    seconds, ns = divmod(t_ns, 10**9)
    return f"{_second(seconds)}.{ns // 1000:06d}Z"


@lru_cache(maxsize=16)  # a probe's messages of a second come together
def _second(utc_s: int) -> str:
    return f"{datetime.fromtimestamp(utc_s, UTC):%Y-%m-%dT%H:%M:%S}"


def _kind(to: str) -> Callable[[Path, str], Table]:
    if to == "csv":
        return CsvTable
    try:
        import pyarrow.parquet  # noqa: F401 - to see whether it is installed
    except ImportError as error:
        raise FileError(
            "writing Parquet needs pyarrow: pip install 'imu-probe[parquet]', or use "
            "--to csv"
        ) from error
    return ParquetTable


def run(
    paths: Sequence[Path], to: str, out: Path | None, *, is_fused: bool = False
) -> int:
    """Writes the tables of each log, or those of what is computed of its raw samples;
    returns 0.

    Raises FileError for logs that can't be exported or are damaged, after all are done.
    """
    make = _kind(to)
    return each_of(
        paths,
        lambda log, by: _export(
            log, to, make, out or by, FusedLog() if is_fused else None
        ),
    )


def _export(
    path: Path,
    to: str,
    make: Callable[[Path, str], Table],
    directory: Path,
    fused: FusedLog | None,
) -> None:
    """Writes STEM-PROBE-TOPIC.csv or .parquet, and prints what each holds."""
    tables: dict[tuple[str, str], _Objects] = {}
    files: list[Path] = []
    damage = DamageCount()
    strange = 0
    is_done = False
    try:
        directory.mkdir(parents=True, exist_ok=True)
        try:
            for item in items_of(path, COMPUTED if fused else COLUMNS, damage, fused):
                fields = _fields_of(item)
                if fields is None:
                    strange += 1
                    continue
                found = tables.get((item.probe, item.topic))
                if found is None:
                    name = _printable(f"{path.stem}-{item.probe}-{item.topic}.{to}")
                    table = make(directory / name, item.topic)
                    files.append(directory / name)
                    found = _Objects(item.topic, table)
                    tables[item.probe, item.topic] = found
                for row in _rows_of(fields) if item.topic == "path" else (fields,):
                    found.add(row)
            for found in tables.values():
                found.write()
            is_done = True
        finally:
            for found in tables.values():
                found.table.close()
            if not is_done:
                for file in files:
                    file.unlink(missing_ok=True)
    except FileExistsError as error:
        raise FileError(
            f"{error.filename} already exists; choose another folder with --out"
        ) from error
    except OSError as error:
        raise FileError(f"can't export to {directory}: {error.strerror}") from error
    for file, found in zip(files, tables.values(), strict=True):
        sys.stdout.write(f"{file}: {found.table.rows} rows\n")
    if not tables:
        sys.stdout.write(f"{path} has no messages for a table\n")
    tell_fused(fused)
    tell_flaws(path, strange, damage)


def _fields_of(item: Logged) -> dict[str, Any] | None:
    if item.values is not None:
        return item.values
    with contextlib.suppress(msgspec.DecodeError, UnicodeDecodeError):
        return msgspec.json.decode(item.data, type=dict[str, Any])
    return None


def _rows_of(path: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The places of a closed path, one by one."""
    places = [v if isinstance(v := path.get(key), list) else [] for key in _PLACES]
    for number, each in enumerate(zip_longest(*places), 1):
        yield path | {"stroke": number} | dict(zip(_PLACES, each, strict=True))


def _printable(name: str) -> str:
    return "".join(each if each.isprintable() else "_" for each in name)
