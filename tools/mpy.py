# SPDX-License-Identifier: MIT
"""Builds the module imuprobe as build/mpy/imuprobe-ARCH.mpy: a file that MicroPython
1.23 or later imports from its file system, on any board with that processor.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import debian
import quietly
from pico_sources import MicroPythonSources

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "mpy"
# It may run before imud is installed.
sys.path[:0] = [str(ROOT / "host"), str(ROOT / "firmware" / "platforms")]
import described  # noqa: E402

from imud import checkout  # noqa: E402

FIRMWARE = ROOT / "firmware"
GLUE = FIRMWARE / "micropython" / "imuprobe"
KIND = "micropython"  # in a manifest


class Processor(NamedTuple):
    """How C is compiled for it. `floats`: MicroPython's word for its own."""

    tools: str
    flags: tuple[str, ...]
    floats: str


ARM = "arm-none-eabi-"
# By MicroPython's names (tools/mpy_ld.py there). An exception's registers have the room
# that a processor with floats fills, as that one loads code for ARMv6-M, too. An
# ESP32-C3 has no atomic instructions, so no `a` in rv32imc.
PROCESSORS = {
    "armv6m": Processor(ARM, ("-mthumb", "-mcpu=cortex-m0", "-U__SOFTFP__"), "NONE"),
    "armv7emsp": Processor(
        ARM,
        ("-mthumb", "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"),
        "FLOAT",
    ),
    "rv32imc": Processor(
        "riscv64-unknown-elf-",
        ("-march=rv32imc", "-mabi=ilp32", "-mno-relax", "--specs=picolibc.specs"),
        "NONE",
    ),
    "x64": Processor("", ("-fno-stack-protector",), "DOUBLE"),
}
BOARDS = [arch for arch in PROCESSORS if arch != "x64"]  # the host's is for tests
FLAGS = (
    *("-std=gnu11", "-Os", "-Wall", "-Wextra", "-Werror", "-fpic", "-fno-common"),
    *("-ffunction-sections", "-fdata-sections", "-U_FORTIFY_SOURCE"),
    *("-DNDEBUG", "-DNO_QSTR", "-DMICROPY_ENABLE_DYNRUNTIME", "-DIMUPROBE_MPY"),
)
# What only a board without MicroPython calls is left out by --gc-sections.
# Compiled for speed: 2.5 kB more, and 8 % of the instructions less.
FAST = ("math", "wire", "probe")
LINK = ("-r", "-nostdlib", "-Wl,--gc-sections,-e,mpy_init")


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="tools/mpy.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="example: tools/mpy.py armv6m",
    )
    parser.add_argument("arch", nargs="*", help=f"of {', '.join(PROCESSORS)}, or all")
    parser.add_argument(
        "--if-possible",
        action="store_true",
        help="succeed without a file where MicroPython's sources can't be had",
    )
    args = parser.parse_args()
    names = args.arch or [*PROCESSORS]
    if unknown := set(names) - set(PROCESSORS):
        parser.error(f"{unknown.pop()} is none of {', '.join(PROCESSORS)}")
    try:
        sources = MicroPythonSources()
    except debian.NotInstalled as error:
        why = f"imuprobe.mpy can't be built: {error}"
        sys.exit(None if args.if_possible else why)
    BUILD.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda name: build(name, sources.micropython), names))
    made = [path for arch in PROCESSORS if (path := file_of(arch)).exists()]
    described.write_manifest(BUILD, *(row(path, ROOT) for path in made))


def file_of(arch: str) -> Path:
    return BUILD / f"imuprobe-{arch}.mpy"


def row(
    path: Path, root: Path, name: str = "", *, is_package: bool = False
) -> dict[str, object]:
    """Of a file in a manifest, by the name that it has there."""
    chosen = "all" if is_package else path.stem.removeprefix("imuprobe-")
    about = described.row(root, path, KIND, chosen, path.stat().st_size)
    return about | {"file": name or path.name}


def build(arch: str, tree: Path) -> None:
    """Build the file of a processor, if its sources are others than they were."""
    stamp = BUILD / f"{arch}.sources"
    wanted = checkout.digest(checkout.MPY)
    if file_of(arch).exists() and stamp.exists() and stamp.read_text() == wanted:
        return
    tools, flags, floats = PROCESSORS[arch]
    linker = (sys.executable, tree / "tools" / "mpy_ld.py", "--arch", arch)
    glue = sorted(GLUE.glob("*.[ch]"))
    core = sorted(FIRMWARE.glob("core/*/*.c"))
    core.append(FIRMWARE / "generic" / "identity.c")
    with tempfile.TemporaryDirectory(dir=BUILD) as folder:
        room = Path(folder)
        # Relative to there: the linker writes its file's name into it.
        run(room, *linker, "--preprocess", "-o", "names.h", *glue)
        words = (*flags, *FLAGS, f"-I{FIRMWARE}", "-isystem", tree, "-I.")
        words += (f"-DMICROPY_FLOAT_IMPL=MICROPY_FLOAT_IMPL_{floats}",)
        words += ("-DMP_CONFIGFILE=<names.h>",)
        files = [*core, *(path for path in glue if path.suffix == ".c")]
        quick = [path for path in files if path.parent.name in FAST]
        run(room, f"{tools}gcc", *words, "-O2", "-c", *quick)
        rest = [path for path in files if path not in quick]
        run(room, f"{tools}gcc", *words, "-c", *rest)
        machine = [flag for flag in flags if flag.startswith("-m")]
        objects = sorted(path.name for path in room.glob("*.o"))
        run(room, f"{tools}gcc", *machine, *LINK, *objects, "-lgcc", "-o", "whole")
        run(room, *linker, "--qstrs", "names.h", "-o", "imuprobe.mpy", "whole")
        shutil.move(room / "imuprobe.mpy", file_of(arch))
    stamp.write_text(wanted)


def run(room: Path, *words: object) -> None:
    done = quietly.run(*words, cwd=room)
    if done.returncode:
        sys.exit(f"{done.stdout}\n{words[0]} failed")


if __name__ == "__main__":
    main()
