# SPDX-License-Identifier: MIT
"""Builds what a release consists of into build/release/dist, from the last commit:
packages for pip, the firmware, a Debian package, lists of what is inside, checksums.

Built twice, in whatever folder and on whatever day, it gives the same bytes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tarfile
import time
import tomllib
import zipfile
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import debian
import locked
import mpy
import notices
import quietly
import release_key
from needs import PICOS
from pico_sources import PicoSources

from hardware.archive import NAME as PARTS

ROOT = Path(__file__).resolve().parent.parent
PLACE = ROOT / "build" / "release"
REVISION = "revision.txt"  # read by firmware/platforms/build_text.py where no git is

# Environments of platformio.ini, and what their files are called in a release.
IMAGES = {
    "nano": "nano-fuse",
    "mega": "mega",
    "nano_complementary": "nano-complementary",
    "nano_mahony": "nano-mahony",
    "nano_madgwick": "nano-madgwick",
    "nano_dcm_pi": "nano-dcm_pi",
    "stm32f405": "f405",
}
STRIP = {"nano": "avr-strip", "mega": "avr-strip", "f405": "arm-none-eabi-strip"}
SUMS = "SHA256SUMS"
REQUIREMENTS = "requirements.txt"  # read by packages/deb/make.py, too
OURS = ("imu-probe", "imu-probe-firmware", "imu-probe-sim")
EMULATORS = ("nano", "f405")
# Debian's sources of what is inside the emulators.
SOURCES = ("simavr", "unicorn-engine", "elfutils")

# Of the modules of that commit, which need no C.
PACK = """import pathlib, sys; from imud.web import packed
packed.write(pathlib.Path(sys.argv[1]))"""

Sign = Callable[[Path], Path]  # writes a file's signature beside it


class ReleaseError(Exception):
    """It can't be built; the message says why and what to do."""


class Release:
    """One build, in a folder of its own."""

    def __init__(self, place: Path, sign: Sign | None = None) -> None:
        self.place = place
        self._sign = sign
        self.source = place / "source"
        self.dist = place / "dist"
        self.version = version_of(ROOT)
        self.environment = {
            **os.environ,
            "SOURCE_DATE_EPOCH": moment(),
            "TZ": "UTC",
            "LC_ALL": "C.UTF-8",
            "PYTHONHASHSEED": "0",
            "PLATFORMIO_SETTING_ENABLE_TELEMETRY": "no",
            "PLATFORMIO_DISABLE_UPGRADE_CHECK": "true",
        }

    def run(self, what: str, *words: object, cwd: Path | None = None) -> None:
        """One step, whose output is shown if it fails."""
        began_s = time.monotonic()
        done = quietly.run(*words, cwd=cwd or self.source, env=self.environment)
        if done.returncode != 0:
            sys.stderr.write(done.stdout)
            raise ReleaseError(f"{what} failed: {' '.join(map(str, words))}")
        sys.stdout.write(f"{what:<34} {time.monotonic() - began_s:5.1f} s\n")
        sys.stdout.flush()

    def take_source(self) -> None:
        """The last commit without git, and which one it is."""
        shutil.rmtree(self.place, ignore_errors=True)
        self.source.mkdir(parents=True)
        self.dist.mkdir()
        archive = subprocess.run(
            ["git", "-C", str(ROOT), "archive", "HEAD"], check=True, capture_output=True
        )
        subprocess.run(
            ["tar", "x", "-C", str(self.source)], input=archive.stdout, check=True
        )
        revision = _output("git", "-C", str(ROOT), "rev-parse", "--short=7", "HEAD")
        (self.source / REVISION).write_text(f"{revision}\n")

    def build_firmware(self) -> None:
        words = [word for name in IMAGES for word in ("--environment", name)]
        self.run("firmware", "pio", "run", "--silent", *words)
        package = self.source / "packages" / "firmware"
        folder = package / "imu_probe_firmware"
        rows = []
        for environment, name in IMAGES.items():
            built = self.source / ".pio" / "build" / environment
            row = _row(built)
            rows.append(row | {"file": f"{name}.hex"})
            shutil.copy(built / "firmware.hex", folder / f"{name}.hex")
            if (built / "firmware.bin").exists():
                shutil.copy(built / "firmware.bin", folder / f"{name}.bin")
            strip = STRIP[row["board"]]
            self._strip(strip, built / "firmware.elf", folder / f"{name}.elf")
        rows.append(self._build_pico(folder))
        rows += self._build_module(folder)
        text = json.dumps({"images": rows}, indent=2)
        (folder / "manifest.json").write_text(text + "\n")
        if self._sign is not None:
            self._sign(folder / "manifest.json")
        keys = self.source / "host" / "imud" / "flash" / "release_keys.txt"
        release_key.check(folder, keys)
        sources = PicoSources()
        parts = (
            *notices.FIRMWARE,
            *notices.of_pico(sources.folder),
            *notices.of_module(sources.micropython),
        )
        self._name(package, "imu_probe_firmware", parts)
        self._wheel(package, self.dist)

    def _build_pico(self, folder: Path) -> dict[str, Any]:
        """The image in C belongs to the package of firmware; its row of the manifest.
        Those with MicroPython are files of their own, with the terms of what is inside.
        """
        self.run("the Pico's images", sys.executable, "tools/pico.py", *PICOS)
        in_c, *with_micropython = PICOS
        made = self.source / "build" / "pico"
        shutil.copy(made / f"{in_c}.uf2", folder)
        elf = f"{in_c}.elf"
        self._strip("arm-none-eabi-strip", made / elf, folder / elf)
        ours = self.dist / f"imu-probe-{self.version}"
        for name in with_micropython:
            shutil.copy(made / f"{name}.uf2", f"{ours}-{name}.uf2")
        sources = PicoSources()
        parts = notices.of_micropython(sources.folder, sources.micropython)
        path = Path(f"{ours}-pico-micropython-NOTICES.txt")
        path.write_text(notices.text(parts, self.source), "utf-8")
        return _row(made)

    def _build_module(self, folder: Path) -> list[dict[str, Any]]:
        """The module and the package for boards with MicroPython; rows of both."""
        self.run("module for MicroPython", sys.executable, "tools/mpy.py", *mpy.BOARDS)
        made = [
            self.source / mpy.file_of(arch).relative_to(ROOT) for arch in mpy.BOARDS
        ]
        package = self.source / "firmware" / "micropython" / "probe"
        (folder / package.name).mkdir()
        rows = []
        for path in [*made, *sorted(package.glob("*.py"))]:
            is_package = path.parent == package
            name = f"{package.name}/{path.name}" if is_package else path.name
            shutil.copy(path, folder / name)
            rows.append(mpy.row(path, self.source, name, is_package=is_package))
        return rows

    def _strip(self, program: str, image: Path, elf: Path) -> None:
        self.run(elf.name, program, "--strip-debug", "-o", elf, image)

    def build_sim(self, *, with_sources: bool) -> None:
        build = self.place / "sim"
        jobs = f"--jobs={os.cpu_count() or 1}"
        # Without debug information, which has folders in it.
        words = ("-C", "sim", f"BUILD={build}", "CFLAGS=-O2 -flto=auto")
        self.run("emulators", "make", "--silent", jobs, *words)
        package = self.source / "packages" / "sim"
        for name in EMULATORS:
            program = package / "imu_probe_sim" / name
            self.run(f"emulator {name}", "strip", "-o", program, build / name)
        self._name(package, "imu_probe_sim", notices.SIM)
        if with_sources:
            shutil.copytree(self.source / "sim", package / "sources" / "imu-probe")
            self._fetch_sources(package / "sources")
            self.run("sim, sources", *_build("--sdist"), self.dist, cwd=package)
            shutil.rmtree(package / "sources")
        self._wheel(package, self.place / "raw")
        self._repair("imu_probe_sim")

    def _fetch_sources(self, folder: Path) -> None:
        """As Debian has them: what was linked is of its packages."""
        try:
            suite = platform.freedesktop_os_release()["VERSION_CODENAME"]
            apt = debian.apt_get(self.place / "apt", suite, "deb-src")
            debian.output(*apt, "source", "--download-only", *SOURCES, cwd=folder)
        except (OSError, KeyError, debian.NotInstalled) as error:
            raise ReleaseError(
                f"the sources of the emulators are not available: {error}; leave them "
                "out with --without-sources"
            ) from error

    def build_imud(self) -> None:
        self.run("imu-probe, source", *_build("--sdist"), self.dist)
        (sdist,) = self.dist.glob("imu_probe-*.tar.gz")
        raw = self.place / "raw"
        # From the source distribution, so that a build from it is the same.
        with tarfile.open(sdist) as archive:
            archive.extractall(self.place / "unpacked", filter="data")
        (unpacked,) = (self.place / "unpacked").iterdir()
        self.run("imu-probe, wheel", *_build("--wheel"), raw, cwd=unpacked)
        self._repair("imu_probe-")

    def add_parts(self) -> None:
        """The parts to print, if `make hardware` has built those of this commit."""
        built = ROOT / "build" / "hardware" / PARTS
        if built.exists():
            words = (sys.executable, "-m", "hardware.archive", "--check", built)
            self.run("parts to print", *words)
            shutil.copy(built, self.dist / f"{built.stem}-{self.version}.zip")

    def add_library(self) -> None:
        """libimuprobe with its licence, the document and the examples."""
        folder = self.place / "libimuprobe"
        words = ("protocol/generate.py", "--library", folder)
        self.run("libimuprobe", sys.executable, *words, cwd=self.source)
        others = ("LICENSE", "protocol/PROTOCOL.md")
        files = [self.source / name for name in others]
        files += sorted((self.source / "examples" / "libimuprobe").iterdir())
        files += sorted(folder.iterdir())
        self._zip("libimuprobe", files)

    def add_page(self) -> None:
        """The page without a daemon, with the Pico's image and what is inside that."""
        folder = self.place / "page"
        packages = (self.source / "host", self.source / "packages" / "firmware")
        self.run(
            "page without a daemon",
            *("env", f"PYTHONPATH={':'.join(map(str, packages))}", sys.executable),
            *("-c", PACK),
            folder,
        )
        others = ("LICENSE", "packages/firmware/NOTICES.txt")
        files = [self.source / name for name in others]
        self._zip("imu-probe-page", [*files, *sorted(folder.iterdir())])

    def _zip(self, name: str, files: Iterable[Path]) -> None:
        place = self.dist / f"{name}-{self.version}.zip"
        with zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in files:  # at one time, so that each build is the same
                archive.writestr(zipfile.ZipInfo(path.name), path.read_bytes())

    def _name(self, package: Path, module: str, parts: notices.Parts) -> None:
        """The version and the notices of a package beside the main one."""
        path = package / module / "__init__.py"
        text = path.read_text().replace('"0"', f'"{self.version}"')
        path.write_text(text)
        shutil.copy(self.source / "LICENSE", package / "LICENSE")
        (package / "NOTICES.txt").write_text(notices.text(parts, self.source), "utf-8")

    def _wheel(self, package: Path, folder: Path) -> None:
        self.run(f"{package.name}, wheel", *_build("--wheel"), folder, cwd=package)

    def _repair(self, name: str) -> None:
        """Puts the libraries into the wheel that not every Linux has."""
        (wheel,) = (self.place / "raw").glob(f"{name}*.whl")
        words = ("auditwheel", "repair", "--wheel-dir", self.dist, wheel)
        self.run(f"{wheel.name.partition('-')[0]}, repaired", *words)

    def list_contents(self) -> None:
        """Which packages of others are installed with ours (CycloneDX), and sums."""
        room = self.place / "room"
        self.run("room for the list", sys.executable, "-m", "venv", room)
        install = (room / "bin" / "pip", "install", "-q")
        words = ("--require-hashes", "-r", self._write_requirements())
        self.run("packages of others", *install, *words)
        ours = [f"{name}=={self.version}" for name in OURS]
        words = ("--no-deps", "--find-links", self.dist)
        self.run("ours", *install, *words, *ours)
        listed = self.place / "sbom.json"
        self.run(
            "list of what is inside",
            *("cyclonedx-py", "environment", "--output-reproducible", "--of", "JSON"),
            *("-o", listed, room / "bin" / "python"),
        )
        shutil.copy(listed, self.dist / f"imu-probe-{self.version}.cdx.json")
        sums = [f"{_sha256(path)}  {path.name}\n" for path in sorted(self._files())]
        (self.dist / SUMS).write_text("".join(sums))

    def _write_requirements(self) -> Path:
        """Packages of others that imud needs, in the tested versions."""
        project = tomllib.loads((self.source / "pyproject.toml").read_text())
        packages = locked.read((self.source / locked.LOCK.name).read_text())
        lines = locked.lines_for(project["project"]["dependencies"], packages)
        path = self.dist / REQUIREMENTS
        path.write_text("\n".join(lines) + "\n")
        return path

    def _files(self) -> Iterator[Path]:
        return (path for path in self.dist.iterdir() if path.name != SUMS)

    def report(self) -> None:
        for path in sorted(self._files()):
            sys.stdout.write(f"{path.stat().st_size / 1e6:8.2f} MB  {path.name}\n")
        sys.stdout.write(f"in {self.dist}\n")


def _row(built: Path) -> dict[str, Any]:
    """Of the one image in a folder, what its manifest says."""
    manifest = json.loads((built / "manifest.json").read_text())
    (row,) = manifest["images"]
    return dict(row)


def _build(kind: str) -> tuple[str, ...]:
    """The words of a build with the tools that are installed, up to its folder."""
    return (sys.executable, "-m", "build", "--no-isolation", kind, "--outdir")


def moment() -> str:
    """When the last commit was made, in seconds since 1970."""
    return _output("git", "-C", str(ROOT), "log", "-1", "--format=%ct")


def version_of(root: Path) -> str:
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))
    return str(project["project"]["version"])


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _output(*words: str) -> str:
    return subprocess.run(
        words, check=True, capture_output=True, text=True
    ).stdout.strip()


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: python tools/release.py"
    )
    parser.add_argument(
        "--without-sources",
        action="store_true",
        help="leave out the sources of the emulators, which come from Debian's servers",
    )
    parser.add_argument(
        "--signature",
        metavar="FILE",
        type=Path,
        help="of the firmware's manifest, signed on a machine without a network",
    )
    parser.add_argument(
        "--key",
        metavar="FILE",
        type=Path,
        help="signs the firmware's manifest; tools/release_key.py makes one",
    )
    parser.add_argument(
        "--twice",
        action="store_true",
        help="build it again in another folder, and compare",
    )
    args = parser.parse_args()
    sign: Sign | None = None
    if args.signature is not None:
        sign = partial(_copy, args.signature.resolve())
    if args.key is not None:
        passphrase = release_key.asked(f"passphrase of {args.key}: ")
        sign = partial(release_key.sign_file, args.key, passphrase=passphrase)
    try:
        release = build(PLACE, with_sources=not args.without_sources, sign=sign)
        release.report()
        if args.twice:
            other = build(PLACE / "again", with_sources=False, sign=sign)
            compare(release, other)
    except ReleaseError as error:
        sys.stderr.write(f"release: {error}\n")
        return 1
    return 0


def _copy(signature: Path, manifest: Path) -> Path:
    return Path(shutil.copy(signature, f"{manifest}.sig"))


def build(place: Path, *, with_sources: bool, sign: Sign | None = None) -> Release:
    release = Release(place, sign)
    release.take_source()
    release.build_firmware()
    release.build_sim(with_sources=with_sources)
    release.build_imud()
    release.add_parts()
    release.add_library()
    release.add_page()
    release.list_contents()
    return release


def compare(one: Release, other: Release) -> None:
    """ReleaseError if a file that both have differs."""
    known = {path.name: path for path in one.dist.iterdir()}
    both = [path for path in other.dist.iterdir() if path.name in known]
    differing = [
        path.name
        for path in both
        if path.name != SUMS and _sha256(path) != _sha256(known[path.name])
    ]
    if differing:
        raise ReleaseError(f"two builds differ in {', '.join(sorted(differing))}")
    sys.stdout.write(f"the same {len(both)} files twice\n")


if __name__ == "__main__":
    raise SystemExit(main())
