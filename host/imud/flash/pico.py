# SPDX-License-Identifier: MIT
"""Writes an image into a Raspberry Pi Pico: its boot loader shows itself as a drive, on
which a copied UF2 file becomes the firmware.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import serial

from imud.errors import FlashError, reason
from imud.flash import OnProgress
from imud.flash.errors import HalfWritten

LOADER_BAUD = 1200  # opening a port at this rate starts the boot loader
LABEL = "RPI-RP2"
INFO = "INFO_UF2.TXT"
BOARD_ID = "Board-ID: RPI-RP2"  # in that file; a Pico 2 says RP2350
DRIVE_S = 60.0  # for a person to find BOOTSEL
GONE_S = 20.0
TICK_S = 0.2
PIECE = 8192
MOUNTS = Path("/proc/mounts")
VOLUMES = Path("/Volumes")  # of macOS
BY_LABEL = Path("/dev/disk/by-label") / LABEL


def flash(port: str | None, image: bytes, on_progress: OnProgress) -> int:
    """Copies a UF2 file onto the board's drive and waits until it has restarted;
    returns the bytes. `port`: of a board whose firmware is to start the boot loader;
    None: the user holds BOOTSEL. FlashError with what to do.
    """
    if port is not None and not drives():
        ask_for_loader(port)
    drive = found_drive(DRIVE_S)
    _copy(image, drive / "FIRMWARE.UF2", on_progress)
    until_s = time.monotonic() + GONE_S
    while drive in drives():
        if time.monotonic() > until_s:
            raise HalfWritten(
                f"{drive} still exists {GONE_S:g} s after the copy: unplug the "
                "board, hold BOOTSEL and plug it in"
            )
        time.sleep(TICK_S)
    return len(image)


def ask_for_loader(port: str) -> None:
    """Opens and closes a port, without DTR, at the rate that starts the boot loader."""
    try:
        with (
            serial.Serial(port, LOADER_BAUD, exclusive=True) as opened,
            contextlib.suppress(OSError),  # a pty has none
        ):
            opened.dtr = False  # the board waits for both
    except (OSError, ValueError) as error:
        raise FlashError(f"can't open {port}: {reason(error)}") from error


def found_drive(seconds: float) -> Path:
    """The drive of the one board in its boot loader, once it appears."""
    until_s = time.monotonic() + seconds
    while not (found := drives()):
        _mount()
        if time.monotonic() > until_s:
            hint = "unplug the board, hold BOOTSEL, plug it in"
            if BY_LABEL.exists():
                hint = f"mount it: udisksctl mount -b {BY_LABEL}"
            raise FlashError(f"no drive {LABEL} after {seconds:g} s: {hint}")
        time.sleep(TICK_S)
    if len(found) > 1:
        names = " and ".join(map(str, found))
        raise FlashError(f"two boards are in their boot loader: {names}; unplug one")
    return found[0]


def drives() -> list[Path]:
    """Drives of boards in their boot loader that are mounted."""
    return [each for each in _volumes() if _is_pico(each)]


def _volumes() -> Iterator[Path]:
    if sys.platform == "win32":
        yield from (Path(f"{letter}:/") for letter in "DEFGHIJKLMNOPQRSTUVWXYZ")
        return
    with contextlib.suppress(OSError):
        for line in MOUNTS.read_text(errors="replace").splitlines():
            # Spaces and the like are three octal digits there (fstab(5)).
            device, name, kind = line.split(" ")[:3]
            if device.startswith("/dev/") and kind == "vfat":  # as the boot loader has
                yield Path(name.encode().decode("unicode_escape"))
    with contextlib.suppress(OSError):
        yield from VOLUMES.iterdir()


def _is_pico(folder: Path) -> bool:
    with contextlib.suppress(OSError):
        return BOARD_ID in (folder / INFO).read_text(errors="replace")
    return False


def _mount() -> None:
    """Mounts a drive that is not mounted, as far as the user may without a password."""
    program = shutil.which("udisksctl")
    if program is None or not BY_LABEL.exists():
        return
    words = [program, "mount", "--no-user-interaction", "-b", str(BY_LABEL)]
    with contextlib.suppress(OSError, subprocess.TimeoutExpired):
        subprocess.run(words, capture_output=True, timeout=10.0, check=False)


def _copy(image: bytes, target: Path, on_progress: OnProgress) -> None:
    done = 0
    try:
        # Not through a link, to which a stick that is no board could lead.
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_NOFOLLOW", 0)
        file = os.fdopen(os.open(target, flags | getattr(os, "O_BINARY", 0)), "wb")
    except OSError as error:
        raise FlashError(f"can't write {target}: {error.strerror}") from error
    try:
        with file:
            for at in range(0, len(image), PIECE):
                file.write(image[at : at + PIECE])
                file.flush()
                os.fsync(file.fileno())
                done = min(at + PIECE, len(image))
                on_progress(done, len(image))
    except OSError as error:
        # The board restarts when it has the last block, before the drive is told.
        if done < len(image):
            raise HalfWritten(f"can't write {target}: {error.strerror}") from error
