# SPDX-License-Identifier: MIT
"""An image in an STM32F405: by its ROM, and by a program that is called dfu-util."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from host.flash.stm32_rom import BASE, Stm32Rom
from imud.errors import FlashError
from imud.flash import f405
from imud.flash.errors import HalfWritten, WrongChip

SETTINGS = b"\x5a" * 0x40000  # in the last two sectors
OLD = (b"\x01" * 0xC0000) + SETTINGS
NEW = bytes(range(256)) * 210 + b"end"  # in sectors 0 to 3


@pytest.fixture
def opened() -> Iterator[list[Stm32Rom]]:
    roms: list[Stm32Rom] = []
    yield roms
    for rom in roms:
        rom.close()


def quiet(_done: int, _all: int) -> None:
    pass


def test_an_image_is_written_read_back_and_started(opened: list[Stm32Rom]) -> None:
    opened.append(rom := Stm32Rom(OLD))
    seen: list[tuple[int, int]] = []
    size = f405.flash(rom.port, NEW, lambda *at: seen.append(at), sync_s=5.0)
    rom.ended()
    assert size == len(NEW)
    assert rom.flash.startswith(NEW)
    assert rom.flash.endswith(SETTINGS)
    assert rom.erased == [0, 1, 2, 3]
    assert rom.started_at == BASE
    assert seen[-1] == (len(seen), len(seen))


def test_an_image_that_was_read_back_is_written_whoever_starts_it(
    opened: list[Stm32Rom],
) -> None:
    class Unplugged(Stm32Rom):
        def _command(self, command: int) -> bool:
            return command != 0x21 and super()._command(command)

    opened.append(rom := Unplugged(OLD))
    assert f405.flash(rom.port, NEW, quiet, sync_s=5.0) == len(NEW)
    assert rom.flash.startswith(NEW)


@pytest.mark.parametrize("blocks", [0, 1, 100, 209])
def test_a_cut_leaves_no_vectors_and_the_next_try_works(
    blocks: int, opened: list[Stm32Rom]
) -> None:
    opened.append(rom := Stm32Rom(OLD, stops_after=blocks))
    with pytest.raises(HalfWritten, match="did not answer for the bytes at 0x0800"):
        f405.flash(rom.port, NEW, quiet, sync_s=5.0)
    assert rom.flash.startswith(b"\xff" * 256)  # the processor starts nothing
    opened.append(again := Stm32Rom(bytes(rom.flash)))
    f405.flash(again.port, NEW, quiet, sync_s=5.0)
    assert again.flash.startswith(NEW)
    assert again.flash.endswith(SETTINGS)


def test_another_chip_is_not_written(opened: list[Stm32Rom]) -> None:
    opened.append(rom := Stm32Rom(OLD, chip=0x411))
    with pytest.raises(WrongChip, match="chip 0x411, not an STM32F405"):
        f405.flash(rom.port, NEW, quiet, sync_s=5.0)
    assert rom.flash == OLD
    assert rom.erased == []


def test_where_nobody_answers_is_told() -> None:
    ours, theirs = os.openpty()
    try:
        with pytest.raises(FlashError, match="no bootloader of an STM32 answered"):
            f405.flash(os.ttyname(theirs), NEW, quiet, sync_s=0.5)
    finally:
        os.close(ours)
        os.close(theirs)


@pytest.mark.parametrize("size", [0, 768 * 1024 + 1])
def test_an_image_that_reaches_the_settings_is_refused(
    size: int, opened: list[Stm32Rom]
) -> None:
    opened.append(rom := Stm32Rom(OLD))
    with pytest.raises(FlashError, match="not 1 to 786432"):
        f405.flash(rom.port, bytes(size), quiet, sync_s=5.0)
    assert rom.erased == []


def dfu_util(folder: Path, listed: str, status: int, says: str) -> None:
    """A program of that name, which writes down what it is given."""
    program = folder / "dfu-util"
    program.write_text(
        f"""#!/bin/sh
if [ "$1" = -l ]; then echo '{listed}'; exit 0; fi
echo "$@" > {folder}/words
while [ $# -gt 1 ]; do shift; done
cp "$1" {folder}/written
echo '{says}'
exit {status}
"""
    )
    program.chmod(0o755)


FOUND = "Found DFU: [0483:df11] ver=2200, devnum=7, cfg=1, intf=0, alt=0"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    return tmp_path


def test_dfu_util_gets_the_image_and_where_it_belongs(folder: Path) -> None:
    # The board leaves in the last request, which dfu-util takes for an error.
    dfu_util(folder, FOUND, 74, "File downloaded successfully")
    assert f405.write_by_dfu_util(NEW) == len(NEW)
    assert (folder / "written").read_bytes() == NEW
    words = (folder / "words").read_text()
    assert words.startswith("-d 0483:df11 -a 0 -s 0x8000000:leave -D ")


def test_what_dfu_util_complains_of_is_told(folder: Path) -> None:
    dfu_util(folder, FOUND, 1, "Error sending dnload request")
    with pytest.raises(HalfWritten, match="dfu-util: Error sending dnload request"):
        f405.write_by_dfu_util(NEW)


def test_without_a_board_in_dfu_mode_it_says_how_to_get_there(folder: Path) -> None:
    dfu_util(folder, "nothing", 0, "")
    with pytest.raises(FlashError, match="connect DFU to 3V3, press RST"):
        f405.write_by_dfu_util(NEW, wait_s=0.1)
    assert not (folder / "written").exists()


def test_without_dfu_util_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(FlashError, match="apt-get install dfu-util"):
        f405.write_by_dfu_util(NEW)
