# SPDX-License-Identifier: MIT
"""Libraries of others match their checksums, and our code writes no HTML."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

from imud.web.files import HERE, KINDS, Files

VENDOR = HERE / "vendor"
SITE = HERE / "site"


def test_each_vendored_file_has_its_checksum_and_its_licence() -> None:
    lines = (VENDOR / "checksums.txt").read_text().splitlines()
    named = {name: sha for sha, name in (line.split("  ") for line in lines)}
    there = {str(p.relative_to(VENDOR)) for p in VENDOR.rglob("*") if p.is_file()}
    assert there == {*named, "checksums.txt"}
    for name, sha in named.items():
        assert hashlib.sha256((VENDOR / name).read_bytes()).hexdigest() == sha
    for library in ("three", "uplot"):
        assert "MIT" in (VENDOR / library / "LICENSE").read_text()


def faults_of(path: Path, files: Files) -> Iterator[str]:
    """The mistakes in a file of the page."""
    text = path.read_text()
    file = files.get(f"/{path.relative_to(SITE).as_posix()}")
    if file is None or file.kind != KINDS[path.suffix]:
        yield "is not served as what it is"
    if "SPDX-License-Identifier: MIT" not in text:
        yield "has no licence"
    if path.suffix == ".js":
        if "// @ts-check" not in text:
            yield "has its types not checked"
        for name in re.findall(r'from "([^"]+)"', text):
            if not name.startswith("."):
                yield f"imports {name}"
    addresses = re.findall(
        r"(?:https?:)?//[\w.-]+\.\w+", re.sub(r"(?m)^\s*//.*", "", text)
    )
    for address in set(addresses) - {"http://www.w3.org"}:
        yield f"names {address}"


def test_a_file_of_the_page_is_served_typed_and_asks_nobody_else() -> None:
    files = Files()
    paths = [path for path in sorted(SITE.rglob("*")) if path.is_file()]
    assert paths
    faults = [
        f"{path.name} {what}" for path in paths for what in faults_of(path, files)
    ]
    assert not faults, "\n".join(faults)


def test_the_page_is_small_enough_to_be_there_at_once() -> None:
    files = Files()
    served = [files.get(url) for url in files.urls]
    assert sum(len(file.packed) for file in served if file is not None) < 500_000
