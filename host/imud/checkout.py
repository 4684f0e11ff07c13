# SPDX-License-Identifier: MIT
"""Whether what was built in a checkout is of the sources that are there now.

`imud._core` and the boards' images carry a digest of the files that they were made of.
Who uses one compares it: on another digest a line says so, and it is built again. An
installed package has no sources beside it, and nothing is compared.

CMake and PlatformIO run this file too: it needs nothing but Python's own modules, and
prints the digest of `imud._core` as a program.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from imud.errors import BuildFailed

ROOT = Path(__file__).resolve().parents[2]

# The sources of each, as patterns of paths relative to the project's folder.
CORE = ("CMakeLists.txt", "host/imud/native/*.[ch]", "firmware/core/**/*.[ch]")
BOARD = (
    "platformio.ini",
    "firmware/*.[ch]",
    *(f"firmware/{room}/**/*.[chS]" for room in ("core", "generic", "avr", "stm32")),
    "firmware/**/*.ld",
    "firmware/boards/*.json",
    "firmware/platforms/**/*.py",
)
PICO = (
    "tools/pico*.py",
    "firmware/*.[ch]",
    "firmware/rp2040/CMakeLists.txt",
    *(f"firmware/{room}/**/*.[ch]" for room in ("core", "generic", "rp2040")),
)
MPY = (
    "tools/mpy.py",
    "tools/pico_sources.py",
    *(f"firmware/{room}/*.[ch]" for room in ("core/*", "generic", "stm32/libc")),
    "firmware/micropython/imuprobe/*.[ch]",
)

# The section of an image that has its digest. It takes no flash.
SECTION = ".sources"
MARK = b"imu-probe sources "

_STARTED_AGAIN = "IMUD_STARTED_AGAIN"
_PLATFORMIO = re.compile(r"\.pio/build/([^/]+)/firmware\.elf$")
_PICO = "build/pico/pico.elf"


def digest(patterns: Iterable[str], root: Path = ROOT) -> str:
    """SHA-256 of the files, with their names; each file counts once."""
    found = {path for pattern in patterns for path in root.glob(pattern)}
    sums = hashlib.sha256()
    for path in sorted(found):
        name = path.relative_to(root).as_posix()
        sums.update(
            f"{name} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode()
        )
    return sums.hexdigest()


def is_checkout() -> bool:
    """Whether this package lies in a folder with the sources of all of it."""
    return (ROOT / "tools" / "setup.py").is_file() and (ROOT / "firmware").is_dir()


def refresh_core() -> None:
    """Has `imud._core` built again if its sources have changed, then starts the program
    that runs now once more. BuildFailed if that is not possible.
    """
    if not is_checkout():
        return
    from imud import _core

    if digest(CORE) == _core.SOURCES:
        return
    if os.environ.get(_STARTED_AGAIN):
        raise BuildFailed("imud._core is out of date; run `make setup`")
    _say("imud._core does not match the sources in firmware/core")
    _build([sys.executable, str(ROOT / "tools" / "setup.py"), "package"], "make setup")
    sys.stdout.flush()
    os.environ[_STARTED_AGAIN] = "1"
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606


def noted(patterns: Iterable[str], root: Path = ROOT) -> bytes:
    """The contents of an image's section SECTION."""
    return MARK + digest(patterns, root).encode()


def note(objcopy: str, image: Path, text: bytes) -> int:
    """Writes that section with the image's own objcopy; returns its exit code."""
    file = image.with_suffix(".sources")
    file.write_bytes(text)
    words = (objcopy, "--remove-section", SECTION, "--add-section", f"{SECTION}={file}")
    return subprocess.run((*words, str(image)), check=False).returncode


def refresh_image(image: Path) -> None:
    """Has an image that lies where its build leaves it built again if its sources have
    changed; leaves all other files alone. BuildFailed if that is not possible.
    """
    path = image.resolve()
    if found := _PLATFORMIO.search(path.as_posix()):
        root, name, patterns = path.parents[3], found[1], BOARD
        command = ["-m", "platformio", "run", "--silent", "--project-dir", str(root)]
        command += ["--environment", name]
        by_hand = f"pio run -e {name}"
    elif path.as_posix().endswith(_PICO):
        root, name, patterns = path.parents[2], "pico", PICO
        command = [str(root / "tools" / "pico.py"), "pico"]
        by_hand = "make firmware BOARD=pico"
    else:
        return
    if not (root / "platformio.ini").is_file():
        return
    wanted = noted(patterns, root)
    if wanted in image.read_bytes():
        return
    (root / "build").mkdir(exist_ok=True)
    with (root / "build" / ".images.lock").open("w") as lock:
        with contextlib.suppress(ImportError):  # only POSIX builds images
            import fcntl

            fcntl.flock(lock, fcntl.LOCK_EX)
        if wanted in image.read_bytes():
            return  # by another process, meanwhile
        _say(f"the image {name} does not match the sources in firmware")
        _build([sys.executable, *command], by_hand)


def _say(what: str) -> None:
    sys.stderr.write(f"{what}: rebuilding\n")
    sys.stderr.flush()


def environment_of(programs: Path) -> dict[str, str]:
    """The environment of tools that lie in the folder of a virtual environment."""
    environment = {
        **os.environ,
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "PLATFORMIO_SETTING_ENABLE_TELEMETRY": "no",
        "PLATFORMIO_DISABLE_UPGRADE_CHECK": "true",
    }
    environment.pop("PLATFORMIO_CORE_DIR", None)  # it would override platformio.ini
    return environment


def _build(command: list[str], by_hand: str) -> None:
    done = subprocess.run(
        command,
        env=environment_of(Path(sys.executable).parent),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        check=False,
    )
    if done.returncode != 0:
        sys.stderr.write(done.stdout)
        raise BuildFailed(f"the build failed; once corrected, run: {by_hand}")


if __name__ == "__main__":
    sys.stdout.write(digest(CORE))
