# SPDX-License-Identifier: MIT
"""MicroPython, and for its rp2 port and our own firmware Raspberry Pi's SDK and what
that needs: as Debian 13 has them, by version and hash, fetched once into the user's
cache."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import tarfile
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import debian

SUITE = "trixie"
FILES = {
    "pico-sdk-source_2.1.1-1_all.deb": (
        "507a3ca37636641bc90239d7c04dc9dc28c5008087a8162102ea94d2273153d3"
    ),
    "tinyusb-source_0.18.0+dfsg-1_all.deb": (
        "01ce2c645df68f14a8a7dcfc8fb355713152543757955820479a87949a61154e"
    ),
    "micropython_1.25.0+ds.orig.tar.xz": (
        "7b25be99a502f070b2de81dafc08da7051d992325d6e67daa9045a918fffdbea"
    ),
    "mbedtls_3.6.6.orig.tar.bz2": (
        "8fb65fae8dcae5840f793c0a334860a411f884cc537ea290ce1c52bb64ca007a"
    ),
}


class MicroPythonSources:
    """The folder of MicroPython; NotInstalled if it can't be had on this machine."""

    name = "micropython-1.25.0"
    packages: tuple[str, ...] = ()
    sources: tuple[str, ...] = ("micropython",)
    links: Mapping[str, str] = MappingProxyType({})

    def __init__(self) -> None:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        self.folder = base / "imu-probe" / self.name
        self.micropython = self.folder / "micropython-1.25.0"
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        with self.folder.with_name(f"{self.name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (self.folder / "whole").exists():
                shutil.rmtree(self.folder, ignore_errors=True)
                self.folder.mkdir()
                self._fetch()
                (self.folder / "whole").touch()

    def _fetch(self) -> None:
        room = self.folder / "packages"
        room.mkdir()
        if self.packages:
            quiet = debian.apt_get(room / "deb", SUITE)
            debian.output(*quiet, "download", *self.packages, cwd=room)
        quiet = debian.apt_get(room / "src", SUITE, "deb-src")
        debian.output(*quiet, "source", "--download-only", *self.sources, cwd=room)
        for name, digest in FILES.items():
            if name.startswith((*self.packages, *self.sources)):
                self._unpack(room / name, digest)
        shutil.rmtree(room)
        for link, folder in self.links.items():
            path = self.micropython / link
            path.rmdir()  # an empty one, as Debian leaves it
            path.symlink_to(self.folder / folder)

    def _unpack(self, file: Path, digest: str) -> None:
        if not file.exists():
            raise debian.NotInstalled(
                f"Debian 13 has a different version of {file.name}"
            )
        if hashlib.sha256(file.read_bytes()).hexdigest() != digest:
            raise debian.NotInstalled(f"{file.name} has a different hash")
        if file.suffix == ".deb":
            debian.output("dpkg-deb", "-x", str(file), str(self.folder))
            return
        # Python's own: a bare system has no xz and no bzip2 for tar.
        with tarfile.open(file) as archive:
            if hasattr(tarfile, "data_filter"):  # Python 3.11.4
                archive.extraction_filter = tarfile.data_filter
            archive.extractall(self.folder)  # noqa: S202, its hash was compared


class PicoSources(MicroPythonSources):
    """All of it."""

    name = "pico-2.1.1-1.25.0"
    packages = ("pico-sdk-source", "tinyusb-source")  # of all processors alike
    sources = ("micropython", "mbedtls")
    # Where MicroPython's tree has them as submodules, and what they are here.
    links: Mapping[str, str] = {
        "lib/mbedtls": "mbedtls-3.6.6",
        "lib/tinyusb": "usr/src/tinyusb",
        "lib/pico-sdk": "usr/src/pico-sdk",
    }

    def __init__(self) -> None:
        super().__init__()
        self.sdk = self.folder / "usr" / "src" / "pico-sdk"
        self.tinyusb = self.folder / "usr" / "src" / "tinyusb"
