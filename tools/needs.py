# SPDX-License-Identifier: MIT
"""The system packages that make's commands need, with a test for each."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple


class Need(NamedTuple):
    """A package of the system, and a test for what it installs."""

    package: str
    is_met: Callable[[], bool]


def has(program: str) -> Callable[[], bool]:
    # Folders of administrators' programs are not in every user's PATH.
    path = os.pathsep.join((os.environ.get("PATH", os.defpath), "/usr/sbin", "/sbin"))
    return lambda: shutil.which(program, path=path) is not None


def compiles(line: str, *compiler: str, until: str = "-E") -> Callable[[], bool]:
    """Whether a compiler accepts a line of C, by default in its preprocessor alone."""

    def probe() -> bool:
        if shutil.which(compiler[0]) is None:
            return False
        done = subprocess.run(
            [*compiler, until, "-xc", "-", "-o", os.devnull],
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
ARM = ("arm-none-eabi-gcc", "-mcpu=cortex-m4")
# Installed first: a Python package without a wheel for this machine is compiled.
PYTHON_NEEDS = (
    Need("gcc", has("gcc")),
    Need("libc6-dev", compiles("#include <stdio.h>", "gcc")),
    Need(f"{PYTHON}-dev", has_python_headers),
    Need(f"{PYTHON}-venv", has_modules("ensurepip", "venv")),
)
BUILD_NEEDS = (
    Need("make", has("make")),
    Need("libelf-dev", compiles("#include <gelf.h>", "gcc")),
)
BOARD_NEEDS = {
    "nano": (
        Need("gcc-avr", has("avr-gcc")),
        Need("avr-libc", compiles("#include <avr/io.h>", *AVR)),
        Need("libsimavr-dev", compiles("#include <simavr/sim_avr.h>", "gcc")),
    ),
    "f405": (
        Need("gcc-arm-none-eabi", has("arm-none-eabi-gcc")),
        Need("libunicorn-dev", compiles("#include <unicorn/unicorn.h>", "gcc")),
    ),
}
# Tests compile the core with a C library for ARM; our own images need none.
NEWLIB = Need("libnewlib-arm-none-eabi", compiles("#include <string.h>", *ARM))
# Shows the page to tests, which leave that out where it is not: Ubuntu has no package.
CHROMIUM = Need(
    "chromium-headless-shell",
    lambda: has("chromium-headless-shell")() or has("chromium")(),
)
# Proves that parsers have no undefined behaviour, and takes 860 MB.
FRAMA_C = Need("frama-c-base", has("frama-c"))
BROWSING = ("test", "test-long", "bench")  # commands that use it
RISC_V = ("riscv64-unknown-elf-gcc", "--specs=picolibc.specs")
MPY = "mpy"  # the module in files for boards with MicroPython: tools/mpy.py
BOARD_NEEDS[MPY] = (
    Need("gcc-arm-none-eabi", has("arm-none-eabi-gcc")),
    NEWLIB,
    Need("gcc-riscv64-unknown-elf", has("riscv64-unknown-elf-gcc")),
    Need("picolibc-riscv64-unknown-elf", compiles("#include <assert.h>", *RISC_V)),
)
BOARD_NEEDS["mega"] = BOARD_NEEDS["nano"]
PICOS = (
    "pico",
    "pico-micropython",
    "pico2-micropython",
)  # as tools/pico.py builds them
STOCK = "pico-stock"  # for tests alone
for _name in (*PICOS, STOCK):
    BOARD_NEEDS[_name] = (
        *(Need("gcc-arm-none-eabi", has("arm-none-eabi-gcc")), NEWLIB),
        *(Need("nodejs", has("node")), Need("npm", has("npm"))),
    )
# Of imud bridge. Where the package of a broker would start it, now and at each boot, it
# is left out, and so are the tests that need it.
SYSTEMD_RUNS = Path("/run/systemd/system")
OTHER_ENDS = (
    Need("liblo-tools", has("oscdump")),
    Need("mosquitto", lambda: has("mosquitto")() or SYSTEMD_RUNS.exists()),
)
TEST_NEEDS = (
    NEWLIB,
    # Independent tools that check a card which `imud card prepare` made.
    Need("dosfstools", has("fsck.fat")),
    Need("mtools", has("mdir")),
    Need("fdisk", has("sfdisk")),
    *OTHER_ENDS,
    # For systemd-analyze; not installed where another init system is in use.
    Need("systemd", lambda: has("systemd-analyze")() or Path("/sbin/init").exists()),
)
# Runs the examples for Octave and MATLAB, and takes 300 MB.
OCTAVE = Need("octave", has("octave-cli"))
# Runs those files.
EMULATED = (
    Need("qemu-system-arm", has("qemu-system-arm")),
    Need("qemu-system-misc", has("qemu-system-riscv32")),
)
BOOTLOADERS = Path("/usr/share/arduino/hardware/arduino/avr/bootloaders")
FUZZED = "int LLVMFuzzerTestOneInput(void); int LLVMFuzzerTestOneInput() { return 0; }"
WINDOWS = "x86_64-pc-windows-gnu"
CHECK_NEEDS = (
    Need(
        "mingw-w64-x86-64-dev",  # headers alone
        compiles("#include <string.h>", "clang", f"--target={WINDOWS}"),
    ),
    NEWLIB,
    Need("clang", has("clang")),
    Need("libclang-rt-dev", compiles(FUZZED, "clang", until="-fsanitize=fuzzer")),
    Need("clang-tidy", has("clang-tidy")),
    Need("cppcheck", has("cppcheck")),
    # For the tools that check the page, and for avr8js.
    Need("nodejs", has("node")),
    Need("npm", has("npm")),
    OCTAVE,
    # Bootloaders, for tests that are left out where they are not: tests/bootloaders.py.
    Need("arduino-core-avr", BOOTLOADERS.is_dir),
)
# Of which NEWLIB is inside the images of the Pico, too.
RELEASE_NEEDS = BOARD_NEEDS[MPY]


def system_needs(command: str, boards: Sequence[str]) -> tuple[Need, ...]:
    needs = BUILD_NEEDS + tuple(need for name in boards for need in BOARD_NEEDS[name])
    needs += TEST_NEEDS if command in ("test", "test-long", "coverage") else ()
    needs += OTHER_ENDS if command == "bench" else ()
    needs += (OCTAVE, *EMULATED) if command == "test-long" else ()
    needs += RELEASE_NEEDS if command == "release" else ()
    needs += CHECK_NEEDS if command == "check" else ()
    return needs


def missing(needs: Sequence[Need]) -> list[str]:
    return [need.package for need in needs if not need.is_met()]
