# SPDX-License-Identifier: MIT
"""What is known of an image before it is written: its bytes, manifest and signature."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from intelhex import IntelHex

from imud.errors import FlashError
from imud.flash import firmware

NANO = bytes.fromhex("27c10000") + bytes(200)  # RJMP
JUMPS = bytes.fromhex("0c942700") + bytes(200)  # JMP
MEGA = 57 * bytes.fromhex("0c947200") + bytes(200)  # a Nano has 26 vectors
# A stack in the CCM, then the start.
F405 = bytes.fromhex("00200010 41010008") + bytes(0x200)


def hex_file(path: Path, code: bytes, at: int = 0) -> Path:
    found = IntelHex()
    found.puts(at, code)
    found.write_hex_file(str(path))
    return path


def manifest(path: Path, **changes: object) -> None:
    row = {
        "file": path.name,
        "board": "nano",
        "filter": "fuse",
        "version": "0.2.0+1234567",
        "schema": "03b33511",
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "bytes": 204,
    }
    text = json.dumps({"images": [row | changes]})
    path.with_name("manifest.json").write_text(text)


@pytest.mark.parametrize(
    ("code", "at", "board"),
    [
        (NANO, 0, "nano"),
        (JUMPS, 0, "nano"),
        (26 * JUMPS[:4] + bytes(200), 0, "nano"),
        (MEGA, 0, "mega"),
        (MEGA + bytes(0x8000), 0, "mega"),
        (F405, 0x0800_0000, "f405"),
    ],
)
def test_an_image_tells_its_board_by_its_bytes(
    code: bytes, at: int, board: str, tmp_path: Path
) -> None:
    image = firmware.read(hex_file(tmp_path / "a.hex", code, at))
    assert image.board == board
    assert image.about is None
    assert image.binary() == code


@pytest.mark.parametrize(
    ("code", "at"),
    [
        (bytes(200), 0),  # no jump
        (NANO, 0x100),  # not at the start
        (NANO + bytes(0x7E00), 0),  # into the bootloader
        (MEGA + bytes(0x3E000), 0),
        (F405, 0x0801_0000),
        (F405 + bytes(768 * 1024), 0x0800_0000),  # into the settings
        (bytes.fromhex("00200060 41010008") + bytes(512), 0x0800_0000),  # no such RAM
        (bytes.fromhex("00200010 40010008") + bytes(512), 0x0800_0000),  # not Thumb
        (bytes.fromhex("00200010 41010108") + bytes(512), 0x0800_0000),  # starts beyond
    ],
)
def test_what_fits_no_board_is_refused(code: bytes, at: int, tmp_path: Path) -> None:
    with pytest.raises(FlashError, match="fits none of its boards"):
        firmware.read(hex_file(tmp_path / "a.hex", code, at))


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (b"\x7fELF", "not an Intel HEX file; give the .hex file"),
        (b"", "not an Intel HEX file"),
        (b":10000000zz\n", "damaged Intel HEX file"),
        (b":0100000001FD\n:00000001FF\n", "damaged Intel HEX file"),  # its sum is FE
        (b":00000001FF\n", "has no bytes"),
        (b":\xff\xff", "damaged Intel HEX file"),
        (b":" + bytes(5_000_000), "too long"),
    ],
)
def test_what_is_no_image_is_one_line(raw: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.hex"
    path.write_bytes(raw)
    with pytest.raises(FlashError, match=words) as told:
        firmware.read(path)
    assert "\n" not in str(told.value)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(FlashError, match=r"can't read .*No such file"):
        firmware.read(tmp_path / "a.hex")


def test_a_manifest_says_what_it_is_and_holds_it_to_that(tmp_path: Path) -> None:
    path = hex_file(tmp_path / "a.hex", NANO)
    manifest(path)
    about = firmware.read(path).about
    assert (about.filter, about.version) == ("fuse", "0.2.0+1234567")

    manifest(path, board="f405")
    with pytest.raises(FlashError, match="fits an Arduino Nano, not f405"):
        firmware.read(path)
    manifest(path, sha256="0" * 64)
    with pytest.raises(FlashError, match="its SHA-256 differs; get both again"):
        firmware.read(path)
    path.with_name("manifest.json").write_text("{")
    with pytest.raises(FlashError, match="is not a firmware manifest"):
        firmware.read(path)


def raw_key(key: Ed25519PrivateKey) -> str:
    return key.public_key().public_bytes_raw().hex()


def test_a_manifest_is_signed_by_a_known_key_or_refused(tmp_path: Path) -> None:
    path = hex_file(tmp_path / "a.hex", NANO)
    manifest(path)
    ours, theirs = Ed25519PrivateKey.generate(), Ed25519PrivateKey.generate()
    keys = tmp_path / "keys.txt"
    signature = tmp_path / "manifest.json.sig"

    keys.write_text(f"{raw_key(ours)}\n")
    assert firmware.is_signed(tmp_path, keys) is False  # no signature
    signature.write_text(ours.sign((tmp_path / "manifest.json").read_bytes()).hex())
    keys.write_text("# nobody yet\n")
    assert firmware.is_signed(tmp_path, keys) is None  # no key is known
    keys.write_text(f"{raw_key(theirs)}\n{raw_key(ours)}  # ours\n")
    assert firmware.is_signed(tmp_path, keys) is True
    keys.write_text(f"{raw_key(theirs)}\n")
    with pytest.raises(FlashError, match="not signed by the release's key"):
        firmware.is_signed(tmp_path, keys)
    manifest(path, version="9.9.9")  # changed after it was signed
    keys.write_text(f"{raw_key(ours)}\n")
    with pytest.raises(FlashError, match="not signed by the release's key"):
        firmware.is_signed(tmp_path, keys)
    signature.write_text("no digits")
    with pytest.raises(FlashError, match="is not a signature"):
        firmware.is_signed(tmp_path, keys)
    keys.write_text("ab\n")
    with pytest.raises(FlashError, match="has a line that is not a key"):
        firmware.is_signed(tmp_path, keys)


def test_the_package_is_asked_by_board_and_filter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "imu_probe_firmware"
    package.mkdir()
    (package / "__init__.py").touch()
    path = hex_file(package / "nano-fuse.hex", NANO)
    manifest(path)
    monkeypatch.setattr(firmware.checkout, "is_checkout", lambda: False)
    with pytest.raises(FlashError, match="pip install imu-probe-firmware"):
        firmware.ready_made("nano", "fuse")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert firmware.ready_made("nano", "fuse") == path
    with pytest.raises(FlashError, match="no image with the filter mahony, only fuse"):
        firmware.ready_made("nano", "mahony")
    with pytest.raises(FlashError, match="has no image for an STM32F405"):
        firmware.ready_made("f405", "fuse")
    manifest(path, filter="all")
    assert firmware.ready_made("nano", "mahony") == path
