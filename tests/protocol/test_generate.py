# SPDX-License-Identifier: MIT
"""The generator: its files are up to date, and its output for another schema works."""

from __future__ import annotations

import hashlib
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import generate
from generator import c_code, checker, published, python_code
from generator.schema import SchemaError
from programs import ran
from protocol import wire
from protocol.small import SMALL, change, load

ROOT = Path(__file__).resolve().parents[2]
CACHES = shutil.ignore_patterns("__pycache__")
SCHEMA = (ROOT / "protocol" / "schema.toml").read_text("utf-8")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of all that the generator reads and writes."""
    shutil.copytree(ROOT / "protocol", tmp_path / "protocol", ignore=CACHES)
    for file in (*generate.outputs(checker.load(generate.SCHEMA)),):
        target = tmp_path / file
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / file, target)
    return tmp_path


def run(project: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return ran(sys.executable, str(project / "protocol" / "generate.py"), *arguments)


def test_what_is_committed_is_what_the_schema_says() -> None:
    done = run(ROOT, "--check")
    assert (done.stdout, done.stderr, done.returncode) == ("", "", 0)


@pytest.mark.nightly
def test_each_stale_file_is_named_with_what_differs(project: Path) -> None:
    for path in generate.outputs(checker.load(generate.SCHEMA)):
        file = project / path
        fresh = file.read_text("utf-8")
        # Only inside generated text: the generator leaves a document's prose alone.
        parts = re.split("(<!-- begin.*?<!-- end generated -->)", fresh, flags=re.S)
        spoiled = slice(1 if len(parts) > 1 else 0, None, 2)
        parts[spoiled] = [re.sub("sigma|RIHS", "stigma", e) for e in parts[spoiled]]
        file.write_text("".join(parts), "utf-8")
        done = run(project, "--check")
        assert done.returncode == 1
        lines = done.stdout.splitlines()
        assert lines[0].startswith(f"{path} is stale")
        assert any(line.startswith("-") and "stigma" in line for line in lines)
        assert len([line for line in lines if " is stale" in line]) == 1
        assert run(project).returncode == 0
        assert file.read_text("utf-8") == fresh


def test_a_missing_file_is_stale_and_a_fresh_one_is_left_alone(project: Path) -> None:
    missing, fresh = project / generate.C_HEADER, project / generate.C_SOURCE
    before = fresh.stat().st_mtime_ns
    text = missing.read_text("utf-8")
    missing.unlink()
    assert f"{generate.C_HEADER} is stale" in run(project, "--check").stdout
    assert run(project).returncode == 0
    assert missing.read_text("utf-8") == text
    assert fresh.stat().st_mtime_ns == before


def test_a_document_without_its_markers_is_refused(project: Path) -> None:
    document = project / generate.DOCUMENT
    text = document.read_text("utf-8")
    document.write_text(text.replace("<!-- begin generated: groups -->", ""), "utf-8")
    done = run(project)
    assert done.returncode == 1
    assert done.stderr.startswith("protocol/PROTOCOL.md: needs one line")
    assert len(done.stderr.splitlines()) == 1


def test_a_mistake_stops_the_generator_and_writes_nothing(project: Path) -> None:
    schema = project / "protocol" / "schema.toml"
    schema.write_text(change(SCHEMA, "id = 0x05", "id = 0x07"), "utf-8")
    before = (project / generate.C_HEADER).read_text("utf-8")
    done = run(project)
    assert done.returncode == 1
    assert done.stderr.startswith("schema.toml: message raw: id 0x07 is less than")
    assert (project / generate.C_HEADER).read_text("utf-8") == before


def test_a_field_of_a_pose_is_published_everywhere_or_refused(tmp_path: Path) -> None:
    last = 'meaning = "quality of this pose" },\n'
    field = '{ name = "lift", tag = 36, type = "u16", scale = 0.1, unit = "m/s2",'
    schema = load(tmp_path, change(SCHEMA, last, f'{last} {field} meaning = "m" }},'))
    known = (ROOT / generate.PUBLISHED).read_text("utf-8")
    (file := tmp_path / "published.toml").write_text(known, "utf-8")
    with pytest.raises(SchemaError, match=r"PoseFields: needs a row for \['lift'\]"):
        published.load(file, schema)
    row = '  { wire = "pose_flags"'
    more = change(known, row, f'  {{ wire = "lift", meaning = "up" }},\n{row}')
    file.write_text(more, "utf-8")
    structs = published.load(file, schema)
    assert "    lift_m_s2: float\n" in published.python(structs)
    assert '        "lift_m_s2": "lift",\n' in published.python(structs)
    assert " * @property {number} lift_m_s2\n" in published.script(structs)
    assert '  "lift_m_s2",\n' in published.script(structs)
    text = (ROOT / generate.POSE).read_text("utf-8")
    assert "\n| `lift_m_s2` | up |\n" in published.document(structs, text)


def test_canonical_is_printed_on_request() -> None:
    done = run(ROOT, "--canonical")
    digest = hashlib.sha256(done.stdout.encode("ascii")).digest()
    expected = int.from_bytes(digest[:4], "little")
    assert expected == wire.lib.SCHEMA_FINGERPRINT
    assert expected & 0xFFFF == wire.lib.SCHEMA_SEED


def test_tags_with_a_gap_are_known_one_by_one(tmp_path: Path) -> None:
    """A tag in a gap between a message's own is not the message's."""
    source = c_code.source(load(tmp_path, SMALL))
    expected = ["1", "2", "10", "11", "12", "14", "15"]
    assert re.findall(r"FIELD\((\d+),", source) == expected


@pytest.mark.parametrize("compiler", ["gcc", "avr-gcc", "arm-none-eabi-gcc"])
def test_another_schemas_c_compiles_without_a_warning(
    tmp_path: Path, compiler: str
) -> None:
    schema = load(tmp_path, SMALL)
    wire = tmp_path / "core" / "wire"
    wire.mkdir(parents=True)
    (wire / "messages.h").write_text(c_code.header(schema), "utf-8")
    (wire / "messages.c").write_text(c_code.source(schema), "utf-8")
    for name in ("wire/frame.h", "math/in_flash.h"):
        (tmp_path / "core" / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / "firmware" / "core" / name, tmp_path / "core" / name)
    warnings = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")
    done = ran(
        *(compiler, "-std=gnu11", *warnings, "-Os", "-I.", "-c", wire / "messages.c"),
        cwd=tmp_path,
    )
    assert done.stderr == ""
    assert done.returncode == 0


def test_another_schemas_python_says_what_it_says(tmp_path: Path) -> None:
    room: dict[str, object] = {"__name__": "schema_under_test"}
    module = ModuleType("schema_under_test")
    sys.modules[module.__name__] = module
    text = python_code.module(load(tmp_path, SMALL))
    exec(compile(text, "schema.py", "exec"), room)  # noqa: S102 - our own output
    messages = room["MESSAGES"]
    assert isinstance(messages, tuple)
    news = messages[1]
    assert (news.name, news.id, news.direction) == ("news", 5, "probe")
    mood, sign, way, turn, word = news.fields
    assert mood.enum(1).name == "BAD"
    assert sign.flags(0x80).name == "FAR"
    assert (way.scale, way.unit, way.null, way.code) == (0.01, "m", -32768, "3h")
    assert turn.scale == 2**-30
    assert word.code == "4s"
