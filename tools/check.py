# SPDX-License-Identifier: MIT
"""Static checks of the whole source; with --format, formats it instead.

Every check runs even if another fails, so that one run shows all problems. Checks run
side by side, one for each core.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import needs
import quietly

ROOT = Path(__file__).resolve().parent.parent
CORE = Path("firmware/core")
PAGE_TOOLS = ROOT / "build" / "web" / "node_modules" / ".bin"
C_FOLDERS = ("benchmarks", "firmware", "host/imud", "protocol", "sim")
AVR8JS = "tests/avr8js"
IN_AVR8JS = (
    f"pio run --silent --environment nano && {sys.executable} -m pytest -q {AVR8JS}"
)
IN_RP2040JS = (
    f"{sys.executable} tools/pico.py pico && make --silent --directory sim pico && "
    f"{sys.executable} -m pytest -q -m 'not nightly' tests/system/test_pico.py"
)
INCLUDES = ("-Ifirmware", "-Isim", "-Isim/chips")

CPPCHECK = (
    "cppcheck",
    "--quiet",
    "--std=c11",
    "--enable=warning,performance,portability",
    "--inline-suppr",
    "--error-exitcode=1",
    # The compilers report missing headers; cppcheck can do without the system's.
    "--suppress=missingIncludeSystem",
    # fixed.h asserts that the compiler shifts negative numbers arithmetically.
    "--suppress=shiftNegativeLHS:firmware/core/math/fixed.h",
    # False alarm at the address of a message that pose_read is to fill.
    "--suppress=ctuuninitvar:firmware/core/fusion/pose.c",
)


def main() -> None:
    parser = argparse.ArgumentParser(prog="tools/check.py", description=__doc__)
    parser.add_argument("--format", action="store_true", help="only format the source")
    if parser.parse_args().format:
        c = ("clang-format", "-i", *sources(*C_FOLDERS))
        for words in (c, ("ruff", "format", "--quiet")):
            subprocess.run(words, cwd=ROOT, check=True)
        return
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        tried = [(name, pool.submit(passes, name, words)) for name, words in checks()]
    failed = [name for name, is_good in tried if not is_good.result()]
    if failed:
        sys.exit(f"\nnot passed: {', '.join(failed)}")


def checks() -> Iterator[tuple[str, tuple[str, ...]]]:
    python = sys.executable
    portable = sources(str(CORE), kinds=("*.c",))
    chips = sources("sim/chips", kinds=("*.c",))
    avr = sources("firmware/avr", kinds=("*.c",))
    stm32 = sources("firmware/stm32", kinds=("*.c",))
    # The longest first.
    for name, files in (("core", portable), ("chips", chips)):
        yield (
            f"clang-tidy, {name}",
            ("clang-tidy", "--quiet", *files, "--", "-std=gnu11", *INCLUDES),
        )
    windows = ("clang", f"--target={needs.WINDOWS}", "-fsyntax-only")
    strict = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")
    yield "core, for Windows", (*windows, "-std=c11", *strict, *INCLUDES, *portable)
    yield "proof", (python, "tools/prove.py", "--if-there")
    yield (
        "proofs that fail",
        (python, "-m", "pytest", "-q", "tests/tools/test_prove.py"),
    )
    rules = ("tests/test_house.py", "tests/test_limits.py")
    yield "budget of lines and bytes", (python, "tools/budget.py")
    yield "rules of the house", (python, "-m", "pytest", "-q", *rules)
    # Here and not only in `make test`: that does not install them.
    bootloaders = "tests/system/test_bootloaders.py"
    yield "bootloaders", (python, "-m", "pytest", "-q", bootloaders)
    languages = "tests/host/client/test_languages.py"
    yield "examples", (python, "-m", "pytest", "-q", languages)
    yield "types", ("mypy",)
    yield (
        "layout of C",
        ("clang-format", "--dry-run", "-Werror", *sources(*C_FOLDERS)),
    )
    yield "layout of Python", ("ruff", "format", "--check", "--quiet")
    yield "lint of Python", ("ruff", "check", "--quiet")
    yield "imports", ("lint-imports",)
    yield from of_scripts()
    yield "generated files", (python, "protocol/generate.py", "--check")
    yield "MicroPython", (python, "tools/micropython_build.py", "check")
    yield "cppcheck", (*CPPCHECK, *INCLUDES, *portable, *chips)
    for board in ("nano", "mega"):
        pins = f"-Ifirmware/avr/{board}"
        words = (*CPPCHECK, "--platform=avr8", "--library=avr", *INCLUDES, pins, *avr)
        yield f"cppcheck, {board}", words
    yield (
        "cppcheck, stm32",
        (
            *(*CPPCHECK, "--platform=unix32", "-DF_CPU=168000000L", *INCLUDES),
            *("-Ifirmware/stm32/libc", *stm32),
        ),
    )


def of_scripts() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Checks of the page, and of the emulators in JavaScript."""
    yield (
        "types of the page",
        (str(PAGE_TOOLS / "tsc"), "-p", "tools/web/tsconfig.json"),
    )
    eslint = ("--config", "build/web/eslint.config.js", "host/imud/web/site")
    yield "lint of the page", (str(PAGE_TOOLS / "eslint"), *eslint, AVR8JS)
    yield (
        "types beside avr8js",
        (str(PAGE_TOOLS / "tsc"), "-p", f"{AVR8JS}/tsconfig.json"),
    )
    yield "image in avr8js", ("sh", "-c", IN_AVR8JS)
    yield "image in rp2040js", ("sh", "-c", IN_RP2040JS)
    yield "the page's libraries", (sys.executable, "tools/vendor.py", "--check")


def sources(*folders: str, kinds: tuple[str, ...] = ("*.c", "*.h")) -> list[str]:
    return sorted(
        str(path.relative_to(ROOT))
        for folder in folders
        for kind in kinds
        for path in (ROOT / folder).rglob(kind)
    )


def passes(name: str, command: tuple[str, ...]) -> bool:
    start = time.monotonic()
    # Nothing may be left out here for want of a tool: tests/demanded.py.
    environment = os.environ | {"IMU_DEMANDED": "1"}
    done = quietly.run(*command, cwd=ROOT, env=environment)
    is_good = done.returncode == 0
    told = "" if is_good else f"  not passed\n{done.stdout}"
    sys.stdout.write(f"{name:<22}{time.monotonic() - start:7.1f} s{told}\n")
    sys.stdout.flush()
    return is_good


if __name__ == "__main__":
    main()
