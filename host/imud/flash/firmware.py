# SPDX-License-Identifier: MIT
"""Firmware images and the manifest's data on each: for which board it is, its filter,
its version, its schema, its size and its SHA-256.

A manifest lies beside its images: that of a release names all of them, that of a build
the one that was built. Its signature is that of the release's key (docs/flash.md).
"""

from __future__ import annotations

import hashlib
import io
import zlib
from collections.abc import Iterator
from pathlib import Path

import intelhex
import msgspec
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

from imud import checkout, packaged
from imud.errors import FlashError
from imud.flash import uf2

MANIFEST = "manifest.json"
SIGNATURE = "manifest.json.sig"  # Ed25519, in hexadecimal digits
KEYS = Path(__file__).with_name("release_keys.txt")
ALL_FILTERS = "all"

SIZE_MAX = 4_000_000  # bytes of a file: 1 MB of flash as text
BOARDS = {
    "nano": "an Arduino Nano",
    "mega": "an Arduino Mega 2560",
    "f405": "an STM32F405",
    "pico": "a Raspberry Pi Pico",
    "micropython": "a board with MicroPython",
}

# Where the images of an ATmega328P, an ATmega2560, an RP2040 and an STM32F405 begin,
# and the bytes that they may have: the end of flash is a bootloader, or settings
# (firmware/rp2040/flash.c: 64 KB of it, firmware/stm32/stm32f405.ld: 256 KB).
NANO_MAX = 0x7E00
MEGA_MAX = 0x3E000
MEGA_VECTORS = 57  # and a Nano has 26
BOOT2 = 252  # bytes before their CRC
PICO_AT, PICO_MAX = 0x1000_0000, (2 << 20) - (64 << 10)
F405_AT, F405_MAX = 0x0800_0000, 768 * 1024
_F405_RAM = (range(0x2000_0000, 0x2002_0001), range(0x1000_0000, 0x1001_0001))


class Firmware(msgspec.Struct, frozen=True, kw_only=True):
    """A row of a manifest."""

    file: str
    board: str
    filter: str  # or ALL_FILTERS
    version: str  # as in a probe's hello
    schema: str  # its fingerprint, eight hexadecimal digits
    sha256: str  # of the file
    bytes: int  # of flash


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    images: tuple[Firmware, ...]


class Image:
    """An image that was read: its bytes by their addresses, and its row of the
    manifest: `about` is None if no manifest names the file.
    """

    def __init__(
        self, path: Path, code: dict[int, int], sha256: str, about: Firmware | None
    ) -> None:
        self.path = path
        self.code = code
        self.sha256 = sha256
        self.about = about

    @property
    def board(self) -> str | None:
        """The board that it fits, by its bytes; None if it fits none of them."""
        low, high = min(self.code), max(self.code)
        if low == 0 and all(map(self._has_jump, range(0, 4 * MEGA_VECTORS, 4))):
            if high < MEGA_MAX:
                return "mega"
        elif low == 0 and high < NANO_MAX:
            if self._has_jump(0):
                return "nano"
        elif low == F405_AT and high < F405_AT + F405_MAX:
            # PM0214, "Vector table": the stack's first address, then the start, odd.
            stack, start = self._number(low, 4), self._number(low + 4, 4)
            is_code = low < start <= high and start % 2 == 1
            if is_code and any(stack in each for each in _F405_RAM):
                return "f405"
        elif low == PICO_AT and high < PICO_AT + PICO_MAX:
            # RP2040 data sheet, 2.8.1.3.1: the boot ROM checks its second stage.
            stage = bytes(self.code.get(low + at, 0xFF) for at in range(BOOT2))
            if _crc32(stage) == self._number(low + BOOT2, 4) and high > low + BOOT2 + 4:
                return "pico"
        return None

    def binary(self) -> bytes:
        """From the first byte to the last; missing bytes between them are 0xFF, as in
        erased flash.
        """
        low, high = min(self.code), max(self.code)
        return bytes(self.code.get(at, 0xFF) for at in range(low, high + 1))

    def _has_jump(self, at: int) -> bool:
        word = self._number(at, 2)  # AVR instruction set manual: RJMP or JMP
        return word >> 12 == 0xC or word & 0xFE0E == 0x940C

    def _number(self, at: int, size: int) -> int:
        found = bytes(self.code.get(at + i, 0xFF) for i in range(size))
        return int.from_bytes(found, "little")


def _crc32(data: bytes) -> int:
    """Of 0x04C11DB7, from all ones, no bits reversed."""
    turned = bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)
    return int(f"{zlib.crc32(turned) ^ 0xFFFFFFFF:032b}"[::-1], 2)


def read(path: Path) -> Image:
    """An image of a file in Intel HEX or UF2, checked against the manifest beside it,
    if there is one. FlashError with what is wrong.
    """
    about = next((each for each in listed(path.parent) if each.file == path.name), None)
    try:
        if path.stat().st_size > SIZE_MAX:
            raise FlashError(f"{path} is too long for an image")
        raw = path.read_bytes()
    except OSError as error:
        raise FlashError(f"can't read {path}: {error.strerror}") from error
    sha256 = hashlib.sha256(raw).hexdigest()
    if about is not None and sha256 != about.sha256:
        raise FlashError(
            f"{path} does not match {path.with_name(MANIFEST)}: its SHA-256 differs; "
            "get both again"
        )
    code = _decoded(path, raw)
    image = Image(path, code, sha256, about)
    if image.board is None:
        raise FlashError(
            f"{path} is not an image of an imu-probe: it fits none of its boards"
        )
    if about is not None and image.board != about.board:
        raise FlashError(f"{path} fits {BOARDS[image.board]}, not {about.board}")
    return image


def _decoded(path: Path, raw: bytes) -> dict[int, int]:
    hint = "give the .hex file of the build"
    if raw[:4] == uf2.MARK:
        return uf2.decoded(path, raw)
    if raw[:1] != b":":
        raise FlashError(f"{path} is not an Intel HEX file; {hint}")
    try:
        text = io.StringIO(raw.decode("ascii"))
        found = intelhex.IntelHex(text)
    except (intelhex.IntelHexError, UnicodeDecodeError) as error:
        raise FlashError(
            f"{path} is a damaged Intel HEX file ({error}); {hint}"
        ) from error
    code: dict[int, int] = found.todict()
    code.pop("start_addr", None)  # type: ignore[call-overload]
    if not code:
        raise FlashError(f"{path} has no bytes; {hint}")
    return code


def ready_made(board: str, wanted: str) -> Path:
    """The file of the image for a board with a filter: of the package with firmware, or
    of this checkout. FlashError with how to get one.
    """
    if checkout.is_checkout():
        return _built(board, wanted)
    folder = packaged.folder_of(packaged.FIRMWARE)
    if folder is None:
        raise FlashError(
            "no firmware is installed: pip install imu-probe-firmware, or name a file: "
            "--image FILE"
        )
    fitting = [each for each in listed(folder) if each.board == board]
    for each in fitting:
        if each.filter in (wanted, ALL_FILTERS):
            return folder / each.file
    filters = ", ".join(each.filter for each in fitting)
    if not fitting:
        raise FlashError(
            f"imu-probe-firmware has no image for {BOARDS.get(board, board)}"
        )
    raise FlashError(f"there is no image with the filter {wanted}, only {filters}")


def offered() -> tuple[Firmware, ...]:
    """All images: of the package with firmware, or those that this checkout has built.
    FlashError if they were modified. Files for MicroPython's prompt are none.
    """
    if checkout.is_checkout():
        built = sorted((checkout.ROOT / ".pio" / "build").glob(f"*/{MANIFEST}"))
        built += [checkout.ROOT / "build" / "pico" / MANIFEST]
        return tuple(each for path in built for each in listed(path.parent))
    folder = packaged.folder_of(packaged.FIRMWARE)
    if folder is None:
        return ()
    is_signed(folder)
    return tuple(row for row in listed(folder) if row.board != "micropython")


def _built(board: str, wanted: str) -> Path:
    if board == "pico":
        path = checkout.ROOT / "build" / "pico" / "pico.uf2"
        if not path.exists():
            raise FlashError(f"{path} is not built: make firmware BOARD=pico")
        checkout.refresh_image(path.with_suffix(".elf"))
        return path
    environment = "stm32f405" if board == "f405" else board
    if board == "nano" and wanted != "fuse":
        environment += f"_{wanted}"
    path = checkout.ROOT / ".pio" / "build" / environment / "firmware.hex"
    if not path.exists():
        raise FlashError(f"{path} is not built: pio run -e {environment}")
    checkout.refresh_image(path.with_suffix(".elf"))
    return path


def listed(folder: Path) -> tuple[Firmware, ...]:
    """The rows of the manifest in a folder; none without one."""
    path = folder / MANIFEST
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        return ()
    except OSError as error:
        raise FlashError(f"can't read {path}: {error.strerror}") from error
    try:
        return msgspec.json.decode(raw, type=Manifest).images
    except msgspec.DecodeError as error:
        raise FlashError(f"{path} is not a firmware manifest: {error}") from error


def is_signed(folder: Path, keys: Path | None = None) -> bool | None:
    """Whether the manifest in a folder is signed by a key that is known; False if it
    has no signature, None if this imud knows no key. FlashError if it is wrong.
    """
    known = [*_keys(KEYS if keys is None else keys)]
    if not known:
        return None
    path = folder / SIGNATURE
    if not path.exists():
        return False
    try:
        signature = bytes.fromhex(path.read_text("ascii"))
    except ValueError as error:
        raise FlashError(f"{path} is not a signature") from error
    manifest = (folder / MANIFEST).read_bytes()
    for key in known:
        try:
            key.verify(signature, manifest)
        except InvalidSignature:
            continue
        return True
    raise FlashError(
        f"{folder / MANIFEST} is not signed by the release's key: it was modified; "
        "get the firmware again"
    )


def _keys(path: Path) -> Iterator[Ed25519PublicKey]:
    """Public keys, one on a line in hexadecimal digits; # begins a comment."""
    for line in path.read_text("ascii").splitlines():
        digits = line.partition("#")[0].strip()
        if digits:
            try:
                yield Ed25519PublicKey.from_public_bytes(bytes.fromhex(digits))
            except ValueError as error:
                raise FlashError(f"{path} has a line that is not a key") from error
