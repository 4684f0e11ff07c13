# SPDX-License-Identifier: MIT
"""libimuprobe: the firmware's own framing and messages, with a reader, as a C file and
its header, for programs without Python. Names are prefixed, and but for the reader's
all functions are static.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

from generator import c_code
from generator.schema import Schema

PROTOCOL = Path(__file__).resolve().parent.parent
CORE = PROTOCOL.parent / "firmware" / "core"

_HEAD = re.compile(r"\A(?://.*\n)+")
_GUARD = re.compile(r"^#(?:(?:ifndef|define) \w+_H|include .*|endif)\n+", re.MULTILINE)
_TYPES = r"(?:enum \w+|bool|void|u?int\d+_t)"
# A declaration, with the comment above it.
_PROTOTYPE = re.compile(
    rf"(?:^// .*\n)*^(?:{_TYPES} \w+\([^;{{]*;|extern .*;)\n", re.MULTILINE
)
_LAYOUT = re.compile(r"^enum \{ MESSAGE_SEQUENCE_AT.*\ntypedef .*;\n", re.MULTILINE)
_DEFINITION = re.compile(
    rf"^(?={_TYPES} (?:message|frame)_\w+\(|message_layout )", re.MULTILINE
)
_ORDER = re.compile(r"^_Static_assert\(__BYTE_ORDER__[^;]*;\n", re.MULTILINE)
_CONSTANT = re.compile(r"^(?:    |#define |enum \{ )([A-Z]\w+)\b", re.MULTILINE)
_TAG = re.compile(r"^(?:struct|enum) (\w+) \{", re.MULTILINE)

HEADER = """\
// SPDX-License-Identifier: MIT
// libimuprobe: what imu-probes send, in C. Made from {fingerprint}'s schema by
// `python protocol/generate.py --library`; PROTOCOL.md says what each field means.
#ifndef IMUPROBE_H
#define IMUPROBE_H

#include <stdbool.h>
#include <stdint.h>

{text}
#endif
"""
SOURCE = """\
// SPDX-License-Identifier: MIT
// libimuprobe: see imuprobe.h. Little endian processors alone.
#include "imuprobe.h"

#include <string.h>

#ifdef __FLASH
#define IN_FLASH __flash
#else
#define IN_FLASH
#endif
#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-function"  // a probe's side of the wire
#endif
{text}"""


def files(schema: Schema) -> dict[str, str]:
    """The text of each file, by its name."""
    messages = _bare(c_code.header(schema))
    frame = _bare((CORE / "wire" / "frame.h").read_text("utf-8"))
    public = "\n".join(
        [
            _PROTOTYPE.sub("", _LAYOUT.sub("", messages) + frame),
            *scales(schema),
            _HEAD.sub("", (PROTOCOL / "library" / "reader.h").read_text("utf-8")),
        ]
    )
    code = [
        *_LAYOUT.findall(messages),
        _bare((CORE / "wire" / "frame.c").read_text("utf-8")),
        _ORDER.sub("", _bare(c_code.source(schema))),
        _HEAD.sub("", (PROTOCOL / "library" / "reader.c").read_text("utf-8")),
    ]
    static = _DEFINITION.sub("static ", "\n".join(code))
    fingerprint = f"0x{schema.fingerprint:08x}"
    header = HEADER.format(fingerprint=fingerprint, text=public)
    return {
        "imuprobe.h": _prefixed(header, public),
        "imuprobe.c": _prefixed(SOURCE.format(text=static), public),
    }


def scales(schema: Schema) -> Iterator[str]:
    """A macro for each field that is no whole number of its unit: no float unless it is
    used.
    """
    yield "// A field times its scale is in its unit."
    for message in schema.messages:
        for field in message.fields:
            if field.scale != 1:
                name = f"{message.name}_{field.name}_scale".upper()
                yield f"#define {name} {_number(field.scale)}  // {field.unit or 1}"


def _number(scale: Decimal | str) -> str:
    if isinstance(scale, Decimal):
        return f"{float(scale)!r}"
    return f"(1.0 / {2 ** -int(scale.removeprefix('2^'))})"


def _bare(text: str) -> str:
    """Without its head, its guard and what it includes."""
    return _GUARD.sub("", _HEAD.sub("", text)).strip("\n") + "\n"


def _prefixed(text: str, public: str) -> str:
    """With prefixes on what the header declares."""
    tags = "|".join(set(_TAG.findall(public)))
    constants = set(_CONSTANT.findall(public))
    text = re.sub(rf"\b(struct|enum) (?!imuprobe_)({tags})\b", r"\1 imuprobe_\2", text)
    return re.sub(
        r"\b[A-Z]\w+\b",
        lambda word: (
            f"IMUPROBE_{word[0]}"
            if word[0] in constants and not word[0].startswith("IMUPROBE_")
            else word[0]
        ),
        text,
    )
