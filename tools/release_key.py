# SPDX-License-Identifier: MIT
"""The key that signs the manifest of firmware: makes one, and signs with it. Meant for
a machine without a network; docs/flash.md describes the ceremony.
"""

from __future__ import annotations

import argparse
import getpass
import os
import sys
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    PrivateFormat,
    load_pem_private_key,
)

from imud.errors import FlashError
from imud.flash import firmware

# Tests sign with it. Anyone can, so no release may know it.
TEST_KEY = Ed25519PrivateKey.from_private_bytes(
    b"no secret, only for the tests".ljust(32)
)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: python tools/release_key.py new key.pem",
    )
    actions = parser.add_subparsers(dest="action", required=True)
    new = actions.add_parser("new", help="create a key, and print its public part")
    new.add_argument("key", type=Path)
    sign = actions.add_parser("sign", help="write FILE.sig")
    sign.add_argument("key", type=Path)
    sign.add_argument("file", type=Path)
    args = parser.parse_args()
    if args.action == "new":
        sys.stdout.write(f"{make(args.key, asked('passphrase for it: '))}\n")
    else:
        sys.stdout.write(f"{sign_file(args.key, args.file, asked('passphrase: '))}\n")
    return 0


def asked(text: str) -> bytes:
    passphrase = getpass.getpass(text).encode()
    if not passphrase:
        raise SystemExit("a key without a passphrase is not secret; enter one")
    return passphrase


def make(path: Path, passphrase: bytes) -> str:
    """Writes a new private key, and returns the line for release_keys.txt."""
    key = Ed25519PrivateKey.generate()
    raw = key.private_bytes(
        Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(passphrase)
    )
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise SystemExit(f"{path} exists; a key is never replaced") from None
    with os.fdopen(descriptor, "wb") as out:
        out.write(raw)
    return key.public_key().public_bytes_raw().hex()


def sign_file(path: Path, file: Path, passphrase: bytes) -> Path:
    """Writes the signature of a file beside it, and returns its path."""
    try:
        key = load_pem_private_key(path.read_bytes(), passphrase)
    except ValueError as error:
        raise SystemExit(f"{path}: wrong passphrase, or not a key") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise SystemExit(f"{path} is not an Ed25519 key")
    signature = file.with_name(f"{file.name}.sig")
    signature.write_text(key.sign(file.read_bytes()).hex() + "\n", "ascii")
    return signature


def check(folder: Path, keys: Path) -> None:
    """SystemExit unless the manifest in a folder is signed by one of those keys, or
    not at all, and none of them is the tests'.
    """
    if TEST_KEY.public_key().public_bytes_raw().hex() in keys.read_text("ascii"):
        raise SystemExit(
            f"{keys} has the key of the tests, which anyone has: remove it"
        )
    if not (folder / firmware.SIGNATURE).exists():
        return
    try:
        is_signed = firmware.is_signed(folder, keys)
    except FlashError as error:
        raise SystemExit(f"the key is none of {keys}: {error}") from error
    if not is_signed:
        raise SystemExit(f"{keys} is empty: add the line of the key, and commit it")


if __name__ == "__main__":
    raise SystemExit(main())
