# SPDX-License-Identifier: MIT
"""The Nano's image with the flags of PlatformIO's own platform for the AVR, which
optimises at link time, and what platformio.ini removes from them."""

from __future__ import annotations

import configparser
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from native import locked
from programs import ran

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "official"
PIO = (sys.executable, "-m", "platformio")
# In a folder that it does not know PlatformIO would remove the image first.
UPLOAD = ("--disable-auto-clean", "-t", "nobuild", "-t", "upload")
FLAGS = "-flto -fno-fat-lto-objects -fuse-linker-plugin"


def built(
    *environments: str,
    ini: Path = ROOT / "platformio.ini",
    more: Sequence[str] = (),
) -> Path:
    """Build images by a platformio.ini; return the folder of their folders."""
    folder = BUILD / ("with" if ini.parent == ROOT else "without")
    folder.mkdir(parents=True, exist_ok=True)
    words = [word for name in environments for word in ("-e", name)]
    kept = {name: os.environ[name] for name in os.environ if "PLATFORMIO" not in name}
    with locked(BUILD / ".lock"):
        done = ran(
            *(*PIO, "run", "-s", "-c", ini, *words, *more),
            cwd=ROOT,
            env=kept | {"PLATFORMIO_BUILD_DIR": str(folder)},
        )
    # An image that is too large for the bootloader is linked anyway.
    assert done.returncode == 0 or "greater than maximum" in done.stderr, done.stderr
    return folder


@pytest.fixture(scope="module")
def with_ours() -> Path:
    return built("nano_as_pio") / "nano_as_pio"


@pytest.fixture(scope="module")
def without_ours() -> Path:
    """Built with a platformio.ini that removes none of the official flags."""
    BUILD.mkdir(parents=True, exist_ok=True)
    text = (ROOT / "platformio.ini").read_text()
    changed, count = re.subn(r"(?m)^build_unflags = .*\n", "", text)
    assert count == 1
    ini = BUILD / "without.ini"  # PlatformIO empties its own folders
    if not ini.exists() or ini.read_text() != changed:
        ini.write_text(changed)
    return built("nano_as_pio", ini=ini) / "nano_as_pio"


def flash_bytes(elf: Path) -> int:
    shown = subprocess.run(["avr-size", elf], capture_output=True, check=True)
    text, data = shown.stdout.splitlines()[1].split()[:2]
    return int(text) + int(data)


def addresses(elf: Path) -> dict[str, int]:
    shown = ran("avr-nm", elf, check=True)
    rows = [line.split() for line in shown.stdout.splitlines()]
    return {row[2]: int(row[0], 16) for row in rows if len(row) == 3}


def version(folder: Path) -> object:
    return json.loads((folder / "manifest.json").read_text())["images"][0]["version"]


@pytest.mark.nightly
def test_the_image_is_the_same_byte_by_byte_with_the_official_flags(
    with_ours: Path, image: Path
) -> None:
    folder = image.parent
    if version(folder) != version(with_ours):
        shutil.rmtree(BUILD / "with" / "nano", ignore_errors=True)  # of an upload
        folder = built("nano") / "nano"
    images = [(path / "firmware.hex").read_bytes() for path in (folder, with_ours)]
    assert images[0] == images[1]


@pytest.mark.nightly
def test_without_our_unflags_it_is_larger_and_files_lie_elsewhere(
    with_ours: Path, without_ours: Path
) -> None:
    """avr/fixed_mul is in the middle of the filter, behind main."""
    ours, official = (each / "firmware.elf" for each in (with_ours, without_ours))
    assert flash_bytes(official) > flash_bytes(ours) + 500
    assert addresses(ours)["main"] < addresses(ours)["fixed_mul_q30"]
    assert addresses(official)["fixed_mul_q30"] < addresses(official)["main"]


def test_environments_with_the_official_flags_take_them_from_one_place() -> None:
    ini = configparser.ConfigParser(interpolation=None)
    ini.read(ROOT / "platformio.ini")
    assert ini["env:nano_as_pio"]["extends"] == "env:nano_pio, system"
    assert "official:avr" in ini["env:nano_pio"]["extends"]
    assert ini["official:avr"]["build_unflags"] == FLAGS
    assert ini["env:nano_pio_old"]["extends"] == "env:nano_pio, bootloader:old"
    assert ini["bootloader:old"]["upload_speed"] == "57600"


@pytest.mark.parametrize(("name", "baud"), [("nano", "115200"), ("nano_old", "57600")])
def test_uploads_use_the_baud_rate_of_the_bootloader(
    name: str, baud: str, image: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seen in avrdude's arguments."""
    avrdude, told = tmp_path / "avrdude", tmp_path / "told"
    avrdude.write_text(f'#!/bin/sh\necho "$@" > "{told}"\n')
    avrdude.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    folder = BUILD / "with" / name
    folder.mkdir(parents=True, exist_ok=True)
    for each in image.parent.glob("firmware.*"):
        shutil.copy(each, folder)
    built(name, more=(*UPLOAD, "--upload-port", "/dev/a-nano"))
    hex_file = (folder / "firmware.hex").relative_to(ROOT)
    assert told.read_text().split() == [
        *("-p", "atmega328p", "-c", "arduino", "-b", baud, "-P", "/dev/a-nano"),
        *("-D", "-U", f"flash:w:{hex_file}:i"),
    ]
