# SPDX-License-Identifier: MIT
"""What comes from others is what its checksums say, and ours is nobody's HTML."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pytest

from imud.web.files import HERE, KINDS, Files

VENDOR = HERE / "vendor"
SITE = sorted(p for p in (HERE / "site").rglob("*") if p.is_file())


def test_each_vendored_file_has_its_checksum_and_its_licence() -> None:
    lines = (VENDOR / "checksums.txt").read_text().splitlines()
    named = {name: sha for sha, name in (line.split("  ") for line in lines)}
    there = {str(p.relative_to(VENDOR)) for p in VENDOR.rglob("*") if p.is_file()}
    assert there == {*named, "checksums.txt"}
    for name, sha in named.items():
        assert hashlib.sha256((VENDOR / name).read_bytes()).hexdigest() == sha
    for library in ("three", "uplot"):
        assert "MIT" in (VENDOR / library / "LICENSE").read_text()


@pytest.mark.parametrize("path", SITE, ids=lambda path: path.name)
def test_a_file_of_the_page_is_served_typed_and_asks_nobody_else(path: Path) -> None:
    text = path.read_text()
    url = f"/{path.relative_to(HERE / 'site').as_posix()}"
    file = Files().get(url)
    assert file is not None
    assert file.kind == KINDS[path.suffix]
    assert "SPDX-License-Identifier: MIT" in text
    if path.suffix == ".js":
        assert "// @ts-check" in text
        for name in re.findall(r'from "([^"]+)"', text):
            assert name.startswith("."), name
    addresses = re.findall(
        r"(?:https?:)?//[\w.-]+\.\w+", re.sub(r"(?m)^\s*//.*", "", text)
    )
    assert set(addresses) <= {"http://www.w3.org"}


def test_the_page_is_small_enough_to_be_there_at_once() -> None:
    files = Files()
    served = [files.get(url) for url in files.urls]
    assert sum(len(file.packed) for file in served if file is not None) < 500_000
