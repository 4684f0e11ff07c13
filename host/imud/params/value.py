# SPDX-License-Identifier: MIT
"""The params of a probe as one value that does not change. It keeps unknown data, byte
by byte: records of later firmware, and parts behind those that it knows.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Mapping
from typing import Any, Self

import msgspec

from imud.errors import ParamsError
from imud.params.parts import KINDS, NAMES, Kind, Plain, Wire, kind_of
from imud.wire.params import digest_of, is_mag_off

# As firmware/core/params and core/fusion/calibrate.h have them.
ROOM = 248  # bytes of all records: PARAMS_ROOM
ROW_MAX = 27852  # 1.7, the sum of magnitudes of a matrix's row
BIAS_MAX = 16384 * 16384  # counts
SENSORS = ("acc", "gyr", "mag")
# A record that probes only store: the calibration of a magnetometer that is not used.
# The record of that one ends behind its matrix.
MAG, MAG_KEPT, MAG_VALUES = kind_of("mag").tag, 7, 30
OFFSET_MAX_M = 2.0  # of a tip from its sensor
UNIT_TOLERANCE = 1e-3  # of the length of an axis

Vector = tuple[float, float, float]


class ParamsRecord(msgspec.Struct, frozen=True):
    """A tag and the bytes of its parts."""

    tag: int
    body: bytes

    @property
    def kind(self) -> Kind | None:
        return KINDS.get(self.tag)

    @property
    def name(self) -> str:
        return self.kind.name if self.kind is not None else f"record {self.tag}"


class Calibration(msgspec.Struct, frozen=True, kw_only=True):
    """Of one sensor: matrix * (counts - bias) * the value of a count. Sigma, residual:
    m/s2 and m/s2 (acc), a fraction and rad (gyr), uT and uT (mag). None: not known.
    """

    bias_counts: Vector
    matrix: tuple[Vector, Vector, Vector]
    sigma: float | None = None
    residual: float | None = None
    temperature_c: float | None = None
    day: datetime.date | None = None
    method: str | int | None = None  # a number: a method of later firmware
    norm_ut: float | None = None  # of the field that it was calibrated in
    dip_deg: float | None = None
    lag_s: float | None = None
    drift_m_s2_k: float | None = None  # what a kelvin adds to sigma; acc alone


class Tip(msgspec.Struct, frozen=True, kw_only=True):
    """Where the tip is, and the axis of the probe, in the body frame."""

    offset_m: Vector | None = None
    axis: Vector | None = None
    sigma_m: float | None = None
    day: datetime.date | None = None
    method: str | int | None = None


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """How the probe behaves."""

    button_does: str | int = "stream"
    reference: str | int = "none"


class Params(msgspec.Struct, frozen=True):
    """A list of records."""

    records: tuple[ParamsRecord, ...] = ()

    @classmethod
    def decode(cls, records: bytes) -> Self:
        """The value of these bytes; ParamsError if they are no list of records."""
        found: list[ParamsRecord] = []
        at = 0
        while at < len(records):
            head, at_body = records[at : at + 2], at + 2
            body = records[at_body : at_body + head[-1]]
            record = ParamsRecord(head[0], body)
            if len(head) < 2 or len(body) < head[1]:
                raise ParamsError(f"the params end within a record, at byte {at}")
            if any(other.tag == record.tag for other in found):
                raise ParamsError(f"{record.name} is given twice")
            found.append(record)
            at = at_body + len(body)
        return cls(tuple(found))

    def encode(self) -> bytes:
        return b"".join(
            bytes((record.tag, len(record.body))) + record.body
            for record in self.records
        )

    @property
    def digest(self) -> int:
        return digest_of(self.encode())

    @property
    def unknown(self) -> dict[int, bytes]:
        """The records of later firmware, by tag."""
        return {r.tag: r.body for r in self.records if r.kind is None}

    def _of(self, name: str) -> ParamsRecord | None:
        tag = kind_of(name).tag
        return next((each for each in self.records if each.tag == tag), None)

    def wire(self, name: str) -> dict[str, Wire] | None:
        """The numbers of a record as they are on the wire, by part, as far as it has
        them; None: there is no such record.
        """
        record = self._of(name)
        return kind_of(name).split(record.body)[0] if record is not None else None

    def plain(self, name: str) -> dict[str, Plain | None] | None:
        """The values of a record in plain units, by key; None: there is none."""
        wire = self.wire(name)
        if wire is None:
            return None
        parts = {part.name: part for part in kind_of(name).parts}
        return {
            parts[part].key: parts[part].plain(numbers)
            for part, numbers in wire.items()
        }

    def replaced(self, name: str, values: Mapping[str, object]) -> Params:
        """With a whole record of these values, by key; what is left out is not known.
        What a magnetometer's field is to the north and up follows from its `norm_uT`
        and `dip_deg`. ParamsError if a value can't be.
        """
        kind = kind_of(name)
        if name == "mag":
            values = {**values, **_components(values)}
        wire = {}
        for unknown in values.keys() - kind.keys.keys():
            raise ParamsError(f"{name} has no {unknown}, only {', '.join(kind.keys)}")
        for key, part in kind.keys.items():
            try:
                wire[part.name] = part.wire(values.get(key, 0 if part.words else None))
            except ValueError as error:
                raise ParamsError(f"{name}: {key} {error}") from None
        return self.having(ParamsRecord(kind.tag, kind.join(wire)))

    def having(self, record: ParamsRecord) -> Params:
        """With this record in the place of the one of its tag, or else at the end."""
        if any(each.tag == record.tag for each in self.records):
            return Params(
                tuple(record if e.tag == record.tag else e for e in self.records)
            )
        return Params((*self.records, record))

    def without(self, name: str) -> Params:
        tag = kind_of(name).tag
        return Params(tuple(each for each in self.records if each.tag != tag))

    def calibration(self, name: str) -> Calibration | None:
        """Of the sensor acc, gyr or mag; None: there is none."""
        plain: dict[str, Any] | None = self.plain(name)
        if plain is None or "matrix" not in plain:
            return None
        unit = {"acc": "_m_s2", "gyr": "", "mag": "_uT"}[name]
        residual = "_rad" if name == "gyr" else unit
        return Calibration(
            bias_counts=plain["bias_counts"],
            matrix=plain["matrix"],
            sigma=plain.get(f"sigma{unit}"),
            residual=plain.get(f"residual{residual}"),
            norm_ut=plain.get("norm_uT"),
            **{
                key: plain.get(key)
                for key in (
                    "temperature_c",
                    "day",
                    "method",
                    "dip_deg",
                    "lag_s",
                    "drift_m_s2_k",
                )
            },
        )

    @property
    def acc(self) -> Calibration | None:
        return self.calibration("acc")

    @property
    def gyr(self) -> Calibration | None:
        return self.calibration("gyr")

    @property
    def mag(self) -> Calibration | None:
        return self.calibration("mag")

    @property
    def tip(self) -> Tip | None:
        plain: dict[str, Any] | None = self.plain("tip")
        return None if plain is None else Tip(**plain)

    @property
    def options(self) -> Options:
        """Those of the record, or the defaults."""
        plain: dict[str, Any] = self.plain("options") or {}
        return Options(**plain)

    @property
    def name(self) -> str:
        """What the probe is called; empty: it does not say."""
        return str((self.plain("name") or {}).get("text", ""))

    def with_magnetometer(self, *, is_on: bool) -> Params:
        """With the magnetometer in use, or not; its calibration is kept meanwhile."""
        if is_on != is_mag_off(self.encode()):
            return self
        kept = next((r.body for r in self.records if r.tag == MAG_KEPT), None)
        mag = self._of("mag")
        others = Params(tuple(r for r in self.records if r.tag not in (MAG, MAG_KEPT)))
        if is_on:
            return others if kept is None else others.having(ParamsRecord(MAG, kept))
        if mag is not None:
            others = others.having(ParamsRecord(MAG_KEPT, mag.body))
        return others.having(ParamsRecord(MAG, bytes(MAG_VALUES)))

    def faults(self) -> list[str]:
        """Why a probe refuses them, or should: a line each. Empty: it accepts them."""
        return list(self._faults())

    def check(self) -> None:
        """Raises ParamsError with the first of faults()."""
        for fault in self._faults():
            raise ParamsError(fault)

    def _faults(self) -> Iterator[str]:
        size = len(self.encode())
        if size > ROOM:
            yield f"the params take {size} bytes, and a probe has room for {ROOM}"
        for name in NAMES:
            wire = self.wire(name)
            if wire is None:
                continue
            if name in SENSORS:
                yield from _sensor_faults(name, wire)
            elif name == "tip":
                yield from _tip_faults(wire)
            elif name == "options":
                yield from _options_faults(wire)

    def described(self) -> dict[str, Any]:
        """All values for JSON: records by name with the units in the keys, null where
        they are not known, dates as 2026-11-22, and unknown records in hex by tag.
        """
        found: dict[str, Any] = {}
        for name in NAMES:
            plain = self.plain(name)
            found[name] = plain and {
                key: value.isoformat() if isinstance(value, datetime.date) else value
                for key, value in plain.items()
            }
        found["unknown"] = {str(tag): body.hex() for tag, body in self.unknown.items()}
        return found


def payload_of(records: bytes) -> dict[str, Any]:
    """The published form of params, for JSON: docs/params.md."""
    try:
        params = Params.decode(records)
    except ParamsError as error:
        return {"digest": None, "error": str(error), "bytes": records.hex()}
    return {
        "digest": f"{params.digest:08x}",
        "error": next(iter(params.faults()), None),
        "bytes": records.hex(),
        "records": params.described(),
    }


def _components(values: Mapping[str, object]) -> dict[str, float | None]:
    """The field to the north and up, uT, from its norm, uT, and its dip, deg."""
    norm, dip = values.get("norm_uT"), values.get("dip_deg")
    if not isinstance(norm, int | float) or not isinstance(dip, int | float):
        return {"north_uT": None, "up_uT": None}
    dip = math.radians(dip)
    return {"north_uT": norm * math.cos(dip), "up_uT": -norm * math.sin(dip)}


def _sensor_faults(name: str, wire: Mapping[str, Wire]) -> Iterator[str]:
    if "matrix" not in wire:
        yield f"{name}: the record is too short for a calibration"
        return
    for axis, bias in zip("xyz", wire["bias"], strict=True):
        if abs(bias) > BIAS_MAX:
            yield f"{name}: the bias of {axis} is over 16384 counts"
    for row in range(3):
        total = sum(map(abs, wire["matrix"][3 * row : 3 * row + 3]))
        if total > ROW_MAX:
            yield (
                f"{name}: row {row + 1} of the matrix sums to {total / 16384:.5f} in "
                "magnitude, more than 1.7"
            )


def _tip_faults(wire: Mapping[str, Wire]) -> Iterator[str]:
    offset, axis = wire.get("offset"), wire.get("axis")
    nulls = {part.name: part.null for part in NAMES["tip"].parts}
    for part, numbers in (("offset", offset), ("axis", axis)):
        null = nulls[part]
        if numbers and null and numbers != null and null[0] in numbers:
            yield f"tip: the {part} is only partly known"
            return
    if offset and offset != nulls["offset"]:
        distance_m = math.hypot(*offset) / 1e6
        if distance_m > OFFSET_MAX_M:
            yield (
                f"tip: the offset is {distance_m:.3f} m long, more than "
                f"{OFFSET_MAX_M:g} m"
            )
    if axis and axis != nulls["axis"]:
        length = math.hypot(*axis) / 16384
        if abs(length - 1) > UNIT_TOLERANCE:
            yield f"tip: the axis has the length {length:.4f}, not 1"


def _options_faults(wire: Mapping[str, Wire]) -> Iterator[str]:
    for part in NAMES["options"].parts:
        if part.name not in wire:
            yield f"options: {part.name} is missing"
        elif wire[part.name][0] not in part.words:
            known = ", ".join(part.words.values())
            yield f"options: {part.name} {wire[part.name][0]} is not {known}"
