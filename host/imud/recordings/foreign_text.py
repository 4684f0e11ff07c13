# SPDX-License-Identifier: MIT
"""Tables of text: lines of cells, however a program or a spreadsheet wrote them.

A row is a line. Rows are read one by one; the form of the file is found by its first
lines.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import datetime
import gzip
import itertools
import math
import re
import zlib
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, TextIO, cast

import numpy as np

from imud.errors import FileError
from imud.rotation import FloatArray

LINE_MAX = 65536  # characters of a line
BLOCK = 4096  # lines that are read at once
PART = 200_000  # lines of a table, so that memory does not grow with the file
HEAD = 200  # lines by which the form is found: names, and rows below
SAMPLE = 50  # of them, the last ones, which are rows
MISSING = frozenset({"", "na", "n/a", "#n/a", "null", "none", "-", "--", "?"})
ESCAPED = "surrogateescape"  # bytes that are no UTF-8 stay
OTHERS_MAX = 8  # values of others that are named
UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
EPOCH = datetime.date(1970, 1, 1).toordinal()
# Bytes that a packed file may become, and times its own size besides.
UNPACKED_MAX, UNPACKED_TIMES = 64_000_000, 16
CLOCK = re.compile(
    r"(?:(\d{4})[-/](\d\d?)[-/](\d\d?)[T ]+)?(\d\d?):(\d\d):(\d\d(?:[.,:]\d*)?)"
    r" ?([ap]m)? ?(?:z|utc|([+-]\d\d):?(\d\d))?",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class ForeignTable:
    """Columns of numbers by name, each of shape (n,); NaN where there is nothing."""

    columns: Mapping[str, FloatArray]
    # In SI units with the times of ROS: nothing is to be guessed.
    is_known: bool = False
    in_seconds: frozenset[str] = frozenset()  # times that say so themselves
    unread: int = 0  # rows that are not in the columns
    why: str = ""  # about the first of them
    texts: tuple[str, ...] = ()  # columns that hold no numbers
    has_more: bool = False  # rows, in tables that follow
    end: int = 0  # bytes of the file that were read; 0: not known

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


@dataclass(frozen=True, slots=True)
class _Form:
    """How the cells of a line are written."""

    separator: str | None  # None: blanks
    has_decimal_comma: bool = False

    def cells(self, line: str) -> list[str]:
        if self.separator is None:
            row = line.split()
        elif '"' in line:
            row = next(csv.reader([line], delimiter=self.separator), [])
        else:
            row = line.split(self.separator)
        if self.has_decimal_comma:
            row = [cell.replace(",", ".") for cell in row]
        return [cell.strip() for cell in row]


FORMS = (
    *map(_Form, (",", ";", "\t", "|", None)),
    *(_Form(separator, True) for separator in (";", "\t", "|", None, ",")),
)


def opened(path: Path, mode: str = "rb", **how: Any) -> IO[Any]:
    """A file, or what is packed in it; OSError, later also EOFError or zlib.error."""
    open_it: Any = gzip.open if is_packed(path) else Path.open
    file: IO[Any] = open_it(path, mode, **how)
    return file


def is_packed(path: Path) -> bool:
    return path.suffix.lower() == ".gz"


def read_text(path: Path, only: Mapping[str, str]) -> Iterator[ForeignTable]:
    """The rows whose columns hold what `only` says, in tables of the same columns that
    take little memory. FileError with what is wrong; OSError.
    """
    try:
        with opened(path) as file:
            is_wide = file.read(2) in UTF16
        encoding, errors = ("utf-16", "replace") if is_wide else ("utf-8-sig", ESCAPED)
        with opened(path, "rt", encoding=encoding, errors=errors) as file:
            lines = _lines(path, iter(lambda: file.readline(LINE_MAX + 1), ""))
            head = list(itertools.islice(lines, HEAD))
            form = max(FORMS, key=lambda form: _count_numbers(form, head))
            layout = _layout(path, form, head)
            choice = _Choice.of(path, layout.names, only)
            ahead, has_more = head[layout.first :], True
            while has_more:
                rest = itertools.islice(itertools.chain(ahead, lines), PART)
                table = _table(layout, rest, choice)
                ahead = [*itertools.islice(lines, 1)]
                has_more = bool(ahead)
                if not has_more:
                    choice.check()
                end = 0 if is_packed(path) else cast(TextIO, file).buffer.tell()
                yield replace(table, has_more=has_more, end=end)
    except (EOFError, zlib.error) as error:
        raise FileError(f"{path}: not a whole .gz: {error}") from error


def _lines(path: Path, file: Iterable[str]) -> Iterator[tuple[int, str]]:
    """Numbered, without empty lines and the zeros that a power cut leaves."""
    room: float = UNPACKED_MAX + UNPACKED_TIMES * path.stat().st_size
    has_limit = is_packed(path)
    for number, line in enumerate(file, start=1):
        room -= len(line) if has_limit else 0
        text = line.strip("\0\r\n")
        if len(text) > LINE_MAX:
            raise FileError(f"{path}:{number}: longer than {LINE_MAX} characters")
        if room < 0:
            raise FileError(f"{path} unpacks to too much: unpack it yourself")
        if text.strip():
            yield number, text


class _Choice:
    """The rows of one device among several."""

    def __init__(self, path: Path, wanted: Mapping[int, str]) -> None:
        self._path, self._wanted = path, wanted
        self._others: set[str] = set()
        self._has_any = not wanted

    @staticmethod
    def of(path: Path, names: list[str], only: Mapping[str, str]) -> _Choice:
        """FileError for a column that is not there."""
        for name in only:
            if name not in names:
                raise FileError(f"{path} has no column {name}: {', '.join(names)}")
        return _Choice(path, {names.index(name): only[name] for name in only})

    @property
    def columns(self) -> Set[int]:
        """Those that choose, which are not read besides."""
        return self._wanted.keys()

    def takes(self, cells: list[str]) -> bool:
        if not self._wanted:
            return True
        found = [cells[at] if at < len(cells) else "" for at in self._wanted]
        is_it = all(map(is_alike, found, self._wanted.values()))
        self._has_any |= is_it
        if not is_it and len(self._others) < OTHERS_MAX:
            self._others.add("=".join(found))
        return is_it

    def check(self) -> None:
        """FileError if no row was taken."""
        if not self._has_any:
            others = ", ".join(sorted(self._others))
            raise FileError(f"{self._path}: --only fits no row; there are {others}")


def is_alike(cell: str, wanted: str) -> bool:
    """The same text, or number."""
    with contextlib.suppress(ValueError):
        return cell == wanted or float(cell) == float(wanted)
    return False


def _count_numbers(form: _Form, head: list[tuple[int, str]]) -> int:
    rows = [form.cells(line) for _, line in head[-SAMPLE:]]
    return sum(_is_number(cell) for row in rows for cell in row)


def _is_number(cell: str) -> bool:
    try:
        return cell.lower() not in MISSING and value(cell) is not None
    except ValueError:
        return False


def value(cell: str) -> float:
    """A number, or the seconds of a time; NaN: missing. ValueError: neither."""
    try:
        return float(cell)
    except ValueError:
        if cell.lower() in MISSING:
            return math.nan
    found = CLOCK.fullmatch(cell)
    if found is None:
        raise ValueError(f"{cell[:20]!r} is not a number")
    year, month, day, hour, minute, second, half, zone, zone_minute = found.groups()
    days = datetime.date(int(year), int(month), int(day)).toordinal() if year else EPOCH
    hours = int(hour) % 12 + 12 * (half.lower() == "pm") if half else int(hour)
    minutes = 60 * hours + int(minute)
    if zone:
        minutes -= 60 * int(zone) + int(zone[0] + zone_minute)
    return (
        86400.0 * (days - EPOCH) + 60.0 * minutes + float(re.sub("[,:]", ".", second))
    )


@dataclass(frozen=True, slots=True)
class _Layout:
    form: _Form
    names: list[str]
    header: list[str]  # cells of the line of names
    texts: frozenset[int]  # columns of no numbers
    first: int  # the first row, among the head's lines


def _layout(path: Path, form: _Form, head: list[tuple[int, str]]) -> _Layout:
    """Names are in the last line before the first row, and in those above while some
    are alike: units stand below names, or axes below sensors.
    """
    rows = [form.cells(line) for _, line in head]
    sample = [row for row in rows[-SAMPLE:] if any(map(_is_number, row))]
    widths = Counter(map(len, sample))
    if not widths:
        raise FileError(f"{path} holds no numbers")
    width = max(widths, key=lambda each: (widths[each], each))
    sample = [row for row in sample if len(row) == width]
    texts = frozenset(at for at in range(width) if _is_text([r[at] for r in sample]))
    wanted = [at for at in range(width) if at not in texts]
    whole = (
        at
        for at, row in enumerate(rows)
        if len(row) == width
        and any(map(_is_number, row))
        and all(_is_number(row[c]) or row[c].lower() in MISSING for c in wanted)
    )
    if (first := next(whole, None)) is None:
        raise FileError(f"{path} holds no row of numbers alone: remove other cells")
    above = [form.cells(line.lstrip("#%/ ")) for _, line in head[:first]]
    above = [_trimmed(row, width) for row in above]
    if not any(row[-1] for row in sample) and len(_trimmed(rows[first], 0)) < width:
        # Each row ends with a separator, the line of names perhaps does not.
        short = [row for row in above if len(row) == width - 1]
        width -= bool(short)
        above = short or above
    above = [row for row in above if len(row) == width]
    names = [*above[-1]] if above else [str(1 + at) for at in range(width)]
    for row in reversed(above[:-1]):
        if len(set(names)) == width:
            break
        names = [f"{one} {two}".strip() for one, two in zip(row, names, strict=True)]
    return _Layout(form, _distinct(names), above[-1] if above else [], texts, first)


def _is_text(cells: list[str]) -> bool:
    there = [cell for cell in cells if cell.lower() not in MISSING]
    return 2 * sum(map(_is_number, there)) < len(there)


def _trimmed(row: list[str], width: int) -> list[str]:
    """Without empty cells at the end beyond a width."""
    while len(row) > width and not row[-1]:
        row = row[:-1]
    return row


def _distinct(names: list[str]) -> list[str]:
    found: list[str] = []
    for at, name in enumerate(names, start=1):
        raw = name.encode("utf-8", ESCAPED)
        try:
            name = raw.decode() or f"column {at}"
        except UnicodeDecodeError:
            name = raw.decode("latin-1")
        found.append(f"{name} ({at})" if name in found else name)
    return found


def _uneven(
    layout: _Layout,
    lines: Iterator[tuple[int, str]],
    table: array[float],
    choice: _Choice,
) -> Iterator[tuple[int, str]]:
    """The lines that have to be read one by one. All blocks of plain numbers go to the
    table at once: ten times as fast.
    """
    is_plain = not (layout.texts or layout.form.has_decimal_comma or choice.columns)
    while block := list(itertools.islice(lines, BLOCK)):
        if not is_plain:
            yield from block
            continue
        with contextlib.suppress(ValueError):
            rows = np.loadtxt(
                [line for _, line in block],
                delimiter=layout.form.separator,
                comments=None,
                ndmin=2,
            )
            if rows.shape == (len(block), len(layout.names)):
                table.frombytes(rows.tobytes())
                continue
        yield from block


def _table(
    layout: _Layout, lines: Iterable[tuple[int, str]], choice: _Choice
) -> ForeignTable:
    width = len(layout.names)
    wanted = [at for at in range(width) if at not in (layout.texts | choice.columns)]
    table, unread, why, clocks = array("d"), 0, "", set[int]()
    for number, line in _uneven(layout, iter(lines), table, choice):
        cells = _trimmed(layout.form.cells(line), width)
        if not choice.takes(cells):
            continue
        values = [cells[at] for at in wanted if at < len(cells)]
        try:
            row = list(map(float, values))
        except ValueError:
            try:
                row = list(map(value, values))
                clocks |= {at for at, cell in enumerate(values) if ":" in cell}
            except ValueError as error:
                if line.startswith(("#", "%", "//")) or cells == layout.header:
                    continue
                row = []
                why = why or f"line {number}: {error}"
        if row and len(cells) == width:
            table.extend(row)
            continue
        unread += 1
        why = why or f"line {number}: {len(cells)} columns, not {width}"
    rows = np.frombuffer(table).reshape(-1, len(wanted)).T
    names = [layout.names[at] for at in wanted]
    return ForeignTable(
        dict(zip(names, rows, strict=True)),
        in_seconds=frozenset(names[at] for at in clocks),
        unread=unread,
        why=why,
        texts=tuple(layout.names[at] for at in sorted(layout.texts) if at < width),
    )
