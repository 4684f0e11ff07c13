# SPDX-License-Identifier: MIT
"""Schemas that are kept: what older probes and logs say is read as of ours."""

from __future__ import annotations

import csv
import hashlib
import json
from enum import IntEnum, IntFlag
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from fakes import EXAMPLES, FakeProbe
from imud import cli
from imud.log.reader import Logged, LogHead, salvage
from imud.probes.session import Probe, ProbeFound, Received, Session
from imud.recordings import replay
from imud.wire import kept, schema
from imud.wire.frame import FrameDecoder
from imud.wire.kept import KeptSchema
from imud.wire.messages import Message, decode

LOGS = sorted(Path(__file__).parent.glob("schemas/*.mcap"))
OURS = (kept.FOLDER / f"{schema.FINGERPRINT:08x}.txt").read_text("ascii")

# The older schema has another type, scale, null and name of a field, other names of
# members, lacks fields with and without a null, and has one that ours has not.
CHANGES = {
    "tilt_sigma 33 u16 1 1e-2 deg 65535 - -": "lean 33 u8 1 25e-2 deg 255 - -",
    "field heading_sigma 34 u16 1 1e-2 deg 65535 - -\n": "",
    " at_rest=2 ": " lies=2 ",
    "field receive_lost 66 u16 1 1e0 - - - -\n": "",
    "temperature 67 i16": "spare 68 u16 1 1e0 - - - -\nfield temperature 67 i16",
    "field own_sigma 115 u16 1 25e-2 uT - - -\n": "",
}


def fingerprint_of(canonical: str) -> int:
    return int.from_bytes(hashlib.sha256(canonical.encode()).digest()[:4], "little")


@pytest.fixture
def older(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> KeptSchema:
    """A schema with CHANGES, kept for this test."""
    text = OURS
    for new, old in CHANGES.items():
        assert text.count(new) == 1, new
        text = text.replace(new, old)
    fingerprint = fingerprint_of(text)
    path = tmp_path / "canonical.txt"
    path.write_text(text, "ascii")
    monkeypatch.setitem(kept._FILES, fingerprint, path)
    found = kept.find(fingerprint)
    assert found is not None
    return found


class OlderProbe(FakeProbe):
    """A probe whose firmware has an older schema."""

    def __init__(self, speaks: KeptSchema) -> None:
        super().__init__(schema_fingerprint=speaks.fingerprint)
        self._speaks = speaks

    def content(self, name: str, **fields: Any) -> bytes:
        ours = super().content(name, **fields)
        codec = self._speaks.others.get(ours[0])
        message = decode(ours)
        assert isinstance(message, Message)
        if codec is None:
            return ours
        values = {**message.fields, "spare": 7}
        parts = [bytes([f.tag]) + f.pack(values[f.name]) for f in codec.fields]
        return ours[:9] + b"".join(parts)


def class_of(kind: str, group: str) -> type[IntEnum] | type[IntFlag]:
    name = "".join(word.capitalize() for word in group.split("_"))
    found = getattr(schema, name + ("Flags" if kind == "flags" else ""))
    assert issubclass(found, IntEnum | IntFlag)
    return found


@pytest.mark.parametrize("fingerprint", kept.fingerprints())
def test_a_kept_schema_is_whole_and_nothing_of_it_has_another_meaning(
    fingerprint: int,
) -> None:
    """A tag, a number or a part that went, or went elsewhere, would be misread."""
    text = kept._FILES[fingerprint].read_text("ascii")
    assert fingerprint_of(text) == fingerprint
    ours = {message.id: message for message in schema.MESSAGES}
    parts = {record.tag: record.parts for record in schema.RECORDS}
    tags: set[int] = set()
    for line in text.splitlines():
        kind, name, *words = line.split()
        if kind in ("enum", "flags"):
            numbers = {int(word.split("=")[1]) for word in words}
            if kind == "flags":
                numbers = {1 << bit for bit in numbers}
            assert numbers <= {each.value for each in class_of(kind, name)}, name
        elif kind == "message":
            tags = {field.tag for field in ours[int(words[0])].fields}
        elif kind == "record":
            rest = iter(parts[int(words[0])])
        elif kind == "field" and words[0] == "0":
            part = next(rest)  # records only grow
            assert (part.name, part.type) == (name, words[1])
        elif kind == "field":
            assert int(words[0]) in tags, name


def test_what_an_older_schema_lacks_is_not_available(older: KeptSchema) -> None:
    probe = OlderProbe(older)
    pose = decode(older.to_ours(probe.content("pose", tilt_sigma=2.25)))
    assert isinstance(pose, Message)
    assert (pose.sequence, pose.time_us) == (0, 0)
    expected = EXAMPLES["pose"] | {"tilt_sigma": 2.25, "heading_sigma": None}
    assert pose.fields == expected  # and the flag by the name that it has today
    nothing = decode(older.to_ours(probe.content("pose", tilt_sigma=None)))
    assert isinstance(nothing, Message)
    assert nothing.fields["tilt_sigma"] is None
    status = decode(older.to_ours(probe.content("status", receive_lost=5)))
    assert isinstance(status, Message)
    assert status.fields == EXAMPLES["status"] | {"receive_lost": 0}
    raw = probe.content("raw")
    assert older.to_ours(raw) is raw


def test_damage_and_what_has_no_room_in_ours_are_left_as_they_are(
    older: KeptSchema,
) -> None:
    pose = OlderProbe(older).content("pose")
    for content in (b"", pose[:5], pose[:-1], pose + b"x", b"\xff" + pose[1:]):
        assert older.to_ours(content) == content
    assert not older.takes(pose)
    assert older.takes(OlderProbe(older).content("raw"))
    assert kept.find(None) is kept.find(older.fingerprint ^ 1) is None


@pytest.mark.parametrize("size", [1, 7, 64, 10_000])
def test_a_decoder_follows_the_hello_in_any_chunks(
    older: KeptSchema, size: int
) -> None:
    """Frames in the chunk of the hello and before it are those of its probe."""
    probe, fresh = OlderProbe(older), FakeProbe()
    stream = b"\0" + probe.say("pose") + b"\x05noise\0"
    stream += probe.say("hello") + probe.poses(3) + b"\x06more!\0" + probe.say("raw")
    decoder = FrameDecoder()
    got = [
        decode(content)
        for at in range(0, len(stream), size)
        for content in decoder.feed(stream[at : at + size])
    ]
    names = [message.name for message in got if isinstance(message, Message)]
    is_one = size > len(stream)
    assert names == ["pose"] * is_one + ["hello", "pose", "pose", "pose", "raw"]
    assert decoder.stats.ok == len(got)
    assert decoder.bad == sum(decoder.stats.bad.values()) == (2 if is_one else 3)
    assert len(decoder.feed(fresh.say("hello") + fresh.poses(2))) == 3
    assert decoder.stats.ok == len(got) + 3


def test_an_older_probe_is_read_and_known_to_be_one(older: KeptSchema) -> None:
    probe = OlderProbe(older)
    session = Session(Probe, 0)
    events = session.receive(b"\0" + probe.say("hello") + probe.poses(2), 1)
    found, *received = events
    assert isinstance(found, ProbeFound)
    assert found.hello.fields["schema_fingerprint"] == older.fingerprint
    names = [each.message.name for each in received if isinstance(each, Received)]
    assert names == ["hello", "pose", "pose"]
    counts = session.counts()
    assert (counts["frames"], counts["corrupt"], counts["foreign"]) == (3, 0, 0)
    again = Session(Probe, 0, session.probe)  # as of a file, whose hello is known
    (pose,) = again.receive(b"\0" + probe.say("pose"), 2)
    assert isinstance(pose, Received)


def poses_of(folder: Path) -> list[list[str]]:
    """Pitch, attitude, stated error and flags of each row of a table of poses."""
    (table,) = folder.glob("*pose.csv")
    columns = ("pitch_deg", "q_w", "q_x", "q_y", "q_z", "tilt_sigma_deg", "flags")
    rows = csv.DictReader(table.read_text("utf-8").splitlines())
    return [[row[column] for column in columns] for row in rows]


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_a_log_of_each_schema_opens_for_ever(
    path: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def run(*words: object) -> str:
        assert cli.main([str(word) for word in words]) == 0
        return capsys.readouterr().out

    items = [item for item in salvage(path) if not isinstance(item, Logged)]
    (head,) = items
    assert isinstance(head, LogHead)
    assert f"{head.fingerprint:08x}" == path.stem
    (probe,) = json.loads(run("info", "--json", path))["probes"]
    assert probe["received"] == probe["sent"] >= 40
    assert (probe["lost"], probe["board"]) == (0, "f405")

    told = [json.loads(line) for line in run("decode", "--json", path).splitlines()]
    assert len(told) == probe["received"]
    logged = [item for item in salvage(path) if isinstance(item, Logged)]
    for kind, key in (("raw", "acc_m_s2"), ("pose", "q"), ("stroke", "end")):
        published = [json.loads(item.data) for item in logged if item.topic == kind]
        read = [item for item in told if item["type"] == kind]
        assert read
        assert [item[key] for item in read] == [item[key] for item in published]

    run("export", path, "--to", "csv", "--out", tmp_path)
    (table,) = tmp_path.glob("*raw*.csv")
    rows = len(table.read_text().splitlines()) - 1
    assert rows == sum(item["type"] == "raw" for item in told)

    sent: list[bytes] = [b"\0"]
    port = SimpleNamespace(name="port", write=sent.append, drain=lambda: 0)
    port.wait_open = port.close = lambda: None
    monkeypatch.setattr(replay, "PtyPort", lambda _: port)
    run("replay", path, "--speed", "max")
    events = Session(Probe, 0).receive(b"".join(sent), 1)
    assert sum(isinstance(event, Received) for event in events) == len(told)

    # Fused, it is what the same messages in today's schema are, and level as its poses.
    today = tmp_path / "today.bin"
    today.write_bytes(b"".join(sent))
    for out, file in (("as_it_is", path), ("as_today", today)):
        run("export", file, "--fuse", "--out", tmp_path / out)
    fused, as_today = poses_of(tmp_path / "as_it_is"), poses_of(tmp_path / "as_today")
    assert fused == as_today
    level_deg = [float(row[0]) for row in poses_of(tmp_path)]
    assert [float(row[0]) for row in fused] == pytest.approx(level_deg, abs=0.1)


def test_each_schema_has_its_log() -> None:
    assert {int(path.stem, 16) for path in LOGS} == set(kept.fingerprints())
