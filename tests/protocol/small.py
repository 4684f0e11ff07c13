# SPDX-License-Identifier: MIT
"""A small schema with each kind of field, and variants of it."""

from __future__ import annotations

from pathlib import Path

from generator import checker
from generator.schema import Schema

SMALL = """
[protocol]
version = 1
[enums.mood]
good = 0
bad = 1
[flags.sign]
hot = 0
far = 7
[[message]]
name = "hello"
id = 0x03
direction = "probe"
meaning = "Who."
fields = [
  { name = "protocol_version", tag = 1, type = "u8", meaning = "v" },
  { name = "schema_fingerprint", tag = 2, type = "u32", meaning = "f" },
]
[[message]]
name = "news"
id = 0x05
direction = "probe"
meaning = "What."
fields = [
  { name = "mood", tag = 10, type = "u8", enum = "mood", meaning = "m" },
  { name = "sign", tag = 11, type = "u8", flags = "sign", meaning = "s" },
  { name = "way", tag = 12, type = "i16", count = 3, scale = 0.01, unit = "m", null = -32768, meaning = "w" },
  { name = "turn", tag = 14, type = "i32", scale = "2^-30", meaning = "t" },
  { name = "word", tag = 15, type = "text", count = 4, meaning = "x" },
]
"""  # noqa: E501 - a line of TOML can't be broken


def change(text: str, old: str, new: str) -> str:
    """The text with its only `old` replaced."""
    assert text.count(old) == 1, old
    return text.replace(old, new)


def load(path: Path, text: str) -> Schema:
    """The schema that a TOML text describes, read from a file in the folder `path`."""
    schema = path / "schema.toml"
    schema.write_text(text, "utf-8")
    return checker.load(schema)
