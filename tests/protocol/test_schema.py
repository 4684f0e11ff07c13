# SPDX-License-Identifier: MIT
"""The schema: planted mistakes are refused by name, and the fingerprint follows the
meaning of bytes and nothing else."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from generator import checker
from generator.schema import SchemaError
from protocol.small import SMALL, change, load


def fingerprint(path: Path, text: str) -> int:
    return load(path, text).fingerprint


def test_the_small_schema_is_good(tmp_path: Path) -> None:
    load(tmp_path, SMALL)


WAY = 'type = "i16", count = 3, scale = 0.01, unit = "m", null = -32768'
MISTAKES = [
    ("version = 1", "version = 0", "protocol: version: 0 is outside 1..255"),
    ("version = 1", 'version = "1"', "protocol: version: '1' is not a whole number"),
    ("version = 1", "versoin = 1", "protocol: version is missing"),
    ("version = 1", "versoin = 1\nversion = 1", "protocol: unknown key versoin"),
    ("[flags.sign]", "[falgs.sign]", "schema: unknown key falgs"),
    ("bad = 1", "bad = 0", "enums.mood: bad has the value 0 of another"),
    ("bad = 1", "bad = 256", "enums.mood: bad: 256 is outside 0..255"),
    ("bad = 1", "Bad = 1", "enums.mood: name 'Bad' must be lower case"),
    ("far = 7", "far = 8", "field sign: flags 'sign' does not fit u8"),
    ("far = 7", "far = 32", "flags.sign: far: 32 is outside 0..31"),
    ("id = 0x05", "id = 0x02", "message news: id 0x02 is less than two bits from"),
    ("id = 0x05", "id = 0x03", "message news: id 0x03 is less than two bits from"),
    ("id = 0x05", "id = 300", "message news: id: 300 is outside 1..255"),
    ("id = 0x05", "id = true", "message news: id: True is not a whole number"),
    ("id = 0x03", "id = 0x06", "message hello: its id 0x03 and first fields"),
    ('name = "hello"', 'name = "howdy"', "message: there is no hello"),
    ('name = "news"', 'name = "hello"', "message hello: its name is taken"),
    ('name = "news"', 'name = "new s"', "message 1: name 'new s' must be lower"),
    ('meaning = "What."', 'meaning = "a|b"', "message news: meaning: 'a|b' must be"),
    ('meaning = "What."', "", "message news: meaning is missing"),
    (
        'direction = "probe"\nmeaning = "What."',
        'direction = "up"\nmeaning = "What."',
        "message news: direction 'up' is neither",
    ),
    ("tag = 2,", "tag = 1,", "field schema_fingerprint: tag 1 is taken by hello."),
    ("tag = 2,", "tag = 10,", "field mood: tag 10 is taken by hello.schema_"),
    ("tag = 2,", "tag = 3,", "message hello: its id 0x03 and first fields"),
    ("tag = 11", "tag = 13", "message news: field way: tags must ascend"),
    ("tag = 11", "tag = 0", "message news: field sign: tag: 0 is outside 1..255"),
    ("tag = 11", "tag = 256", "field sign: tag: 256 is outside 1..255"),
    ("tag = 11, ", "", "message news: field sign: tag is missing"),
    ('name = "sign"', 'name = "mood"', "field mood: its name is taken"),
    ('type = "i16"', 'type = "i24"', "message news: field way: unknown type 'i24'"),
    ('enum = "mood"', 'enum = "mode"', "field mood: there is no enum 'mode'"),
    ('flags = "sign"', 'flags = "sing"', "field sign: there is no flags 'sing'"),
    ('enum = "mood"', 'enum = "mood", count = 2', "enum needs one unsigned number"),
    ('enum = "mood"', 'enum = "mood", flags = "sign"', "exclude each other"),
    ("null = -32768", "null = -32769", "way: null: -32769 is outside -32768..32767"),
    ("null = -32768", "nul = -32768", "message news: field way: unknown key nul"),
    ("scale = 0.01", "scale = 0", "field way: scale 0 is neither"),
    ("scale = 0.01", "scale = -1", "field way: scale -1 is neither"),
    ('scale = "2^-30"', 'scale = "2^30"', "field turn: scale '2^30' is neither"),
    ('unit = "m"', 'unit = "m s"', "field way: unit 'm s' must be one word"),
    ("count = 3", "count = 0", "field way: count: 0 is outside 1..120"),
    ("count = 3", "count = 60", "message news: 144 bytes of content, 120 at most"),
    ("count = 4", "count = 4, null = 0", "field word: null means nothing for text"),
    ("count = 4", 'count = 4, format = "oct"', "field word: unknown format 'oct'"),
    ("version = 1", "version = = 1", "Invalid value"),
]


@pytest.mark.parametrize(("old", "new", "line"), MISTAKES)
def test_a_planted_mistake_is_refused_with_a_line(
    tmp_path: Path, old: str, new: str, line: str
) -> None:
    with pytest.raises(SchemaError) as caught:
        load(tmp_path, change(SMALL, old, new))
    lines = str(caught.value).splitlines()
    assert all(text.startswith("schema.toml: ") for text in lines)
    assert any(line in text for text in lines), lines


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('name = "news"', 'name = "ok"', "its C name MESSAGE_OK is taken by"),
        ("[flags.sign]", "[flags.message]", "C name MESSAGE_NEWS is taken by"),
    ],
)
def test_two_of_one_name_in_c_are_refused(
    tmp_path: Path, old: str, new: str, line: str
) -> None:
    text = change(SMALL, old, new)
    if "flags.message" in new:
        text = change(text, "hot = 0", "news = 0").replace(
            'flags = "sign"', 'flags = "message"'
        )
    with pytest.raises(SchemaError, match=line):
        load(tmp_path, text)


def test_all_mistakes_are_told_at_once(tmp_path: Path) -> None:
    text = change(change(SMALL, "bad = 1", "bad = 0"), 'unit = "m"', 'unit = "m s"')
    with pytest.raises(SchemaError) as caught:
        load(tmp_path, text)
    assert len(str(caught.value).splitlines()) == 2


def test_a_seed_that_is_hellos_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seed = load(tmp_path, SMALL).seed
    monkeypatch.setattr(checker, "HELLO_SEED", seed)
    with pytest.raises(SchemaError, match="hello's own seed"):
        load(tmp_path, SMALL)


MEANING = [
    ("version = 1", "version = 2"),
    ("bad = 1", "bad = 2"),
    ("bad = 1", "worse = 1"),
    ("far = 7", "far = 6"),
    ("id = 0x05", "id = 0x06"),
    ('name = "news"', 'name = "olds"'),
    ('name = "way"', 'name = "road"'),
    ("tag = 12", "tag = 13"),
    ("count = 3", "count = 2"),
    ("count = 4", "count = 5"),
    ("scale = 0.01", "scale = 0.02"),
    ('scale = "2^-30"', 'scale = "2^-31"'),
    ('unit = "m"', 'unit = "km"'),
    ("null = -32768", "null = -32767"),
    (", null = -32768", ""),
    (', enum = "mood"', ""),
    (', flags = "sign"', ""),
    ('type = "i16"', 'type = "i32"'),
    (WAY, WAY.replace("i16", "i32").replace("-32768", "-40000")),
]


@pytest.mark.parametrize(("old", "new"), MEANING)
def test_the_fingerprint_follows_the_meaning(
    tmp_path: Path, old: str, new: str
) -> None:
    assert fingerprint(tmp_path, change(SMALL, old, new)) != fingerprint(
        tmp_path, SMALL
    )


RECORD = """[enums.how]
by_hand = 0
[[record]]
name = "tip"
tag = 1
meaning = "T."
parts = [
  { name = "how", type = "u8", enum = "how", meaning = "h" },
]
"""

# Records grow without it: they tell their lengths.
PROSE = [
    ("[enums.mood]", f"{RECORD}[enums.mood]"),
    ('meaning = "What."', 'meaning = "Something else."'),
    ('meaning = "w"', 'meaning = "the way"'),
    ("[enums.mood]", "# a comment\n[enums.mood]"),
    ("scale = 0.01", "scale = 1e-2"),
    ("scale = 0.01", "scale = 0.0100"),
    ("good = 0\nbad = 1", "bad = 1\ngood = 0"),
    ('type = "i32", scale', 'type = "i32", count = 1, scale'),
    ('type = "u32",', 'type = "u32", scale = 1,'),
    ('type = "i32",', 'type = "i32", format = "hex",'),
    (
        'direction = "probe"\nmeaning = "What."',
        'direction = "host"\nmeaning = "What."',
    ),
]


@pytest.mark.parametrize(("old", "new"), PROSE)
def test_the_fingerprint_does_not_follow_prose(
    tmp_path: Path, old: str, new: str
) -> None:
    assert fingerprint(tmp_path, change(SMALL, old, new)) == fingerprint(
        tmp_path, SMALL
    )


def test_the_canonical_form_is_the_documents(tmp_path: Path) -> None:
    canonical = (
        "version 1\n"
        "enum mood good=0 bad=1\n"
        "flags sign hot=0 far=7\n"
        "message hello 3\n"
        "field protocol_version 1 u8 1 1e0 - - - -\n"
        "field schema_fingerprint 2 u32 1 1e0 - - - -\n"
        "message news 5\n"
        "field mood 10 u8 1 1e0 - - mood -\n"
        "field sign 11 u8 1 1e0 - - - sign\n"
        "field way 12 i16 3 1e-2 m -32768 - -\n"
        "field turn 14 i32 1 2^-30 - - - -\n"
        "field word 15 text 4 1e0 - - - -\n"
    )
    schema = load(tmp_path, SMALL)
    assert schema.canonical == canonical
    digest = hashlib.sha256(canonical.encode("ascii")).digest()
    assert fingerprint(tmp_path, SMALL) == int.from_bytes(digest[:4], "little")
