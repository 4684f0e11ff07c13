# SPDX-License-Identifier: MIT
"""An image on the drive of a Pico's boot loader, played by a folder."""

from __future__ import annotations

import os
import shutil
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from imud.errors import FlashError
from imud.flash import firmware, pico, serial_port, uf2
from imud.flash.errors import HalfWritten

BOOT2 = bytes(range(252)) + bytes.fromhex("a8e254b4")  # CRC-32/MPEG-2
IMAGE = BOOT2 + bytes(range(256)) * 249 + b"end"
FAMILY = uf2.FAMILIES["rp2040"]
FILE = uf2.encoded(IMAGE, firmware.PICO_AT, FAMILY)


def quiet(_done: int, _all: int) -> None:
    pass


class Loader:
    """A board in its boot loader: restarts once it has a whole file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "RPI-RP2 of x"
        self.mounts = folder / "mounts"
        self.mounts.write_text("proc /proc proc rw 0 0\n")
        self.got = b""
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._wait, daemon=True)

    def appear(
        self, board: str = "RPI-RP2", kind: str = "vfat", *, restarts: bool = True
    ) -> None:
        self.folder.mkdir()
        info = f"UF2 Bootloader v3.0\nModel: Raspberry Pi RP2\nBoard-ID: {board}\n"
        (self.folder / pico.INFO).write_text(info)
        name = str(self.folder).replace(" ", "\\040")
        with self.mounts.open("a") as file:
            file.write(f"/dev/sdb1 {name} {kind} rw 0 0\n")
        if restarts:
            self._thread.start()

    def _wait(self) -> None:
        file = self.folder / "FIRMWARE.UF2"
        while not self._is_over.wait(0.02):
            if file.exists() and file.stat().st_size == len(FILE):
                self.got = file.read_bytes()
                shutil.rmtree(self.folder)
                return

    def close(self) -> None:
        self._is_over.set()
        if self._thread.is_alive():
            self._thread.join()


@pytest.fixture
def loader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Loader]:
    made = Loader(tmp_path)
    monkeypatch.setattr(pico, "MOUNTS", made.mounts)
    monkeypatch.setattr(pico, "VOLUMES", tmp_path / "no-volumes")
    monkeypatch.setattr(pico, "BY_LABEL", tmp_path / "no-label")
    monkeypatch.setattr(pico, "DRIVE_S", 0.3)
    monkeypatch.setattr(pico, "GONE_S", 5.0)
    yield made
    made.close()


def test_a_file_is_copied_and_the_board_restarts(loader: Loader) -> None:
    loader.appear()
    seen: list[tuple[int, int]] = []
    assert pico.flash(None, FILE, lambda *at: seen.append(at)) == len(FILE)
    assert loader.got == FILE
    assert seen[-1] == (len(FILE), len(FILE))


def test_a_board_with_our_firmware_is_asked_at_1200_baud(
    loader: Loader, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pico, "DRIVE_S", 5.0)
    ours, theirs = os.openpty()
    try:
        board = threading.Thread(target=restart_at_1200, args=(ours, loader))
        board.start()
        pico.flash(os.ttyname(theirs), FILE, quiet)
        board.join()
    finally:
        os.close(ours)
        os.close(theirs)
    assert loader.got == FILE


def restart_at_1200(port: int, loader: Loader) -> None:
    while termios.tcgetattr(port)[5] != termios.B1200:
        time.sleep(0.01)
    loader.appear()


@pytest.mark.usefixtures("loader")
def test_where_no_board_waits_it_is_told_what_to_do() -> None:
    with pytest.raises(FlashError, match="hold BOOTSEL"):
        pico.flash(None, FILE, quiet)
    pico.BY_LABEL.touch()
    with pytest.raises(FlashError, match="udisksctl mount -b"):
        pico.flash(None, FILE, quiet)


@pytest.mark.parametrize(("board", "kind"), [("RP2350", "vfat"), ("RPI-RP2", "ext4")])
def test_what_is_no_picos_drive_is_left_alone(
    loader: Loader, board: str, kind: str
) -> None:
    loader.appear(board, kind, restarts=False)
    with pytest.raises(FlashError, match="no drive RPI-RP2"):
        pico.flash(None, FILE, quiet)
    assert [each.name for each in loader.folder.iterdir()] == [pico.INFO]


def test_two_boards_are_not_mixed_up(loader: Loader, tmp_path: Path) -> None:
    loader.appear(restarts=False)
    other = tmp_path / "other"
    shutil.copytree(loader.folder, other)
    with loader.mounts.open("a") as file:
        file.write(f"/dev/sdc1 {other} vfat rw 0 0\n")
    with pytest.raises(FlashError, match="unplug one"):
        pico.flash(None, FILE, quiet)


def test_a_board_that_does_not_restart_is_reported(
    loader: Loader, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pico, "GONE_S", 0.2)
    loader.appear(restarts=False)
    with pytest.raises(HalfWritten, match="still exists"):
        pico.flash(None, FILE, quiet)


def test_a_full_or_yanked_drive_is_told(
    loader: Loader, monkeypatch: pytest.MonkeyPatch
) -> None:
    loader.appear(restarts=False)
    monkeypatch.setattr(pico, "PIECE", 100)
    steps: list[int] = []

    def yank(done: int, _all: int) -> None:
        steps.append(done)
        if len(steps) == 3:
            monkeypatch.setattr(os, "fsync", failing)

    with pytest.raises(HalfWritten, match=r"can't write .*Input/output error"):
        pico.flash(None, FILE, yank)


def test_a_drive_that_cannot_be_written_leaves_the_board_as_it_was(
    loader: Loader, tmp_path: Path
) -> None:
    loader.appear(restarts=False)
    target = loader.folder / "FIRMWARE.UF2"
    target.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(FlashError, match=r"Too many levels of symbolic links"):
        pico.flash(None, FILE, quiet)
    assert not (tmp_path / "elsewhere").exists()
    target.unlink()
    target.mkdir()
    with pytest.raises(FlashError, match=r"can't write .*Is a directory") as told:
        pico.flash(None, FILE, quiet)
    assert not isinstance(told.value, HalfWritten)


def test_a_port_that_is_not_there_is_told_once() -> None:
    with pytest.raises(FlashError) as told:
        pico.ask_for_loader("/dev/none")
    assert str(told.value) == "can't open /dev/none: No such file or directory"
    with pytest.raises(FlashError) as told, serial_port.opened("/dev/none", 9600):
        pass
    assert str(told.value).endswith("was lost: No such file or directory")


def failing(_file: int) -> None:
    raise OSError(5, os.strerror(5))


# The file itself.


def test_what_is_encoded_is_decoded(tmp_path: Path) -> None:
    path = tmp_path / "pico.uf2"
    path.write_bytes(FILE)
    image = firmware.read(path)
    assert image.board == "pico"
    assert image.binary().startswith(IMAGE)
    assert set(image.binary()[len(IMAGE) :]) <= {0}


# By hand from the format's description: the first block of an image of 300 bytes.
FIRST = (
    bytes.fromhex("5546320a 57515d9e 00200000 00000010 00010000 00000000 02000000")
    + bytes.fromhex("56ff8be4")
    + b"\xaa" * 256
)


def test_the_format_is_the_published_one() -> None:
    made = uf2.encoded(b"\xaa" * 300, 0x1000_0000, FAMILY)
    assert len(made) == 1024
    assert made.startswith(FIRST)
    assert made[508:512] == bytes.fromhex("306fb10a")


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        (FILE[:-1], "truncated"),
        (FILE[512:], "damaged"),
        (FILE[:512] + b"x" + FILE[513:], "damaged"),
        (uf2.encoded(IMAGE, firmware.PICO_AT, uf2.FAMILIES["rp2350"]), "RP2040"),
        (FILE[:16] + bytes(4) + FILE[20:], "damaged"),  # a block of no bytes
        (FILE[:524] + FILE[12:16] + FILE[528:], "damaged"),  # the first one's place
        *(
            (uf2.encoded(image, at, FAMILY), "fits none of its boards")
            for image, at in (
                (IMAGE, 0x2000_0000),
                (IMAGE[:255] + b"x" + IMAGE[256:], firmware.PICO_AT),
                (BOOT2, firmware.PICO_AT),
                (b"\xff" * 512, firmware.PICO_AT),
            )
        ),
    ],
)
def test_a_damaged_or_other_file_is_refused(
    tmp_path: Path, changed: bytes, why: str
) -> None:
    path = tmp_path / "firmware.uf2"
    path.write_bytes(changed)
    with pytest.raises(FlashError, match=why):
        firmware.read(path)
