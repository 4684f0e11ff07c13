# SPDX-License-Identifier: MIT
"""Builds the emulators, and programs for them, once for all test processes."""

from __future__ import annotations

import functools
import hashlib
import os
import re
import subprocess
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from native import locked

ROOT = Path(__file__).resolve().parent.parent
SIM = ROOT / "build" / "sim"
CACHE = ROOT / "build" / "images"


@functools.cache
def emulators() -> Path:
    """Bring the virtual boards up to date and return their folder."""
    SIM.mkdir(parents=True, exist_ok=True)
    with locked(SIM / ".lock"):
        subprocess.run(["make", "-s", "-C", ROOT / "sim"], check=True)
    return SIM


def program(*command: str | Path) -> Path:
    """Run a compiler's command, given without -o, and return the program's path.

    It is cached by a digest of the command, the preprocessed sources and the linker
    scripts. Programs with the same flags share the objects of the same sources.
    """
    words = [str(word) for word in command]
    sources = [word for word in words if word.endswith((".c", ".S"))]
    flags = [word for word in words if word not in sources]
    CACHE.mkdir(parents=True, exist_ok=True)
    with locked(CACHE / ".lock"):
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            objects = list(pool.map(lambda source: compiled(flags, source), sources))
        scripts = [Path(word).read_bytes() for word in words if word.endswith(".ld")]
        return _made(".elf", [*flags, *map(str, objects)], b"".join(scripts))


def linked(command: Sequence[str | Path], inputs: Sequence[Path]) -> Path:
    """Run a linker's command, given without -o, and return the program's path; cached
    by a digest of the command and these files.
    """
    CACHE.mkdir(parents=True, exist_ok=True)
    with locked(CACHE / ".lock"):
        content = b"".join(path.read_bytes() for path in inputs)
        return _made(".elf", [*map(str, command)], content)


def compiled(flags: Sequence[str | Path], source: str | Path) -> Path:
    """Return the object of a source, by a compiler and its flags; cached as above."""
    CACHE.mkdir(parents=True, exist_ok=True)
    text = subprocess.run([*flags, source, "-E"], cwd=ROOT, stdout=-1, check=True)
    words = [*map(str, flags), "-c", str(source)]
    return _made(".o", words, text.stdout, ignored=r"-[DIU]|-Wl,|/")


def _made(
    suffix: str, command: list[str], content: bytes, ignored: str = r"(?!)"
) -> Path:
    """The output of a command for this content; its words of that kind do not
    matter."""
    kept = [word for word in command if not re.match(ignored, word)]
    digest = hashlib.sha256(" ".join(kept).encode() + b"\0" + content)
    made = CACHE / f"{digest.hexdigest()[:16]}{suffix}"
    if not made.exists():
        part = made.with_suffix(f".{os.getpid()}.part")
        subprocess.run([*command, "-o", part], cwd=ROOT, check=True)
        part.rename(made)
    return made
