# SPDX-License-Identifier: MIT
"""`imud export`: writes logs as tables, one file for each probe and topic."""

from __future__ import annotations

import contextlib
import csv
import sys
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import msgspec
from msgspec import inspect

from imud import published
from imud.columns import inert, parts_of
from imud.errors import FileError
from imud.log.reader import Logged
from imud.probes.signs import Signs
from imud.recordings.damage import DamageCount
from imud.recordings.each_log import each_of, items_of, tell_flaws, tell_fused
from imud.recordings.fused import FusedLog
from imud.rotation import Quat, angles_deg
from imud.stages import COMPUTED

# The range of an integer column, and of the integers that a double holds exactly.
_INT64, _EXACT = 1 << 63, 1 << 53

UTC_LEAST_S = 946_684_800  # the year 2000: a time before it is since a start

GROUP = 16384  # rows in a Parquet group: more than a minute of one probe

Cell = int | float | str | None


def _word(value: Any) -> Cell:
    if isinstance(value, list):
        return inert(" ".join(map(str, value)))
    return inert(value) if isinstance(value, str) else None


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

# Of each topic: a key of the JSON, and its columns, in order.
COLUMNS: dict[str, dict[str, Column]] = {
    "pose": _columns(published.PoseFields, *_HEAD),
    "raw": _columns(published.Raw, *_HEAD),
    "event": _columns(published.Event, *_HEAD),
    "stroke": _columns(published.Stroke, *_HEAD),
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

    def add(self, row: list[Cell]) -> None: ...
    def close(self) -> None: ...


class CsvTable:
    """CSV with a line of names; an empty cell means not available."""

    def __init__(self, path: Path, topic: str) -> None:
        self._file = path.open("x", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(names_of(topic))
        self.rows = 0

    def add(self, row: list[Cell]) -> None:
        self._writer.writerow(row)
        self.rows += 1

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
        self._waiting: list[list[Cell]] = []
        self.rows = 0

    def add(self, row: list[Cell]) -> None:
        self._waiting.append(row)
        self.rows += 1
        if len(self._waiting) == GROUP:
            self._write()

    def close(self) -> None:
        try:
            self._write()
            self._writer.close()
        finally:
            self._file.close()

    def _write(self) -> None:
        if self._waiting:
            columns = [list(column) for column in zip(*self._waiting, strict=True)]
            arrays = [
                self._arrow.array(column, field.type)
                for column, field in zip(columns, self._schema, strict=True)
            ]
            self._writer.write_table(
                self._arrow.Table.from_arrays(arrays, schema=self._schema)
            )
            self._waiting.clear()


def names_of(topic: str) -> list[str]:
    return [name for column in COLUMNS[topic].values() for name in column.names]


def row_of(topic: str, fields: Mapping[str, Any]) -> list[Cell]:
    """A row of a table. A value of an unexpected type counts as not available."""
    row: list[Cell] = []
    for path, count, cell in _plan(topic):
        value: Any = fields
        for part in path:
            value = value.get(part) if isinstance(value, dict) else None
        if count == 1:
            row.append(cell(value))
        elif isinstance(value, list) and len(value) == count:
            row.extend(map(cell, value))
        else:
            row.extend([None] * count)
    return row


@cache
def _plan(topic: str) -> list[tuple[list[str], int, Callable[[Any], Cell]]]:
    """Of each key of a table: where its value stands, its columns, and their kind."""
    return [
        (key.split("."), len(column.names), column.cell)
        for key, column in COLUMNS[topic].items()
    ]


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
    tables: dict[Path, Table] = {}
    signs: defaultdict[str, Signs] = defaultdict(Signs)
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
                name = f"{path.stem}-{item.probe}-{item.topic}.{to}"
                file = directory / _printable(name)
                if file not in tables:
                    tables[file] = make(file, item.topic)
                if item.topic == "pose":
                    _steady(fields, signs[item.probe])
                if "q" in fields:
                    _add_angles(fields)
                _add_time(fields)
                tables[file].add(row_of(item.topic, fields))
            is_done = True
        finally:
            for table in tables.values():
                table.close()
            if not is_done:
                for file in tables:
                    file.unlink(missing_ok=True)
    except FileExistsError as error:
        raise FileError(
            f"{error.filename} already exists; choose another folder with --out"
        ) from error
    except OSError as error:
        raise FileError(f"can't export to {directory}: {error.strerror}") from error
    for file, table in tables.items():
        sys.stdout.write(f"{file}: {table.rows} rows\n")
    if not tables:
        sys.stdout.write(f"{path} has no messages for a table\n")
    tell_fused(fused)
    tell_flaws(path, strange, damage)


def _steady(pose: dict[str, Any], signs: Signs) -> None:
    """Gives its quaternion, if it is one, the sign that continues the last one's."""
    with contextlib.suppress(KeyError, msgspec.ValidationError):
        q = msgspec.convert(pose["q"], Quat, strict=True)
        t_us = msgspec.convert(pose["t_device_us"], float)
        pose["q"] = [*signs.steady(q, t_us)]


def _add_angles(fields: dict[str, Any]) -> None:
    """The nautical angles of its quaternion, if it is one."""
    with contextlib.suppress(msgspec.ValidationError):
        q = msgspec.convert(fields["q"], Quat, strict=True)
        fields["angles_deg"] = [*angles_deg(q, "nautical")]


def _add_time(fields: dict[str, Any]) -> None:
    """Its time as people and spreadsheets read it. A capture has the probe's alone."""
    with contextlib.suppress(KeyError, TypeError, ValueError, OverflowError, OSError):
        seconds, ns = divmod(fields["t_ns"], 10**9)
        if seconds >= UTC_LEAST_S:
            time = datetime.fromtimestamp(seconds, UTC)
            fields["time_utc"] = f"{time:%Y-%m-%dT%H:%M:%S}.{ns // 1000:06d}Z"


def _fields_of(item: Logged) -> dict[str, Any] | None:
    with contextlib.suppress(msgspec.DecodeError, UnicodeDecodeError):
        return msgspec.json.decode(item.data, type=dict[str, Any])
    return None


def _printable(name: str) -> str:
    return "".join(each if each.isprintable() else "_" for each in name)
