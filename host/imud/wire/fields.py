# SPDX-License-Identifier: MIT
"""Fields of messages: from the numbers on the wire to values in SI, and back."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from enum import IntEnum, IntFlag
from typing import Any

from imud import _core
from imud.wire import schema

Scalar = int | float | str | bytes
Value = Scalar | tuple[int, ...] | tuple[float, ...] | tuple[str, ...] | None

# A unit quaternion or normal may be off by its rounding. The fusion normalises to a few
# parts in a million; damage that passes a CRC does not.
NORM_TOLERANCE = 1e-3

# Fields that hold a unit vector or quaternion.
UNIT_FIELDS = frozenset({"q", "normal"})


class Impossible(Exception):
    """A value that the schema excludes."""


def _enum_names(enum: type[IntEnum]) -> dict[int, str]:
    return {member.value: member.name.lower() for member in enum}


def _flag_names(flags: type[IntFlag]) -> list[tuple[int, str]]:
    return [(member.value, str(member.name).lower()) for member in flags]


# From the numbers of a field on the wire, or (its bytes,), to its value.
Parse = Callable[[tuple[Any, ...]], Value]


def _enum_parser(name: str, names: dict[int, str]) -> Parse:
    def parse(wire: tuple[int, ...]) -> str:
        try:
            return names[wire[0]]
        except KeyError:
            raise Impossible(f"{name} is {wire[0]}") from None

    return parse


def _flags_parser(
    name: str, flags: type[IntFlag], seen: dict[int, tuple[str, ...]]
) -> Parse:
    bits = _flag_names(flags)
    known = sum(bit for bit, _ in bits)

    def parse(wire: tuple[int, ...]) -> tuple[str, ...]:
        number = wire[0]
        names = seen.get(number)
        if names is None:
            if number & ~known:
                raise Impossible(f"{name} is {number:#x}")
            names = tuple(name for bit, name in bits if number & bit)
            seen[number] = names
        return names

    return parse


# From wire numbers to quantities in SI.
Scale = Callable[[tuple[int, ...]], tuple[float, ...]]


def _divider(count: int, by: float) -> Scale:
    # Written out for the usual counts: half the time of a loop.
    if count == 1:
        return lambda wire: (wire[0] / by,)
    if count == 3:
        return lambda wire: (wire[0] / by, wire[1] / by, wire[2] / by)
    if count == 4:
        return lambda wire: (wire[0] / by, wire[1] / by, wire[2] / by, wire[3] / by)
    return lambda wire: tuple([number / by for number in wire])


def _multiplier(by: float) -> Scale:
    return lambda wire: tuple([number * by for number in wire])


def _number_parser(
    name: str, count: int, null: int | None, scale: Scale | None
) -> Parse:
    """`null` on the wire means not available. Without a `scale`, wire numbers stay."""
    nulls = (null,) * count

    def parse_one(wire: tuple[int, ...]) -> Value:
        if wire[0] == null:
            return None
        return wire[0] if scale is None else scale(wire)[0]

    def parse_more(wire: tuple[int, ...]) -> Value:
        if null in wire:
            if wire != nulls:
                raise Impossible(f"{name} is available in part")
            return None
        return wire if scale is None else scale(wire)

    def parse_unit(wire: tuple[int, ...]) -> Value:
        values = parse_more(wire)
        if isinstance(values, tuple):
            norm = math.hypot(*values)
            if abs(norm - 1) > NORM_TOLERANCE:
                raise Impossible(f"{name} has the norm {norm:.4f}")
        return values

    if scale is not None and name in UNIT_FIELDS:
        return parse_unit
    return parse_one if count == 1 else parse_more


def _text_parser(name: str) -> Parse:
    def parse(wire: tuple[bytes, ...]) -> str:
        text = wire[0].rstrip(b"\0")
        if not text.isascii() or not text.decode("latin-1").isprintable():
            raise Impossible(f"{name} is {wire[0]!r}")
        return text.decode("ascii")

    return parse


class FieldCodec:
    """Converts one field of the schema between wire and value."""

    def __init__(self, field: schema.Field) -> None:
        self.name = field.name
        self.tag = field.tag
        self.size = struct.calcsize("<" + field.code)
        self.code = field.code
        # How many values struct unpacks it to.
        self.values = 1 if field.type in ("text", "bytes") else field.count
        # With a scale of 1/n, wire numbers are divided by n. This gives the double
        # nearest to the decimal, 0.07 and not 0.07000000000000001.
        inverse = round(1 / field.scale)
        self._is_inverse = math.isclose(inverse * field.scale, 1.0, rel_tol=1e-12)
        self._factor = inverse if self._is_inverse else field.scale
        self._field = field
        self._names = _enum_names(field.enum) if field.enum is not None else {}
        # Combinations of flags that were read: only few are in use.
        self._seen: dict[int, tuple[str, ...]] = {}
        self.parse = self._parser(field)

    def _parser(self, field: schema.Field) -> Parse:
        if field.type == "bytes":
            return lambda wire: wire[0]
        if field.type == "text":
            return _text_parser(field.name)
        if field.enum is not None:
            return _enum_parser(field.name, self._names)
        if field.flags is not None:
            return _flags_parser(field.name, field.flags, self._seen)
        scale = None
        if field.scale != 1.0 and self._is_inverse:
            scale = _divider(field.count, self._factor)
        elif field.scale != 1.0:
            scale = _multiplier(self._factor)
        return _number_parser(field.name, field.count, field.null, scale)

    def plain(self) -> _core.ReaderField | None:
        """What `_core.Reader` needs to know of it; None: that can't read it."""
        field = self._field
        if field.type in ("text", "bytes"):
            return None
        is_scaled = field.scale != 1.0
        is_unit = is_scaled and field.name in UNIT_FIELDS
        table: dict[int, Any] | None = None
        if field.enum is not None or field.flags is not None:
            table = self._names if field.enum is not None else self._seen
        return (
            field.name,
            field.tag,
            field.code[-1].islower(),
            self.size // field.count,
            field.count,
            field.null,
            is_scaled,
            self._is_inverse,
            float(self._factor),
            NORM_TOLERANCE if is_unit else 0.0,
            table,
        )

    def unpack(self, content: bytes, offset: int) -> Value:
        """The value at `offset`, behind the tag; Impossible if it is not allowed."""
        return self.parse(struct.unpack_from("<" + self.code, content, offset))

    def blank(self) -> bytes:
        """Not available, or zeros where the schema has no number for that."""
        field = self._field
        if field.null is None:
            return bytes(self.size)
        return struct.pack("<" + self.code, *[field.null] * field.count)

    def pack(self, value: object) -> bytes:
        """A value's bytes on the wire, without the tag; ValueError if it can't be."""
        field = self._field
        try:
            if field.type in ("text", "bytes"):
                raw = value.encode("ascii") if isinstance(value, str) else value
                if not isinstance(raw, bytes) or len(raw) > field.count:
                    raise ValueError(f"at most {field.count} bytes")  # noqa: TRY301
                return struct.pack("<" + self.code, raw)
            return struct.pack("<" + self.code, *self._wire(value))
        except (KeyError, TypeError, ValueError, struct.error) as error:
            raise ValueError(f"{self.name} can't be {value!r}: {error}") from error

    def _wire(self, value: object) -> list[int]:
        field = self._field
        if value is None:
            if field.null is None:
                raise ValueError("it is always available")
            return [field.null] * field.count
        if field.enum is not None:
            return [field.enum[str(value).upper()]]
        if field.flags is not None:
            names = value if isinstance(value, list | tuple | set) else ()
            return [sum(field.flags[str(name).upper()] for name in set(names))]
        numbers = _numbers(value)
        if len(numbers) != field.count:
            raise ValueError(f"{field.count} numbers are needed")
        if field.scale == 1.0:
            return [int(number) for number in numbers]
        if self._is_inverse:
            return [round(number * self._factor) for number in numbers]
        return [round(number / self._factor) for number in numbers]


def _numbers(value: object) -> list[int | float]:
    values = list(value) if isinstance(value, list | tuple) else [value]
    numbers = [number for number in values if isinstance(number, int | float)]
    if len(numbers) != len(values):
        raise TypeError("it is not a list of numbers")
    return numbers
