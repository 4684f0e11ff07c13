# SPDX-License-Identifier: MIT
"""Gives main.c FIRMWARE_BUILD, the text that the probe's hello carries: the version
of pyproject.toml, `+`, the git revision, and `-d` where the sources differ from it.
Only main.c is compiled with it, so that a commit rebuilds one file.

Writes manifest.json beside the .hex, by which `imud flash` knows what that file is.

Gives the .elf a section with the digest of its sources, which takes no flash: who runs
it can tell whether they have changed since (host/imud/checkout.py)."""

import hashlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

BOARDS = {"imu_nano": "nano", "imu_f405": "f405"}
TEXT_MAX = 16  # bytes of the field `firmware` in hello

Import("env")  # type: ignore[name-defined]  # noqa: F821  SCons puts it there
env: Any = globals()["env"]
root = Path(env.subst("$PROJECT_DIR"))
sys.path.insert(0, str(root / "host"))
from imud import checkout  # noqa: E402 - of the project's folder, found only now


def git(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["git", *arguments],
        cwd=root,
        env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},
        capture_output=True,
        text=True,
        check=False,
    )


def build_text() -> str:
    project = (root / "pyproject.toml").read_text(encoding="utf-8")
    version = re.search(r'^version\s*=\s*"([^"]+)"', project, re.MULTILINE)
    if version is None:
        raise SystemExit('pyproject.toml has no line: version = "..."')
    text = version[1]
    if (told := root / "revision.txt").exists():  # a release's sources, without git
        return f"{text}+{told.read_text('ascii').strip()}"[:TEXT_MAX]
    try:
        revision = git("rev-parse", "--short=7", "HEAD")
        changes = git("diff", "--quiet", "HEAD", "--", "firmware", "platformio.ini")
    except FileNotFoundError:  # no git: a source archive
        return text[:TEXT_MAX]
    if revision.returncode != 0:  # not a repository, or nothing committed
        return text[:TEXT_MAX]
    mark = "-d" if changes.returncode == 1 else ""
    return f"{text}+{revision.stdout.strip()}"[: TEXT_MAX - len(mark)] + mark


def with_build_text(middleware_env: Any, node: Any) -> Any:
    return middleware_env.Object(
        node,
        CPPDEFINES=[
            *middleware_env["CPPDEFINES"],
            ("FIRMWARE_BUILD", middleware_env.StringifyMacro(build_text())),
        ],
    )


def add_sources(target: Any, source: Any, env: Any) -> int:  # noqa: ARG001, SCons's
    """Put the digest of the sources into a linked image."""
    (elf,) = map(str, target)
    return checkout.note(env.subst("$OBJCOPY"), Path(elf), sources)


def write_manifest(target: Any, source: Any, env: Any) -> None:  # noqa: ARG001, SCons's
    """Say beside a .hex what it is: the fields of host/imud/flash/firmware.py."""
    path = Path(str(target[0]))
    raw = path.read_bytes()
    schema = (root / "host/imud/wire/schema.py").read_text(encoding="utf-8")
    fingerprint = re.search(r"^FINGERPRINT = 0x(\w+)", schema, re.MULTILINE)
    records = raw.decode("ascii").splitlines()
    row = {
        "file": path.name,
        "board": BOARDS[env["BOARD"]],
        "filter": dict(filter(is_pair, env["CPPDEFINES"])).get("ATTITUDE_ONLY", "all"),
        "version": build_text(),
        "schema": fingerprint[1].lower() if fingerprint else "",
        "sha256": hashlib.sha256(raw).hexdigest(),
        # Intel HEX: the length of each record of data.
        "bytes": sum(int(line[1:3], 16) for line in records if line[7:9] == "00"),
    }
    manifest = json.dumps({"images": [row]}, indent=2)
    path.with_name("manifest.json").write_text(manifest + "\n", encoding="utf-8")


def is_pair(define: Any) -> bool:
    return isinstance(define, tuple | list) and len(define) == 2


sources = checkout.noted(checkout.BOARD, root)
image = "$BUILD_DIR/${PROGNAME}.elf"
env.AddBuildMiddleware(with_build_text, "*main.c")
env.AddPostAction(image, add_sources)
env.Depends(image, env.Value(sources))
env.AddPostAction("$BUILD_DIR/${PROGNAME}.hex", write_manifest)
