# SPDX-License-Identifier: MIT
"""Builds what runs on a Raspberry Pi Pico, as build/pico/NAME.uf2 with its .elf and
manifest.json: `pico`, the probe in C; `pico-micropython` and `pico2-micropython`,
MicroPython's own port with the probe inside, for Pico and Pico 2; `pico-stock`, that
port with nothing of ours, for tests. Copy it onto the
drive that the board shows when it is plugged in with BOOTSEL held down.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

import debian
import quietly
from needs import STOCK
from pico_sources import PicoSources

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "pico"
# It may run before imud is installed.
sys.path[:0] = [str(ROOT / "host"), str(ROOT / "firmware" / "platforms")]
import described  # noqa: E402

from imud import checkout  # noqa: E402
from imud.flash import uf2  # noqa: E402

C_BOARD = "pico"
FLASH_AT = 0x1000_0000
# MicroPython's names of the boards, and the family of each in UF2.
BOARDS = {
    "pico-micropython": ("RPI_PICO", "rp2040"),
    "pico2-micropython": ("RPI_PICO2", "rp2350"),
}
NAMES = (C_BOARD, *BOARDS, STOCK)
# No C++ is in any of them, so Debian's C++ library of 1.5 GB is not needed: a file of
# the SDK asks for its headers unless it is told not to, and the link for an empty one.
WITHOUT_CXX = "-DPICO_CXX_DISABLE_ALLOCATION_OVERRIDES=1"


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="tools/pico.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="example: tools/pico.py pico-micropython",
    )
    parser.add_argument("name", nargs="+", choices=NAMES)
    names = parser.parse_args().name
    BUILD.mkdir(parents=True, exist_ok=True)
    try:
        sources = PicoSources()
        for name in names:
            build(name, sources)
    except debian.NotInstalled as error:
        sys.exit(f"{names[0]} can't be built: {error}")


def build(name: str, sources: PicoSources) -> None:
    """Makes build/pico/NAME/NAME.uf2."""
    folder = BUILD / name
    if name == C_BOARD:
        made, family = c_image(folder, sources), "rp2040"
    else:
        board, family = BOARDS.get(name, ("RPI_PICO", "rp2040"))
        made = micropython_image(folder, board, sources, is_stock=name == STOCK)
    elf = BUILD / f"{name}.elf"
    shutil.copyfile(made, elf)
    binary = folder / "image.bin"
    run({}, "arm-none-eabi-objcopy", "-O", "binary", elf, binary)
    image = binary.read_bytes()
    path = BUILD / f"{name}.uf2"
    path.write_bytes(uf2.encoded(image, FLASH_AT, uf2.FAMILIES[family]))
    if name == C_BOARD:
        row = described.row(ROOT, path, C_BOARD, "all", len(image))
        described.write_manifest(BUILD, row)
        # Behind all of it: objcopy would fill the file up from flash to RAM.
        with elf.open("ab") as file:
            file.write(checkout.noted(checkout.PICO))


def empty_library() -> Path:
    folder = BUILD / "nothing"
    folder.mkdir(exist_ok=True)
    run({}, "arm-none-eabi-ar", "rc", folder / "libstdc++.a")
    return folder


def c_image(folder: Path, sources: PicoSources) -> Path:
    settings = {
        "PICO_SDK_PATH": sources.sdk,
        "PICO_TINYUSB_PATH": sources.tinyusb,
        "FIRMWARE_BUILD": described.build_text(ROOT),
    }
    configure_and_build(ROOT / "firmware" / "rp2040", folder, settings)
    return folder / "firmware.elf"


def micropython_image(
    folder: Path, board: str, sources: PicoSources, *, is_stock: bool
) -> Path:
    own = ROOT / "firmware" / "micropython"
    run({}, "make", "--silent", "-C", sources.micropython / "mpy-cross", jobs())
    # The port wants a folder of micropython-lib, of which it takes nothing here.
    library = BUILD / "no-library"
    library.mkdir(exist_ok=True)
    (library / "README.md").touch()
    settings = {
        "PICO_BUILD_DOCS": 0,
        "PICO_NO_PICOTOOL": 1,
        "MICROPY_BOARD": board,
        "MICROPY_LIB_DIR": library,
        "MICROPY_FROZEN_MANIFEST": own
        / "pico"
        / ("stock.py" if is_stock else "manifest.py"),
    }
    if not is_stock:
        settings["USER_C_MODULES"] = own / "imuprobe" / "micropython.cmake"
    configure_and_build(sources.micropython / "ports" / "rp2", folder, settings)
    return folder / "firmware.elf"


def configure_and_build(
    source: Path, folder: Path, settings: Mapping[str, object]
) -> None:
    flags = {"CXXFLAGS": WITHOUT_CXX, "LDFLAGS": f"-L{empty_library()}"}
    words = [f"-D{name}={value}" for name, value in settings.items()]
    # The port's own paths are relative to its folder.
    run(flags, "cmake", "-S", ".", "-B", folder, "-G", "Ninja", *words, cwd=source)
    run({}, "ninja", "--quiet", "-C", folder)


def jobs() -> str:
    return f"--jobs={os.cpu_count() or 1}"


def run(more: Mapping[str, str], *words: object, cwd: Path | None = None) -> None:
    """Runs a command; one that fails ends this program with what it printed."""
    done = quietly.run(*words, cwd=cwd, env=os.environ | more)
    if done.returncode:
        sys.stdout.write(done.stdout)
        sys.exit(f"{words[0]} failed")


if __name__ == "__main__":
    main()
