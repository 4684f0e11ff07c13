# SPDX-License-Identifier: MIT
"""Parts of the records of the params: between bytes, numbers on the wire, and values
that people read. The schema lists them.
"""

from __future__ import annotations

import datetime
import itertools
import math
import struct
from collections.abc import Iterator, Mapping

from imud.errors import ParamsError
from imud.wire import schema

Wire = tuple[int, ...]
Plain = (
    int
    | float
    | str
    | datetime.date
    | tuple[float, ...]
    | tuple[tuple[float, ...], ...]
)

DAY_0 = datetime.date(2000, 1, 1)

# Suffixes of a part's key, by its unit: the same keys in files and in JSON.
SUFFIXES = {
    "": "",
    "counts": "_counts",
    "days": "",
    "deg": "_deg",
    "degC": "_c",
    "m": "_m",
    "m/s2": "_m_s2",
    "m/s2/K": "_m_s2_k",
    "m/s2/rtHz": "_m_s2_rthz",
    "rad": "_rad",
    "rad/s/rtHz": "_rad_s_rthz",
    "s": "_s",
    "uT": "_uT",
}

# Decimals that distinguish all steps of any part.


class Part:
    """One part of a record."""

    def __init__(self, field: schema.Field) -> None:
        self.name = field.name
        self.key = field.name + SUFFIXES[field.unit]
        self.unit = field.unit
        self.is_day = field.unit == "days"
        self.is_matrix = field.count == 9
        self.is_text = field.type == "u8" and field.count > 1  # UTF-8
        self.count = field.count
        self.null = (field.null,) * field.count if field.null is not None else None
        self.words = (
            {each.value: each.name.lower() for each in field.enum} if field.enum else {}
        )
        self._struct = struct.Struct("<" + field.code)
        self.size = self._struct.size
        bits = 8 * self.size // field.count
        is_signed = field.type.startswith("i")
        self._low = -(1 << (bits - 1)) if is_signed else 0
        self._high = (1 << (bits - is_signed)) - 1
        # Dividing by 1/scale gives the double nearest to the decimal: 0.07.
        self._steps = round(1 / field.scale)
        self.is_whole = field.scale == 1.0

    def unpack(self, body: bytes, at: int) -> Wire:
        return self._struct.unpack_from(body, at)

    def pack(self, wire: Wire) -> bytes:
        return self._struct.pack(*wire)

    def plain(self, wire: Wire) -> Plain | None:
        """The value of numbers on the wire; None: not known."""
        if wire == self.null:
            return None
        if self.is_text:
            return bytes(wire).rstrip(b"\0").decode("utf-8", "replace")
        if self.is_day:
            return DAY_0 + datetime.timedelta(days=wire[0])
        if self.words or self.is_whole:
            return self.words.get(wire[0], wire[0])
        values = tuple(number / self._steps for number in wire)
        if self.is_matrix:
            return (values[:3], values[3:6], values[6:])
        return values if self.count > 1 else values[0]

    def decimals(self, wire: Wire) -> list[str]:
        """The shortest decimals that are read as these numbers again."""
        return [self._decimal(number) for number in wire]

    def _decimal(self, number: int) -> str:
        if self.is_whole:
            return str(number)
        texts = (f"{number / self._steps:.{places}f}" for places in itertools.count(1))
        text = next(t for t in texts if round(float(t) * self._steps) == number)
        return text.replace("-0.0", "0.0") if number == 0 else text

    def wire(self, plain: object) -> Wire:
        """The numbers on the wire that are nearest to a value; ValueError if it can't
        be one, with words that follow the name of the key.
        """
        if plain is None:
            if self.null is None:
                raise ValueError("is missing")
            return self.null
        if self.is_text:
            return self._letters(plain)
        if self.is_day:
            return self._checked((self._days(plain),))
        if self.words:
            return self._checked((self._member(plain),))
        numbers = list(self._numbers(plain))
        if len(numbers) != self.count:
            what = "3 rows of 3 numbers" if self.is_matrix else f"{self.count} numbers"
            raise ValueError(f"needs {what}")
        return self._checked(tuple(round(number * self._steps) for number in numbers))

    def _checked(self, wire: Wire) -> Wire:
        low, high = self._low, self._high
        if self.null is not None:
            # The number for "not known" is at one end of the range.
            low += self.null[0] == low
            high -= self.null[0] == high
        for number in wire:
            if not low <= number <= high:
                ends = (self.plain_one(low), self.plain_one(high))
                raise ValueError(
                    f"{self.plain_one(number)} is not from {ends[0]} to {ends[1]}"
                )
        return wire

    def plain_one(self, number: int) -> str:
        """One number of the part, for a message."""
        if self.is_day:
            try:
                return str(DAY_0 + datetime.timedelta(days=number))
            except OverflowError:
                return "that day"
        return self._decimal(number)

    def is_torn(self, wire: Wire) -> bool:
        """Whether these bytes are no whole text."""
        text = bytes(wire).rstrip(b"\0").decode("utf-8", "replace")
        return text.encode().ljust(self.size, b"\0") != bytes(wire)

    def _letters(self, plain: object) -> Wire:
        if not isinstance(plain, str) or plain.endswith("\0"):
            raise ValueError("is not a text")
        data = plain.encode("utf-8", "replace")
        if len(data) > self.size:
            raise ValueError(f"takes {len(data)} bytes, more than {self.size}")
        return tuple(data.ljust(self.size, b"\0"))

    def _days(self, plain: object) -> int:
        if isinstance(plain, datetime.datetime) or not isinstance(plain, datetime.date):
            raise ValueError("is not a date, such as 2026-11-22")  # noqa: TRY004 - said
        return (plain - DAY_0).days

    def _member(self, plain: object) -> int:
        if isinstance(plain, int) and not isinstance(plain, bool):
            return plain
        for number, word in self.words.items():
            if word == plain:
                return number
        raise ValueError(f"is not one of {', '.join(self.words.values())}")

    def _numbers(self, plain: object) -> Iterator[float]:
        values = plain if isinstance(plain, list | tuple) else (plain,)
        rows = self.is_matrix and all(isinstance(v, list | tuple) for v in values)
        if rows and any(len(row) != 3 for row in values):
            raise ValueError("needs 3 rows of 3 numbers")
        for value in (each for row in values for each in row) if rows else values:
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            # Before it meets arithmetic: an integer may be longer than any float.
            if not is_number or not -1e12 < value < 1e12 or not math.isfinite(value):
                what = "a number" if self.count == 1 else "numbers"
                raise ValueError(f"is not {what}")
            yield value


class Kind:
    """One kind of record that the schema knows."""

    def __init__(self, record: schema.RecordType) -> None:
        self.name = record.name
        self.tag = record.tag
        self.parts = tuple(Part(field) for field in record.parts)
        self.size = sum(part.size for part in self.parts)
        self.keys = {part.key: part for part in self.parts}

    def split(self, body: bytes) -> tuple[dict[str, Wire], bytes]:
        """The numbers of the parts that a record holds, and the bytes behind them."""
        at, found = 0, {}
        for part in self.parts:
            if at + part.size > len(body):
                break
            found[part.name] = part.unpack(body, at)
            at += part.size
        return found, body[at:]

    def join(self, wire: Mapping[str, Wire], tail: bytes = b"") -> bytes:
        """A record's body of the first parts, as many as `wire` holds."""
        return b"".join(
            part.pack(wire[part.name]) for part in self.parts[: len(wire)]
        ) + (tail)


KINDS = {record.tag: Kind(record) for record in schema.RECORDS}
NAMES = {kind.name: kind for kind in KINDS.values()}


def kind_of(name: str) -> Kind:
    """The kind of record of that name; ParamsError if there is none."""
    try:
        return NAMES[name]
    except KeyError:
        known = ", ".join(NAMES)
        raise ParamsError(f"there is no record {name!r}, only {known}") from None
