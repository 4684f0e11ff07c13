# SPDX-License-Identifier: MIT
"""Builds the emulators, and programs for them, once for all test processes."""

from __future__ import annotations

import functools
import hashlib
import subprocess
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

    The result is cached by a digest of the command, the preprocessed text and the
    linker scripts.
    """
    digest = hashlib.sha256(" ".join(map(str, command)).encode())
    digest.update(
        subprocess.run([*command, "-E"], cwd=ROOT, stdout=-1, check=True).stdout
    )
    for word in command:
        if str(word).endswith(".ld"):
            digest.update(Path(word).read_bytes())
    made = CACHE / f"{digest.hexdigest()[:16]}.elf"
    CACHE.mkdir(parents=True, exist_ok=True)
    with locked(CACHE / ".lock"):
        if not made.exists():
            part = made.with_suffix(".part")
            subprocess.run([*command, "-o", part], cwd=ROOT, check=True)
            part.rename(made)
    return made
