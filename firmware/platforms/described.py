# SPDX-License-Identifier: MIT
"""What a built image says of itself: the text in the probe's hello, and the line of
manifest.json next to it, which tells `imud flash` what that file is."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
from pathlib import Path

TEXT_MAX = 16  # bytes of the field `firmware` in hello
SOURCES = ("firmware", "platformio.ini")


def _git(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["git", *arguments],
        cwd=root,
        env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},
        capture_output=True,
        text=True,
        check=False,
    )


def build_text(root: Path) -> str:
    """The version of pyproject.toml, `+`, the git revision, and `-d` where the sources
    differ from it."""
    project = (root / "pyproject.toml").read_text(encoding="utf-8")
    version = re.search(r'^version\s*=\s*"([^"]+)"', project, re.MULTILINE)
    if version is None:
        raise SystemExit('pyproject.toml has no line: version = "..."')
    text = version[1]
    if (told := root / "revision.txt").exists():  # a release's sources, without git
        return f"{text}+{told.read_text('ascii').strip()}"[:TEXT_MAX]
    try:
        revision = _git(root, "rev-parse", "--short=7", "HEAD")
        changes = _git(root, "diff", "--quiet", "HEAD", "--", *SOURCES)
    except FileNotFoundError:  # no git: a source archive
        return text[:TEXT_MAX]
    if revision.returncode != 0:  # not a repository, or nothing committed
        return text[:TEXT_MAX]
    mark = "-d" if changes.returncode == 1 else ""
    return f"{text}+{revision.stdout.strip()}"[: TEXT_MAX - len(mark)] + mark


def row(
    root: Path, image: Path, board: str, chosen: str, size: int
) -> dict[str, object]:
    """What a manifest says of an image: the fields of host/imud/flash/firmware.py.
    `chosen`: its filter, or "all"; `size`: bytes of flash.
    """
    schema = (root / "host/imud/wire/schema.py").read_text(encoding="utf-8")
    fingerprint = re.search(r"^FINGERPRINT = 0x(\w+)", schema, re.MULTILINE)
    return {
        "file": image.name,
        "board": board,
        "filter": chosen,
        "version": build_text(root),
        "schema": fingerprint[1].lower() if fingerprint else "",
        "sha256": hashlib.sha256(image.read_bytes()).hexdigest(),
        "bytes": size,
    }


def write_manifest(folder: Path, *rows: dict[str, object]) -> None:
    """Writes manifest.json of the images of a folder."""
    manifest = json.dumps({"images": rows}, indent=2)
    (folder / "manifest.json").write_text(manifest + "\n", encoding="utf-8")
