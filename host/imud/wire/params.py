# SPDX-License-Identifier: MIT
"""The records of the params on the wire: parts to a whole, digest, and back."""

from __future__ import annotations

import contextlib
import zlib
from collections.abc import Iterator

from imud.wire import schema
from imud.wire.fields import FieldCodec, Impossible, Value
from imud.wire.messages import Message

HEAD = 2  # bytes of a record before its content: tag, length
SENSORS = ("acc", "gyr", "mag")  # records that calibrate
FIELD_ONLY = (None, (0, 0, 0), (1, 0, 0, 0, 1, 0, 0, 0, 1))  # sigma, bias, matrix
MAG_OFF = (0,) * 9  # the magnetometer's matrix while it is not used
PART = 28  # bytes that a message of the probe tells
WORD = 4  # bytes that a command writes
SETS_MAX = 4  # unfinished sets whose parts are kept, the newest
WHOLE_MAX = 16  # whole ones

_KNOWN = {
    record.tag: (record.name, [FieldCodec(part) for part in record.parts])
    for record in schema.RECORDS
}


def digest_of(records: bytes) -> int:
    """The digest of a list of records: the CRC-32 of its bytes; 0 of none."""
    return zlib.crc32(records)


def words_of(records: bytes) -> Iterator[tuple[int, int]]:
    """The arguments of each `params_write` that brings the records to a probe."""
    for at in range(0, len(records), WORD):
        word = records[at : at + WORD].ljust(WORD, b"\0")
        yield at, int.from_bytes(word, "little", signed=True)


def messages_of(records: bytes) -> Iterator[dict[str, Value]]:
    """The fields of each message `params` by which a probe tells the records."""
    for at in range(0, len(records), PART):
        yield {
            "set_digest": digest_of(records),
            "set_length": len(records),
            "part_offset": at,
            "part": records[at : at + PART].ljust(PART, b"\0"),
        }


def parts_of(records: bytes) -> dict[str, dict[str, Value]]:
    """The values of the records that this imud knows, by record and part. Parts that
    an older writer left out are None; parts and records behind a torn end are missing.
    """
    found: dict[str, dict[str, Value]] = {}
    at = 0
    while at + HEAD <= len(records):
        tag, end = records[at], at + HEAD + records[at + 1]
        content, at = records[at + HEAD : end], end
        if tag in _KNOWN and end <= len(records):
            name, fields = _KNOWN[tag]
            found[name] = _values(fields, content)
    return found


def _values(fields: list[FieldCodec], content: bytes) -> dict[str, Value]:
    values: dict[str, Value] = {}
    at = 0
    for field in fields:
        end = at + field.size
        values[field.name] = None
        if end <= len(content):
            # A name that a later schema gave to a number is not known here.
            with contextlib.suppress(Impossible):
                values[field.name] = field.unpack(content, at)
        at = end
    return values


def calibrated_by(records: bytes) -> list[str]:
    """The sensors for which there is a calibration."""
    return [
        name
        for name, of in parts_of(records).items()
        if name in SENSORS
        and (of["sigma"], of["bias"], of["matrix"]) != FIELD_ONLY
        and of["matrix"] != MAG_OFF
    ]


def is_mag_off(records: bytes | None) -> bool:
    """Whether the magnetometer is not used: its matrix makes no field of any counts,
    and a filter leaves out a field of zeros.
    """
    mag = parts_of(records or b"").get("mag") or {}
    return mag.get("matrix") == MAG_OFF


class ParamsParts:
    """Puts the parts together that a probe tells. Knows several sets by their digests:
    parts of the next come while the one before is in force.
    """

    def __init__(self) -> None:
        self._parts: dict[tuple[int, int], dict[int, bytes]] = {}
        self._whole: dict[int, bytes] = {}

    def add_part(self, message: Message) -> int | None:
        """Takes a message `params`. The digest of a set that is whole now and was not
        known before; else None.
        """
        digest, length = message.fields["set_digest"], message.fields["set_length"]
        at, part = message.fields["part_offset"], message.fields["part"]
        if (
            not isinstance(digest, int)
            or not isinstance(length, int)
            or not isinstance(at, int)
            or not isinstance(part, bytes)
            or digest == 0
            or digest in self._whole
            or at not in range(0, length, PART)
        ):
            return None
        key = (digest, length)
        parts = self._parts.setdefault(key, {})
        parts[at] = part
        while len(self._parts) > SETS_MAX:
            del self._parts[next(iter(self._parts))]
        wanted = range(0, length, PART)
        if not all(at in parts for at in wanted):
            return None
        records = b"".join(parts[at] for at in wanted)[:length]
        # Parts sent before the probe detected damage are discarded.
        self._parts.pop(key, None)
        if digest_of(records) != digest:
            return None
        self.add_whole(records)
        return digest

    def add_whole(self, records: bytes) -> None:
        """A whole set that is known otherwise, as from the metadata of a log."""
        self._whole[digest_of(records)] = records
        while len(self._whole) > WHOLE_MAX:
            del self._whole[next(iter(self._whole))]

    def get(self, digest: int) -> bytes | None:
        """The records of that digest, if all of their parts were heard."""
        if digest == 0:
            return b""
        records = self._whole.pop(digest, None)
        if records is not None:
            self._whole[digest] = records  # what is in use is forgotten last
        return records
