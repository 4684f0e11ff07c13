# SPDX-License-Identifier: MIT
"""Which part of the firmware code is of: by its file, through what was inlined."""

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
        (["messages.c:put"], "messages.c", "messages"),
        (["sampling.c:miss", "sampling.c:__vector_1"], "sampling.c", "sampling"),
        # Arithmetic: in a file of its own, inlined, the compiler's.
        (["quat.c:quat_multiply"], "quat.c", CALLER),
        (["fixed.h:fixed_clamp", "calibrate.c:apply"], "calibrate.c", "calibrate"),
        ([":__udivmodsi4"], "", CALLER),
        (["fixed_mul.o:add_term"], "", CALLER),
        # A header's line in what is said to be the function itself.
        (["fixed.h:apply"], "calibrate.c", "calibrate"),
        # The main filter by its steps; a helper is of the one that calls it.
        (["fuse.c:integrate", "fuse.c:fuse_step"], "fuse.c", "fuse.integrate"),
        (["fuse_level.c:fuse_stage_level"], "fuse_level.c", "fuse.level"),
        (["fuse.c:helper", "fuse.c:fuse_step"], "fuse.c", "fuse.step"),
        (["fuse.c:helper"], "fuse.c", CALLER),
        (["elsewhere.c:who"], "elsewhere.c", REST),
    ],
)
def test_the_innermost_function_that_has_a_part_gives_it(
    places: list[str], home: str, part: str
) -> None:
    assert parts.part_of(chain(*places), home) == part


def build(folder: Path, *options: str) -> Path:
    """A firmware of two files, one of which the compiler inlines into itself."""
    (folder / "fuse.c").write_text(
        "extern volatile unsigned char port;\n"
        "static void integrate(void) { port = 1; port = 2; port = 3; }\n"
        "void fuse_step(void) { port = 9; integrate(); port = 8; }\n"
    )
    (folder / "uart.c").write_text(
        "volatile unsigned char port;\n"
        "void fuse_step(void);\n"
        "int main(void) { for (;;) { fuse_step(); port = port / 7; } }\n"
    )
    image = folder / "image.elf"
    sources = [folder / "fuse.c", folder / "uart.c"]
    subprocess.run(["avr-gcc", *FLAGS, *options, "-o", image, *sources], check=True)
    return image


def test_an_inlined_step_has_its_own_addresses(tmp_path: Path) -> None:
    found = parts.read(build(tmp_path, "-gdwarf-4"))
    size = dict.fromkeys({r.part for r in found}, 0)
    for r in found:
        size[r.part] += r.end - r.start
    # Each store is a load of 2 bytes and an STS of 4.
    assert size["fuse.integrate"] == 18
    assert 12 <= size["fuse.step"] <= 16
    assert size["uart"] > 0
    assert size[CALLER] > 0  # the division
    starts = [r.start for r in found]
    assert starts == sorted(starts)
    assert all(a.end == b.start for a, b in itertools.pairwise(found))


def test_what_is_written_is_what_the_emulator_reads(tmp_path: Path) -> None:
    image = build(tmp_path, "-gdwarf-4")
    parts.write(image, tmp_path / "parts")
    rows = [line.split() for line in (tmp_path / "parts").read_text().splitlines()]
    assert [(int(a, 16), int(b, 16), part) for a, b, part in rows] == parts.read(image)


def test_an_image_without_debug_information_is_refused(tmp_path: Path) -> None:
    with pytest.raises(parts.NoParts, match="debug information"):
        parts.read(build(tmp_path))


def test_every_file_of_the_firmware_has_its_part(root: Path) -> None:
    firmware = root / "firmware"
    others = firmware / "micropython"  # whose images have no parts
    files = [path for path in firmware.rglob("*.[cS]") if others not in path.parents]
    sources = {path.name for path in files}
    unused = {"euler.c"}  # of the host alone
    known = {*parts.FILES, *parts.FILTER_FILES}
    assert sources - unused == known


def test_every_function_that_is_named_is_there(root: Path) -> None:
    folder = root / "firmware" / "core" / "fusion"
    source = "".join((folder / name).read_text() for name in parts.FILTER_FILES)
    assert [name for name in parts.FILTER_FUNCTIONS if f" {name}(" not in source] == []
