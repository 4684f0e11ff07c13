# SPDX-License-Identifier: MIT
"""The key of a release, from the ceremony to `imud flash`."""

from __future__ import annotations

from pathlib import Path

import pytest
import release_key

from imud.errors import FlashError
from imud.flash import firmware


def test_what_it_signs_is_known_by_what_it_prints(tmp_path: Path) -> None:
    key, manifest = tmp_path / "key.pem", tmp_path / "manifest.json"
    manifest.write_text('{"images": []}')
    keys = tmp_path / "release_keys.txt"
    keys.write_text(release_key.make(key, b"only a test") + "\n")
    signature = release_key.sign_file(key, manifest, b"only a test")
    assert signature.name == firmware.SIGNATURE
    assert firmware.is_signed(tmp_path, keys) is True
    manifest.write_text('{"images": [] }')
    with pytest.raises(FlashError, match="not signed by the release's key"):
        firmware.is_signed(tmp_path, keys)


def test_a_key_is_kept_from_others_and_never_replaced(tmp_path: Path) -> None:
    key = tmp_path / "key.pem"
    release_key.make(key, b"only a test")
    assert key.stat().st_mode & 0o077 == 0
    assert b"ENCRYPTED" in key.read_bytes()
    with pytest.raises(SystemExit, match="a key is never replaced"):
        release_key.make(key, b"another")
    with pytest.raises(SystemExit, match="wrong passphrase, or not a key"):
        release_key.sign_file(key, key, b"another")


def test_a_release_refuses_the_key_of_the_tests(tmp_path: Path) -> None:
    manifest, keys = tmp_path / "manifest.json", tmp_path / "release_keys.txt"
    manifest.write_text('{"images": []}')
    keys.write_text("# none\n")
    release_key.check(tmp_path, keys)
    (tmp_path / firmware.SIGNATURE).write_text(
        release_key.TEST_KEY.sign(manifest.read_bytes()).hex()
    )
    with pytest.raises(SystemExit, match="is empty: add the line of the key"):
        release_key.check(tmp_path, keys)
    own = release_key.make(tmp_path / "key.pem", b"only a test")
    keys.write_text(f"{own}\n")
    with pytest.raises(SystemExit, match="the key is none of"):
        release_key.check(tmp_path, keys)
    public = release_key.TEST_KEY.public_key().public_bytes_raw().hex()
    keys.write_text(f"{own}\n{public}  # slipped in\n")
    with pytest.raises(SystemExit, match="has the key of the tests"):
        release_key.check(tmp_path, keys)
    keys.write_text(f"{own}\n")
    release_key.sign_file(tmp_path / "key.pem", manifest, b"only a test")
    release_key.check(tmp_path, keys)
