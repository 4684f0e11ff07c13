# SPDX-License-Identifier: MIT
"""Each address of an image has the part whose source it comes from."""

from __future__ import annotations

import itertools
import subprocess
from pathlib import Path

import pytest

from benchmarks.firmware import parts
from benchmarks.firmware.parts import CALLER, REST, Place

FLAGS = ("-std=gnu11", "-mmcu=atmega328p", "-Os")


def chain(*places: str) -> list[Place]:
    """Places as `file:function`, inside out."""
    pairs = [place.rpartition(":") for place in places]
    return [Place(function, file) for file, _, function in pairs]


@pytest.mark.parametrize(
    ("places", "home", "part"),
    [
        (["core/wire/messages.c:put"], "core/wire/messages.c", "wire"),
        (["avr/sampling.c:__vector_1"], "avr/sampling.c", "interrupts"),
        (["handlers.o:clock_us"], "", "interrupts"),
        # Arithmetic: in a file of its own, inlined, the compiler's.
        (["core/math/quat.c:quat_multiply"], "core/math/quat.c", CALLER),
        (["fixed.h:clamp", "fusion/pose.c:apply"], "fusion/pose.c", "fusion"),
        ([":__udivmodsi4"], "", CALLER),
        (["fixed_mul.o:add_term"], "", CALLER),
        # A header's line in what is said to be the function itself.
        (["math/fixed.h:apply"], "core/fusion/calibrate.c", "fusion"),
        (["elsewhere/it.c:who"], "elsewhere/it.c", REST),
    ],
)
def test_the_innermost_function_that_has_a_part_gives_it(
    places: list[str], home: str, part: str
) -> None:
    assert parts.part_of(chain(*places), home) == part


def build(folder: Path, *options: str) -> Path:
    """A firmware of two files, one of which is the compiler's arithmetic, too."""
    sources = [folder / "fusion" / "fuse.c", folder / "avr" / "uart.c"]
    for source in sources:
        source.parent.mkdir()
    sources[0].write_text(
        "extern volatile unsigned char port;\n"
        "static void integrate(void) { port = 1; port = 2; port = 3; }\n"
        "void fuse_step(void) { port = 9; integrate(); port = 8; }\n"
    )
    sources[1].write_text(
        "volatile unsigned char port;\n"
        "void fuse_step(void);\n"
        "int main(void) { for (;;) { fuse_step(); port = port / 7; } }\n"
    )
    image = folder / "image.elf"
    subprocess.run(["avr-gcc", *FLAGS, *options, "-o", image, *sources], check=True)
    return image


def test_each_file_has_its_addresses(tmp_path: Path) -> None:
    image = build(tmp_path, "-gdwarf-4")
    found = parts.read(image)
    size = dict.fromkeys({r.part for r in found}, 0)
    for r in found:
        size[r.part] += r.end - r.start
    # Each of five stores is a load of 2 bytes and an STS of 4; and a return.
    assert size["fusion"] == 32
    assert size["avr"] > 0
    assert size[CALLER] > 0  # the division
    assert all(a.end == b.start for a, b in itertools.pairwise(found))
    parts.write(image, tmp_path / "parts")
    rows = [line.split() for line in (tmp_path / "parts").read_text().splitlines()]
    assert [(int(a, 16), int(b, 16), part) for a, b, part in rows] == found


def test_an_image_without_debug_information_is_refused(tmp_path: Path) -> None:
    with pytest.raises(parts.NoParts, match="debug information"):
        parts.read(build(tmp_path))


def test_every_folder_of_the_firmware_is_a_part(root: Path) -> None:
    firmware = root / "firmware"
    others = firmware / "micropython"  # whose images have no parts
    folders = {
        path.parent.name for path in firmware.rglob("*.c") if others not in path.parents
    }
    assert folders - {parts.ARITHMETIC} <= parts.FOLDERS
