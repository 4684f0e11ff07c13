# SPDX-License-Identifier: MIT
"""`imud export`: logs as tables, a file for each probe and topic."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

import msgspec

from imud.errors import FileError
from imud.logs import Damage, Logged, salvage
from imud.progress import Progress

# Columns of each topic in their order: of an object's key its parts, or itself.
_HEAD = {
    key: (key,)
    for key in (
        "t_ns",
        "t_bound_us",
        "age_us",
        "t_device_us",
        "seq",
        "number",
        "missing",
    )
}


def _parts(key: str, parts: str = "xyz") -> tuple[str, ...]:
    return tuple(f"{key}_{part}" for part in parts)


COLUMNS: dict[str, dict[str, tuple[str, ...]]] = {
    "pose": {
        **_HEAD,
        "q": _parts("q", "wxyz"),
        "position_m": _parts("position_m"),
        "normal": _parts("normal"),
        "tilt_sigma_deg": ("tilt_sigma_deg",),
        "heading_sigma_deg": ("heading_sigma_deg",),
        "flags": ("flags",),
    },
    "raw": {
        **_HEAD,
        "acc_m_s2": _parts("acc_m_s2"),
        "gyr_rad_s": _parts("gyr_rad_s"),
        "mag_uT": _parts("mag_uT"),
        "temperature_c": ("temperature_c",),
        "acc_counts": _parts("acc_counts"),
        "gyr_counts": _parts("gyr_counts"),
        "mag_counts": _parts("mag_counts"),
        "flags": ("flags",),
    },
    "event": {**_HEAD, "event": ("event",), "cause": ("cause",), "detail": ("detail",)},
}

_WORDS = frozenset({"flags", "event", "cause"})
_INTEGERS = (*_HEAD, "acc_counts", "gyr_counts", "mag_counts", "detail")

GROUP = 16384  # rows of a Parquet group: a minute and more of one probe

Cell = int | float | str | None


class Table(Protocol):
    """A file that takes rows."""

    rows: int

    def add(self, row: list[Cell]) -> None: ...
    def close(self) -> None: ...


class CsvTable:
    """Comma-separated, a line of names first; empty is not available."""

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
    """Typed columns, by pyarrow."""

    def __init__(self, path: Path, topic: str) -> None:
        import pyarrow
        from pyarrow import parquet

        fields = [
            (name, _arrow_type(pyarrow, key))
            for key, names in COLUMNS[topic].items()
            for name in names
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


def _arrow_type(pyarrow: Any, key: str) -> Any:
    if key in _WORDS:
        return pyarrow.string()
    return pyarrow.int64() if key in _INTEGERS else pyarrow.float64()


def names_of(topic: str) -> list[str]:
    return [name for names in COLUMNS[topic].values() for name in names]


def row_of(topic: str, said: Mapping[str, Any]) -> list[Cell]:
    row: list[Cell] = []
    for key, names in COLUMNS[topic].items():
        value = said.get(key)
        if len(names) > 1:
            row.extend(value if value is not None else [None] * len(names))
        elif isinstance(value, list):
            row.append(" ".join(map(str, value)))
        else:
            row.append(value)
    return row


def _kind(to: str) -> Callable[[Path, str], Table]:
    if to == "csv":
        return CsvTable
    try:
        import pyarrow.parquet  # noqa: F401 - whether it is there
    except ImportError as error:
        raise FileError(
            "Parquet is written by pyarrow, which is not there; pip install "
            "'imud[parquet]', or take --to csv"
        ) from error
    return ParquetTable


def run(path: Path, to: str, out: Path | None) -> int:
    """Writes STEM-PROBE-TOPIC.csv or .parquet, and says what each holds."""
    make = _kind(to)
    directory = out or path.parent
    tables: dict[Path, Table] = {}
    damages: list[Damage] = []
    is_done = False
    try:
        directory.mkdir(parents=True, exist_ok=True)
        try:
            for item in _items(path, damages):
                name = f"{path.stem}-{item.probe}-{item.topic}.{to}"
                file = directory / name
                if file not in tables:
                    tables[file] = make(file, item.topic)
                tables[file].add(row_of(item.topic, msgspec.json.decode(item.data)))
            is_done = True
        finally:
            for table in tables.values():
                table.close()
            if not is_done:
                for file in tables:
                    file.unlink(missing_ok=True)
    except FileExistsError as error:
        raise FileError(
            f"{error.filename} is there already; name another folder with --out"
        ) from error
    except OSError as error:
        raise FileError(f"can't export to {directory}: {error.strerror}") from error
    for file, table in tables.items():
        sys.stdout.write(f"{file}: {table.rows} rows\n")
    if not tables:
        sys.stdout.write(f"{path} holds no pose, raw or event\n")
    if damages:
        sys.stderr.write(f"{path} is cut off or damaged: what is good is exported\n")
    return 0


def _items(path: Path, damages: list[Damage]) -> Iterator[Logged]:
    bar = Progress("exporting", path.stat().st_size if path.exists() else 0)
    try:
        for item in salvage(path, bar.update):
            if isinstance(item, Damage):
                damages.append(item)
            elif isinstance(item, Logged) and item.topic in COLUMNS:
                yield item
    finally:
        bar.end()
