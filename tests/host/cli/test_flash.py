# SPDX-License-Identifier: MIT
"""`imud flash` for an F405, whose ROM and whose dfu-util are models; and what is wrong
before a board is touched. The Nano's is tests/system/test_flash.py.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import msgspec
import pytest
from intelhex import IntelHex

from fakes import free_endpoint
from host.flash.stm32_rom import BASE, Stm32Rom
from host.flash.test_f405 import FOUND, dfu_util
from imud import cli
from imud.cli import check_ports, flash_run, reached
from imud.errors import FlashError
from imud.flash import OnProgress, f405, firmware
from imud.flash.errors import HalfWritten
from imud.flash.stk500 import NoBootloader
from imud.wire.schema import FINGERPRINT

SCHEMA = f"{FINGERPRINT:08x}"
CODE = bytes.fromhex("00200010 41010008") + bytes(range(256)) * 40


@pytest.fixture(autouse=True)
def nobody(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No daemon is at the default endpoint."""
    endpoint = free_endpoint()
    monkeypatch.setattr(reached, "ENDPOINT", endpoint)
    monkeypatch.setattr("imud.cli.arguments.ENDPOINT", endpoint)
    monkeypatch.setattr(check_ports, "PROBE_S", 0.5)
    monkeypatch.setattr(f405, "SYNC_S", 3.0)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


@pytest.fixture
def image(tmp_path: Path) -> Path:
    path = tmp_path / "f405.hex"
    found = IntelHex()
    found.puts(BASE, CODE)
    found.write_hex_file(str(path))
    row = {
        "file": path.name,
        "board": "f405",
        "filter": "all",
        "version": "9.9.9+1234567",
        "schema": SCHEMA,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "bytes": len(CODE),
    }
    path.with_name("manifest.json").write_text(json.dumps({"images": [row]}))
    return path


@pytest.fixture
def rom() -> Iterator[Stm32Rom]:
    found = Stm32Rom()
    yield found
    found.close()


def test_a_new_f405_is_written_by_its_rom(
    rom: Stm32Rom, image: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["flash", rom.port, "--board", "f405", "--by", "serial"]
    assert cli.main([*words, "--image", str(image), "--dry-run"]) == 0
    assert "nothing was written" in capsys.readouterr().out
    assert rom.erased == []
    assert cli.main([*words, "--image", str(image)]) == 0
    said = capsys.readouterr().out
    assert "put the cable on Y9 and Y10, connect DFU to 3V3, press RST" in said
    assert f"{len(CODE):,} bytes written and read back" in said
    rom.ended()
    assert rom.flash.startswith(CODE)
    assert rom.started_at == BASE


def test_a_new_f405_is_written_by_dfu_util(
    image: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    dfu_util(tmp_path, FOUND, 0, "File downloaded successfully")
    words = ["flash", "--board", "f405", "--by", "dfu", "--image", str(image)]
    assert cli.main(words) == 0
    assert "connect the USB cable, and DFU to 3V3" in capsys.readouterr().out
    assert (tmp_path / "written").read_bytes() == CODE


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--board", "nano"], "is for an STM32F405, but the board is an Arduino Nano"),
        (["--board", "nano", "--by", "dfu"], "--by is for an F405"),
        (["--board", "f405", "--filter", "fuse"], "leave out --filter or --image"),
        ([], "if the board has no firmware of ours, pass its type: imud flash"),
    ],
)
def test_what_makes_no_sense_is_one_line(
    words: list[str],
    says: str,
    rom: Stm32Rom,
    image: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(["flash", rom.port, "--image", str(image), *words]) == 1
    line = capsys.readouterr().err
    assert says in line
    assert line.count("\n") == 1
    assert rom.erased == []


@pytest.mark.parametrize(
    ("version", "schema", "says"),
    [
        (
            "0.2.0+aaaaaaa",
            SCHEMA,
            "the board already has 0.2.0+aaaaaaa; write it again with --force",
        ),
        (
            "0.1.9+bbbbbbb",
            SCHEMA,
            "older than the board's 0.2.0+aaaaaaa; write it anyway",
        ),
        ("0.3.0+bbbbbbb", "00000000", "has schema 00000000, but this imud"),
        ("0.2.0+bbbbbbb", SCHEMA, ""),
        ("0.10.0+bbbbbbb", SCHEMA, ""),
        ("0.2.0+bbbbbb-d", SCHEMA, ""),
    ],
)
def test_only_a_step_ahead_is_written_without_force(
    version: str, schema: str, says: str, image: Path
) -> None:
    given = firmware.read(image)
    assert given.about is not None
    about = msgspec.structs.replace(given.about, version=version, schema=schema)
    offered = firmware.Image(given.path, given.code, given.sha256, about)
    hello = {"firmware": "0.2.0+aaaaaaa", "filter": "fuse"}
    with pytest.raises(FlashError, match=re.escape(says)) if says else nullcontext():
        flash_run._check_step(hello, offered, is_forced=False)
    flash_run._check_step(hello, offered, is_forced=True)


def test_a_board_that_a_try_left_half_written_is_told_whatever_the_next_one_says(
    image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (port := tmp_path / "port").touch()
    errors = [HalfWritten("a page reads back wrong"), *2 * [NoBootloader("no answer")]]

    def write(_port: str, _image: firmware.Image, _on_progress: OnProgress) -> str:
        raise errors.pop(0)

    with pytest.raises(FlashError, match="wrong: the board has no working firmware"):
        flash_run._write(write, "nano", str(port), firmware.read(image), None)
    assert errors == []
    assert "no answer; retrying" in capsys.readouterr().out


def test_a_rom_that_does_not_answer_leaves_the_board_as_it_was(
    image: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ours, theirs = os.openpty()
    words = ["flash", os.ttyname(theirs), "--board", "f405", "--by", "serial"]
    try:
        assert cli.main([*words, "--image", str(image)]) == 1
    finally:
        os.close(ours)
        os.close(theirs)
    line = capsys.readouterr().err
    assert "no bootloader of an STM32 answered" in line
    assert line.endswith("nothing was written\n")
