# SPDX-License-Identifier: MIT
"""Installs what one of make's commands needs and is not there, then builds.

Runs under the system's Python with its standard library alone.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
BUILD = ROOT / "build"
LOG = BUILD / "setup.log"
LEAST_PYTHON = (3, 11)

# Dependency groups of pyproject.toml that a command needs beside the package's own.
GROUPS = {
    "demo": ("build", "firmware"),
    "test": ("build", "firmware", "test"),
    "check": ("build", "firmware", "test", "check"),
    "coverage": ("build", "firmware", "test", "coverage"),
    "bench": ("build", "firmware", "test", "bench"),
}


class Need(NamedTuple):
    """A package of the system, and how to see that what it brings is there."""

    package: str
    is_met: Callable[[], bool]


def has(program: str) -> Callable[[], bool]:
    # Those for administrators are not on everybody's path.
    path = os.pathsep.join((os.environ.get("PATH", os.defpath), "/usr/sbin", "/sbin"))
    return lambda: shutil.which(program, path=path) is not None


def compiles(line: str, *compiler: str) -> Callable[[], bool]:
    def probe() -> bool:
        if shutil.which(compiler[0]) is None:
            return False
        done = subprocess.run(
            [*compiler, "-E", "-xc", "-", "-o", os.devnull],
            input=line + "\n",
            text=True,
            capture_output=True,
            check=False,
        )
        return done.returncode == 0

    return probe


def succeeds(*command: str) -> bool:
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def has_modules(*names: str) -> Callable[[], bool]:
    return lambda: succeeds(sys.executable, "-c", f"import {', '.join(names)}")


def has_python_headers() -> bool:
    return Path(sysconfig.get_path("include"), "Python.h").is_file()


PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"
AVR = ("avr-gcc", "-mmcu=atmega328p")
BUILD_NEEDS = (
    Need("gcc", has("gcc")),
    Need("libc6-dev", compiles("#include <stdio.h>", "gcc")),
    Need("make", has("make")),
    Need("gcc-avr", has("avr-gcc")),
    Need("avr-libc", compiles("#include <avr/io.h>", *AVR)),
    Need("libsimavr-dev", compiles("#include <simavr/sim_avr.h>", "gcc")),
    Need("libelf-dev", compiles("#include <gelf.h>", "gcc")),
    Need("gcc-arm-none-eabi", has("arm-none-eabi-gcc")),
    Need("libunicorn-dev", compiles("#include <unicorn/unicorn.h>", "gcc")),
    Need(f"{PYTHON}-dev", has_python_headers),
    Need(f"{PYTHON}-venv", has_modules("ensurepip", "venv")),
)
# Other people's opinion of a card that was prepared.
TEST_NEEDS = (
    Need("dosfstools", has("fsck.fat")),
    Need("mtools", has("mdir")),
    Need("fdisk", has("sfdisk")),
)
CHECK_NEEDS = (
    Need("clang-tidy", has("clang-tidy")),
    Need("cppcheck", has("cppcheck")),
    Need(
        "libnewlib-arm-none-eabi",
        compiles("#include <string.h>", "arm-none-eabi-gcc", "-mcpu=cortex-m4"),
    ),
)


def main(arguments: Sequence[str]) -> None:
    if len(arguments) != 1 or arguments[0] not in GROUPS:
        sys.exit(f"usage: tools/setup.py {{{','.join(GROUPS)}}}")
    if sys.version_info < LEAST_PYTHON:
        run_under_another_python(arguments)
    command = arguments[0]
    BUILD.mkdir(exist_ok=True)
    with (BUILD / ".setup.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        LOG.write_text("")
        install_system_packages(command)
        make_environment()
        install_requirements(command)
        install_package()
        if command != "check":
            images = ("--environment", "nano", "--environment", "stm32f405")
            step("firmware images", venv("pio"), "run", "--silent", *images)
            step("virtual boards", "make", "--silent", "--directory", "sim")


def run_under_another_python(arguments: Sequence[str]) -> NoReturn:
    for minor in range(LEAST_PYTHON[1], LEAST_PYTHON[1] + 9):
        other = shutil.which(f"python3.{minor}")
        if other is not None:
            os.execv(other, [other, __file__, *arguments])  # noqa: S606, no shell meant
    sys.exit(
        f"Python {sys.version.split()[0]} is too old: install python3.11 or later, "
        "python3.11-venv and python3.11-dev, then run the same command again"
    )


def install_system_packages(command: str) -> None:
    needs: tuple[Need, ...] = BUILD_NEEDS
    needs += TEST_NEEDS if command in ("test", "coverage") else ()
    needs += CHECK_NEEDS if command == "check" else ()
    missing = [need.package for need in needs if not need.is_met()]
    if not missing:
        return
    install = ["apt-get", "install", "-y", "--no-install-recommends", *missing]
    root = () if os.geteuid() == 0 else ("sudo", "-n")
    is_allowed = not root or (shutil.which("sudo") and succeeds(*root, "true"))
    if not (is_allowed and shutil.which("apt-get")):
        sys.exit(
            f"This machine lacks {', '.join(missing)}. Run this line, then the same "
            f"command again:\n\n  sudo apt-get install {' '.join(missing)}\n"
        )
    quiet = (*root, "env", "DEBIAN_FRONTEND=noninteractive")
    # Package lists may be absent or stale; fetching them is only then worth its time.
    line = shlex.join([*quiet, *install])
    update = shlex.join([*root, "apt-get", "update"])
    step("system packages", "sh", "-c", f"{line} || {{ {update} && {line}; }}")
    left = [need.package for need in needs if not need.is_met()]
    if left:
        sys.exit(f"{', '.join(left)}: installed, and still not found; see {LOG}")


def make_environment() -> None:
    python = venv("python")
    if not (Path(python).exists() and succeeds(python, "-m", "pip", "--version")):
        step("virtual environment", sys.executable, "-m", "venv", "--clear", str(VENV))


def install_requirements(command: str) -> None:
    import tomllib  # Python 3.11, which main() has made sure of

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = list(project["project"]["dependencies"])
    for group in GROUPS[command]:
        wanted += project["dependency-groups"][group]
    stamp = VENV / "requirements.json"
    there = json.loads(stamp.read_text()) if stamp.exists() else []
    if set(wanted) <= set(there):
        return
    step("Python packages", *pip("install", *wanted))
    stamp.write_text(json.dumps(sorted({*there, *wanted})))


def install_package() -> None:
    """Install imud so that Python files are used in place; only C asks for more."""
    sources = [
        ROOT / "pyproject.toml",
        ROOT / "CMakeLists.txt",
        *sorted((ROOT / "host" / "imud").glob("*.c")),
        *sorted((ROOT / "firmware" / "core").glob("*.[ch]")),
    ]
    digest = hashlib.sha256(str(ROOT).encode())
    for path in sources:
        digest.update(f"\0{path.relative_to(ROOT)}\0".encode() + path.read_bytes())
    stamp = VENV / "package.sha256"
    if stamp.exists() and stamp.read_text() == digest.hexdigest():
        return
    step(
        "imud",
        *pip("install", "--no-deps", "--no-build-isolation"),
        "--config-settings=cmake.define.IMUD_WERROR=ON",
        "--editable",
        str(ROOT),
    )
    stamp.write_text(digest.hexdigest())


def pip(*arguments: str) -> tuple[str, ...]:
    quiet = ("--disable-pip-version-check", "--no-input", "--progress-bar=off")
    return (venv("python"), "-m", "pip", *arguments, *quiet)


def venv(program: str) -> str:
    return str(VENV / "bin" / program)


def step(name: str, *command: str) -> None:
    """Run one command; say its name and time, and more only where it fails."""
    sys.stdout.write(f"{name:<22}")
    sys.stdout.flush()
    start = time.monotonic()
    environment = {
        **os.environ,
        "PATH": f"{VENV / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PLATFORMIO_SETTING_ENABLE_TELEMETRY": "no",
        "PLATFORMIO_DISABLE_UPGRADE_CHECK": "true",
    }
    environment.pop("PLATFORMIO_CORE_DIR", None)  # it would override platformio.ini
    with LOG.open("a") as log:
        log.write(f"$ {shlex.join(command)}\n")
        log.flush()
        done = subprocess.run(
            command,
            cwd=ROOT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            check=False,
        )
    sys.stdout.write(f"{time.monotonic() - start:7.1f} s\n")
    if done.returncode:
        tail = "\n".join(LOG.read_text(errors="replace").splitlines()[-25:])
        sys.exit(f"\n{tail}\n\n{name} failed; all of it is in {LOG}")


if __name__ == "__main__":
    main(sys.argv[1:])
