# SPDX-License-Identifier: MIT
"""Writes an image into an STM32F405: by the bootloader in its ROM over a serial port,
or by `dfu-util` over its own USB port.

The block with the vectors is written last: a cut leaves a board that does not start,
and whose ROM takes the image again. The sectors with the settings are never erased.
"""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import serial

from imud.errors import FlashError
from imud.flash import OnProgress, serial_port
from imud.flash.an3155 import BLOCK_MAX, An3155
from imud.flash.errors import HalfWritten, WrongChip
from imud.flash.firmware import F405_AT, F405_MAX

CHIP = 0x413  # AN2606: STM32F405xx/07xx and STM32F415xx/17xx
BAUD = 115_200
SYNC_S = 60.0  # for a person to connect BOOT0 and press RST
# RM0090, "Embedded Flash memory": bytes of sectors 0 to 9. 10 and 11 are the settings.
SECTORS = (*4 * (16 * 1024,), 64 * 1024, *5 * (128 * 1024,))

DFU_ID = "0483:df11"
DFU_LIST_S = 10.0
DFU_WRITE_S = 120.0


def flash(port: str, image: bytes, on_progress: OnProgress, *, sync_s: float) -> int:
    """Writes an image by the ROM on a port, starts it, and returns its bytes.
    FlashError with what to do if that did not end well.
    """
    with serial_port.opened(port, BAUD, parity=serial.PARITY_EVEN) as wire:
        rom = An3155(wire)
        rom.sync(sync_s)
        if (chip := rom.chip()) != CHIP:
            raise WrongChip(
                f"the board has chip {chip:#x}, not an STM32F405 ({CHIP:#x})"
            )
        write(rom, image, on_progress)
        # All of it was read back: if there is no answer any more, RST starts it.
        with contextlib.suppress(FlashError, OSError):
            rom.go(F405_AT)
    return len(image)


def write(
    rom: An3155, image: bytes, on_progress: OnProgress = lambda _done, _all: None
) -> None:
    """Erases the sectors that the image needs, writes and reads back."""
    if not 0 < len(image) <= F405_MAX:
        raise FlashError(f"the image has {len(image)} bytes, not 1 to {F405_MAX}")
    whole = image.ljust(-(-len(image) // 4) * 4, b"\xff")  # it takes words
    blocks = {at: whole[at : at + BLOCK_MAX] for at in range(0, len(whole), BLOCK_MAX)}
    others = [at for at in blocks if at > 0]
    steps = 2 * len(blocks)
    done = 0
    try:
        rom.erase(_needed(len(image)))
        for chosen in (others, [0]):
            for at in chosen:
                rom.write(F405_AT + at, blocks[at])
                on_progress(done := done + 1, steps)
            for at in chosen:
                _compare(rom, F405_AT + at, blocks[at])
                on_progress(done := done + 1, steps)
    except (FlashError, OSError) as error:
        raise HalfWritten(str(error)) from error


def _compare(rom: An3155, address: int, block: bytes) -> None:
    if rom.read(address, len(block)) != block:
        raise FlashError(f"the bytes at {address:#010x} read back wrong")


def _needed(size: int) -> list[int]:
    """The sectors that so many bytes from the start lie in."""
    found, end = [], 0
    for sector, length in enumerate(SECTORS):
        if end < size:
            found.append(sector)
        end += length
    return found


def write_by_dfu_util(image: bytes, *, wait_s: float = SYNC_S) -> int:
    """Has dfu-util write an image to the one board that is in DFU mode, once it is, and
    returns its bytes. FlashError with what to do if that did not end well.
    """
    program = shutil.which("dfu-util")
    if program is None:
        raise FlashError(
            "dfu-util is not installed: apt-get install dfu-util, or flash by a serial "
            "cable: imud flash PORT --board f405 --by serial"
        )
    until_s = time.monotonic() + wait_s
    while DFU_ID not in _run([program, "-l"], DFU_LIST_S)[1]:
        if time.monotonic() > until_s:
            raise FlashError(
                f"no board in DFU mode after {wait_s:g} s: connect DFU to 3V3, press "
                "RST, and see dfu-util -l"
            )
        time.sleep(0.5)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "firmware.bin"
        path.write_bytes(image)
        words = ["-d", DFU_ID, "-a", "0", "-s", f"{F405_AT:#x}:leave", "-D", str(path)]
        try:
            status, text = _run([program, *words], DFU_WRITE_S)
        except FlashError as error:
            raise HalfWritten(str(error)) from error
    # It reports an error of the last request, as the board has already left.
    if status != 0 and "File downloaded successfully" not in text:
        last = text.strip().splitlines()[-1:] or ["no output"]
        raise HalfWritten(f"dfu-util: {last[0]}")
    return len(image)


def _run(words: list[str], seconds: float) -> tuple[int, str]:
    try:
        done = subprocess.run(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=seconds,
            text=True,
            errors="replace",
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise FlashError(f"dfu-util did not finish within {seconds:g} s") from error
    return done.returncode, done.stdout
