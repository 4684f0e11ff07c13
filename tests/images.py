# SPDX-License-Identifier: MIT
"""The emulators, up to date, and programs for them, compiled once for each content:
tests in several processes share what one of them has built.
"""

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
    """The folder of the virtual boards, built where they are not up to date."""
    SIM.mkdir(parents=True, exist_ok=True)
    with locked(SIM / ".lock"):
        subprocess.run(["make", "-s", "-C", ROOT / "sim"], check=True)
    return SIM


def program(*command: str | Path) -> Path:
    """What a compiler's command, without its -o, makes of C and a linker's script.

    Known by what the preprocessor makes of the files.
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
