# SPDX-License-Identifier: MIT
"""Works of others inside each package or image, and their terms: the text
of NOTICES.txt, from the licences where they lie.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

DOC = Path("/usr/share/doc")  # of Debian's packages


class Part(NamedTuple):
    """Something of others, whose terms are in a file: absolute, or of the sources."""

    name: str
    where: str
    terms: Path


Parts = Sequence[Part]

VENDOR = Path("host/imud/web/vendor")
IMUD: Parts = (
    Part("three.js", "the page", VENDOR / "three" / "LICENSE"),
    Part("uPlot", "the page", VENDOR / "uplot" / "LICENSE"),
)
# Parts of their libraries are linked into the images.
FIRMWARE: Parts = (
    Part("avr-libc", "images of the Nano", DOC / "avr-libc" / "copyright"),
    Part("libgcc", "images of the Nano", DOC / "gcc-avr" / "copyright"),
    Part("libgcc", "images of the F405", DOC / "gcc-arm-none-eabi" / "copyright"),
)
SIM: Parts = (
    Part("simavr", "nano", DOC / "libsimavr-dev" / "copyright"),
    Part("unicorn", "f405", DOC / "libunicorn-dev" / "copyright"),
    Part("libelf", "both", DOC / "libelf-dev" / "copyright"),
    Part("zlib", "both, by libelf", DOC / "zlib1g" / "copyright"),
)


def of_pico(sources: Path) -> Parts:
    """What is inside the Pico's images. `sources`: the folder of pico_sources.py."""
    doc, where = sources / "usr" / "share" / "doc", "images of the Pico"
    return (
        Part("pico-sdk", where, doc / "pico-sdk-source" / "copyright"),
        Part("TinyUSB", where, doc / "tinyusb-source" / "copyright"),
        Part("newlib", where, DOC / "libnewlib-dev" / "copyright"),
        Part("libgcc", where, DOC / "gcc-arm-none-eabi" / "copyright"),
    )


def of_module(tree: Path) -> Parts:
    """What is inside the module imuprobe. `tree`: that of MicroPython."""
    where = "files for MicroPython"
    return (
        Part("MicroPython", where, tree / "LICENSE"),
        Part("libgcc", where, DOC / "gcc-riscv64-unknown-elf" / "copyright"),
    )


def of_micropython(sources: Path, tree: Path) -> Parts:
    """What is inside its images for the Pico. `tree`: that of MicroPython."""
    where, lib = "images with MicroPython", tree / "lib"
    return (
        Part("MicroPython", where, tree / "LICENSE"),
        Part("littlefs (BSD-3-Clause)", where, lib / "littlefs" / "lfs2.h"),
        Part("FatFs", where, lib / "oofatfs" / "ff.h"),
        Part("uzlib", where, lib / "uzlib" / "uzlib.h"),
        Part("re1.5 (BSD-3-Clause)", where, lib / "re1.5" / "re1.5.h"),
        Part("FreeBSD's and musl's libm", where, lib / "libm" / "libm.h"),
        Part("Mbed TLS", where, lib / "mbedtls" / "LICENSE"),
        *of_pico(sources),
    )


def text(parts: Parts, source: Path) -> str:
    """The notices; FileNotFoundError if the terms of a part are missing."""
    head = "Works of others inside, and their terms:\n\n"
    head += "".join(f"  {part.name} ({part.where})\n" for part in parts)
    pieces = [
        f"{'=' * 78}\n{part.name} ({part.where})\n{'=' * 78}\n\n{_terms(part, source)}"
        for part in parts
    ]
    return "\n\n".join([head.rstrip(), *pieces]) + "\n"


def _terms(part: Part, source: Path) -> str:
    path = part.terms if part.terms.is_absolute() else source / part.terms
    text = path.read_text("utf-8").strip()
    if path.suffix in (".c", ".h"):  # they are the comment at its beginning
        text = re.split(r"^\s*#", text, maxsplit=1, flags=re.MULTILINE)[0].strip()
    return text
