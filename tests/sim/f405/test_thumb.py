# SPDX-License-Identifier: MIT
"""The instructions that the virtual STM32F405 runs itself, compared with libunicorn."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

import images
import native
from length import choose
from programs import ran

ROOT = Path(__file__).resolve().parents[3]
SIM = ROOT / "sim"
BUILT = ROOT / "build" / "sim" / "objects"
FLAGS = ("-std=gnu11", "-O1", *native.WARNINGS, f"-I{SIM}")
MACHINE = [SIM / "f405" / room for room in ("", "core", "peripherals")]
CORE = SIM / "f405" / "core"
# Files of sim/f405 that read an image; the comparison needs none.
ELSEWHERE = ("image", "follow")


@pytest.fixture(scope="module", autouse=True)
def parts() -> None:
    images.emulators()


def twin(thumb: Path | None = None) -> Path:
    """Build the comparison with libunicorn, of the tree or of the files in `thumb`."""
    parts = [path for room in (*MACHINE, SIM / "chips") for path in room.glob("*.c")]
    parts += [*(SIM / "chips").glob("*/*.c"), SIM / "run" / "line.c"]
    objects = [
        (BUILT / path.relative_to(SIM)).with_suffix(".o")
        for path in sorted(parts)
        if path.stem not in ELSEWHERE
        and (thumb is None or not path.stem.startswith("thumb"))
    ]
    sources = [Path(__file__).with_name("thumb_twin.c")]
    if thumb is not None:
        sources += sorted(thumb.glob("*.c"))
    command: list[str | Path] = ["gcc", *FLAGS]
    command += [*sources, *objects, "-l:libunicorn.a", "-lpthread", "-lm"]
    if thumb is None:
        headers = [path for room in MACHINE for path in room.glob("*.h")]
        return images.linked(command, [*sources, *objects, *headers])
    program = thumb / "twin"
    subprocess.run([*command, "-o", program], check=True)
    return program


def compare(program: Path, seed: int, cases: int) -> subprocess.CompletedProcess[str]:
    return ran(program, str(seed), str(cases))


@pytest.mark.long
@pytest.mark.parametrize("seed", choose(everyday=[1], long=[1, 2, 3]))
def test_each_instruction_leaves_behind_what_libunicorns_does(seed: int) -> None:
    cases = choose(everyday=6_000, long=100_000)
    done = compare(twin(), seed, cases)
    assert done.returncode == 0, done.stdout
    run = [int(count) for count in re.findall(r"run (\d+)", done.stdout)]
    # The others are undefined, would fault, or access what is not memory.
    assert len(run) == 2
    assert run[0] > 90_000
    assert run[1] > 0.25 * cases


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("what", "instead"),
    [
        ("x->c = (sum >> 32) != 0;", "x->c = (result >> 31) != 0;"),
        ("((a ^ result) & (b ^ result))", "((a ^ result) & (a ^ b))"),
        ("*carry = (value & 1) != 0;\n        return (value >> 1)",
         "return (value >> 1)"),
        ("is_true = x->n == x->v;\n        break;\n    case 6:",
         "is_true = x->n != x->v;\n        break;\n    case 6:"),
        ("const uint32_t i1 = (field(b, 13, 1) ^ s) ^ 1;",
         "const uint32_t i1 = field(b, 13, 1) ^ s;"),
        ("value = rotate(0x80 | (coded & 0x7F)", "value = rotate(coded & 0x7F"),
        ("result = base + signed_product;", "result = base + product;"),
        (": field(b, 12, 4) << 1 | top;", ": field(b, 12, 4) | top << 4;"),
    ],
)  # fmt: skip
def test_an_instruction_gone_wrong_is_found(
    tmp_path: Path, what: str, instead: str
) -> None:
    changed = 0
    for path in CORE.glob("thumb*.[ch]"):
        text = path.read_text()
        changed += text.count(what)
        (tmp_path / path.name).write_text(text.replace(what, instead))
    assert changed == 1
    done = compare(twin(tmp_path), 1, 100_000)
    assert done.returncode == 1
    assert done.stdout.startswith(("code ", "short: "))
