# SPDX-License-Identifier: MIT
"""tools/compilers.py without a network; what it fetches and builds shows when
`make compilers` is run."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import compilers
import pytest

ROOT = Path(__file__).resolve().parents[2]

LIMIT = 30_720


def image(free: int, is_default: bool = True) -> compilers.Image:
    return compilers.Image("7.3.0", "nano", is_default, LIMIT - free, 1_426)


def test_one_byte_below_the_reserve_fails_and_the_bytes_are_named() -> None:
    assert compilers.shortages([image(1_200)], LIMIT, 1_200) == []
    assert compilers.shortages([image(1_199)], LIMIT, 1_200) == [
        "nano with avr-gcc 7.3.0: 1,199 bytes free of 30,720, "
        "1 fewer than the reserve of 1,200"
    ]


def test_the_reserve_is_for_the_image_that_is_flashed_by_default() -> None:
    assert compilers.shortages([image(0, is_default=False)], LIMIT, 1_200) == []


@pytest.mark.parametrize("is_default", [False, True])
def test_an_image_that_does_not_fit_fails_whatever_its_filter(is_default: bool) -> None:
    assert compilers.shortages([image(-2, is_default)], LIMIT, 0) == [
        "nano with avr-gcc 7.3.0: 2 bytes over the limit of 30,720"
    ]


def test_each_image_of_ours_is_built_once() -> None:
    """Environments for the old bootloader, and those that download, are left out."""
    found = compilers.environments(compilers.project_config())
    papers = dict.fromkeys(("complementary", "mahony", "madgwick", "dcm_pi"), False)
    assert found == {
        "nano": True,
        **{f"nano_{name}": value for name, value in papers.items()},
        "nano_as_pio": True,
        "nano_lsm6dsox": False,
    }


def test_bytes_are_those_that_are_flashed(tmp_path: Path) -> None:
    code = tmp_path / "code.c"
    code.write_text(
        'int here = 7, there; __attribute__((section(".noinit"))) char kept;'
        "int main(void) { return here + there + kept; }"
    )
    elf, flashed = tmp_path / "code.elf", tmp_path / "flashed"
    words = ["avr-gcc", "-mmcu=atmega328p", "-Os", code, "-o", elf]
    subprocess.run(words, check=True)
    # Code and what variables start with, as one piece.
    words = ["avr-objcopy", "-O", "binary", "-R", ".eeprom", elf, flashed]
    subprocess.run(words, check=True)
    programs = Path(shutil.which("avr-size") or "").parent
    flash, ram = compilers.in_memories(compilers.sections(programs, elf))
    assert flash == flashed.stat().st_size
    assert ram == 2 + 2 + 1


def no_compiler(*_: Any) -> Path:
    raise compilers.NotInstalled("no network")


@pytest.mark.parametrize(("ci", "code"), [("", 0), ("true", 1)])
def test_an_unavailable_compiler_is_reported_in_one_line_and_fails_in_ci(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    ci: str,
    code: int,
) -> None:
    def found(version: str, _: Any) -> Path:
        return Path() if version == "5.4.0" else no_compiler()

    monkeypatch.setenv("CI", ci)
    monkeypatch.setattr(compilers, "project_config", dict)
    monkeypatch.setattr(compilers, "build", lambda *_: ([image(1_200)], []))
    monkeypatch.setattr(compilers, "installed", found)
    assert compilers.main() == code
    told = capsys.readouterr().out.splitlines()
    assert told[:2] == [
        "avr-gcc 7.3.0 (PlatformIO, Arduino): no network",
        "avr-gcc 14.2.0 (Debian 13): no network",
    ]
    failed = [line for line in told if line.startswith("FAILED: ")]
    assert failed == [f"FAILED: {line}" for line in told[:2] if ci]


def test_a_failed_build_is_reported_with_its_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """And no image of an earlier build is measured in its place."""
    monkeypatch.setattr(compilers, "BUILD", tmp_path)
    left = tmp_path / "7.3.0" / "nano" / "firmware.elf"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"an earlier image")
    done = SimpleNamespace(stdout="Compiling\nmain.c:3: error: no\nError 1\n")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    images, faults = compilers.build("7.3.0", tmp_path, {"nano": True})
    assert (images, faults) == ([], ["nano with avr-gcc 7.3.0: main.c:3: error: no"])


def test_a_compiler_is_fetched_once_and_again_only_if_that_failed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    fetched = []

    def fetch(into: Path) -> Path:
        fetched.append(into)
        program = into / "bin" / "avr-gcc"
        program.parent.mkdir()
        version = "9.9.9" if len(fetched) > 1 else "0.0.0"
        program.write_text(f"#!/bin/sh\necho {version}\n")
        program.chmod(0o755)
        return program.parent

    with pytest.raises(compilers.NotInstalled, match=r"not version 9\.9\.9"):
        compilers.installed("9.9.9", fetch)
    folders = {compilers.installed("9.9.9", fetch) for _ in range(2)}
    assert folders == {fetched[0] / "bin"}
    assert len(fetched) == 2


def test_a_failed_command_gives_its_reason_in_one_line() -> None:
    with pytest.raises(compilers.NotInstalled, match=r"^E: no such package$"):
        compilers.output(
            "sh", "-c", "echo W: old >&2; echo E: no such package >&2; false"
        )
    with pytest.raises(compilers.NotInstalled, match=r"^no-such-program: No such file"):
        compilers.output("no-such-program")
