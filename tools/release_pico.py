# SPDX-License-Identifier: MIT
"""The Pico's images of a release: that in C belongs to the package of firmware, those
with MicroPython are files of their own, with the terms of what is inside beside them.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import Any, Protocol

import notices
from pico_sources import PicoSources

IN_C = "pico"
WITH_MICROPYTHON = ("pico-micropython", "pico2-micropython")
NOTICES = "imu-probe-{version}-pico-micropython-NOTICES.txt"


class Builder(Protocol):
    """What it needs of the release that is built."""

    source: Path
    dist: Path
    version: str

    def run(self, what: str, *words: object) -> None: ...


def build(release: Builder, folder: Path) -> dict[str, Any]:
    """Builds all three. The C image goes into `folder`; its row of the manifest."""
    names = (IN_C, *WITH_MICROPYTHON)
    release.run("the Pico's images", sys.executable, "tools/pico.py", *names)
    made = release.source / "build" / "pico"
    (row,) = json.loads((made / "manifest.json").read_text())["images"]
    shutil.copy(made / f"{IN_C}.uf2", folder)
    elf = folder / f"{IN_C}.elf"
    strip = ("arm-none-eabi-strip", "--strip-debug", "-o", elf)
    release.run(elf.name, *strip, made / f"{IN_C}.elf")
    for name in WITH_MICROPYTHON:
        path = release.dist / f"imu-probe-{release.version}-{name}.uf2"
        shutil.copy(made / f"{name}.uf2", path)
    sources = PicoSources()
    parts = notices.of_micropython(sources.folder, sources.micropython)
    text = notices.text(parts, release.source)
    path = release.dist / NOTICES.format(version=release.version)
    path.write_text(text, "utf-8")
    found: dict[str, Any] = row
    return found
