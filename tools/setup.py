# SPDX-License-Identifier: MIT
"""Installs whatever one of make's commands needs and lacks, then builds.

Needs only the system's Python. Steps that do not depend on each other run in parallel.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NoReturn

import locked
from needs import (
    BOARD_NEEDS,
    BROWSING,
    CHROMIUM,
    FRAMA_C,
    MPY,
    PICOS,
    PYTHON_NEEDS,
    STOCK,
    Need,
    missing,
    succeeds,
    system_needs,
)

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "host"))
from imud import checkout  # noqa: E402 - by the system's Python, before any package

VENV = ROOT / ".venv"
BUILD = ROOT / "build"
LOG = BUILD / "setup.log"
LEAST_PYTHON = (3, 11)

# Dependency groups of pyproject.toml that a command needs, besides imud's own.
TESTS = ("test", "peers", "pictures")  # the benchmarks are tested, too
GROUPS = {
    "demo": ("build", "firmware"),
    "test": ("build", "firmware", "micropython", *TESTS),
    "test-long": ("build", "firmware", "micropython", *TESTS),
    "check": ("build", "firmware", "micropython", *TESTS, "check"),
    "coverage": ("build", "firmware", *TESTS, "coverage"),
    "bench": ("build", "firmware", "micropython", *TESTS),
    "release": ("build", "firmware", "release", "site"),
}
ENVIRONMENTS = {"nano": "nano", "f405": "stm32f405", "mega": "mega"}  # platformio.ini
PACKAGE = "package"


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(prog="tools/setup.py", description=__doc__)
    parser.add_argument(
        "command",
        choices=(*GROUPS, PACKAGE),
        help=f"the make command to prepare for, or {PACKAGE} to build only imud",
    )
    parser.add_argument(
        "--board", default="both", choices=(*BOARD_NEEDS, "both"), help="which to build"
    )
    args = parser.parse_args(arguments)
    if sys.version_info < LEAST_PYTHON:
        run_under_another_python(arguments)
    BUILD.mkdir(exist_ok=True)
    if args.command == PACKAGE:
        with alone():
            install_package()
        return
    boards = ("nano", "f405") if args.board == "both" else (args.board,)
    groups = GROUPS[args.command]
    if MPY in boards:
        groups = (*groups, "micropython")
    if args.command == "test-long":
        boards = (*boards, "pico", "pico-micropython", STOCK, "mega", MPY)
    with alone():
        LOG.write_text("")
        needs = system_needs(args.command, boards)
        refuse_what_cannot_be_installed(PYTHON_NEEDS + needs)
        install_system_packages(PYTHON_NEEDS)
        at_once(
            lambda: install_all_packages(needs, args.command),
            lambda: install_python_packages(groups),
        )
        if args.command == "check":
            at_once(
                install_package,
                install_page_tools,
                lambda: build_images(("nano",)),
                lambda: build_sim(("nano",)),
            )
            return
        if args.command == "release":
            install_package()  # tools/release.py builds in a folder of its own
            return
        at_once(
            install_package,
            lambda: build_images(boards),
            lambda: build_sim(boards),
            lambda: build_picos(boards),
            lambda: build_mpy(args.command, boards),
        )


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """Wait until no other process sets anything up."""
    with (BUILD / ".setup.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def build_images(boards: Sequence[str]) -> None:
    names = [ENVIRONMENTS[name] for name in boards if name in ENVIRONMENTS]
    chosen = [word for name in names for word in ("--environment", name)]
    if chosen:
        step("firmware images", venv("pio"), "run", "--silent", *chosen)


def build_mpy(command: str, boards: Sequence[str]) -> None:
    words = ("module for MicroPython", venv("python"), "tools/mpy.py")
    if MPY in boards:
        step(*words)
    elif command == "test":
        step(*words, "--if-possible", "x64")


def build_picos(boards: Sequence[str]) -> None:
    for name in filter((*PICOS, STOCK).__contains__, boards):
        step(f"image of {name}", venv("python"), "tools/pico.py", name)


def build_sim(boards: Sequence[str]) -> None:
    """Build both boards' emulators, or only the named board's; the Pico's if named."""
    if boards == (MPY,):
        return
    targets = ["all"] if len(boards) > 1 else []
    targets += ["pico"] if set(boards) & set(PICOS) else []
    emulator = {"mega": "nano"}.get(boards[0], boards[0])
    targets = targets or [f"../build/sim/{emulator}"]
    make = ("make", "--silent", f"--jobs={os.cpu_count() or 1}", "--directory=sim")
    step("virtual boards", *make, *targets)


def run_under_another_python(arguments: Sequence[str]) -> NoReturn:
    for minor in range(LEAST_PYTHON[1], LEAST_PYTHON[1] + 9):
        other = shutil.which(f"python3.{minor}")
        if other is not None:
            os.execv(other, [other, __file__, *arguments])  # noqa: S606, no shell meant
    sys.exit(
        f"Python {sys.version.split()[0]} is too old: install python3.11 or later, "
        "python3.11-venv and python3.11-dev, then run the same command again"
    )


def as_root() -> tuple[str, ...]:
    return () if os.geteuid() == 0 else ("sudo", "-n")


def refuse_what_cannot_be_installed(needs: Sequence[Need]) -> None:
    packages = missing(needs)
    root = as_root()
    is_allowed = not root or (shutil.which("sudo") and succeeds(*root, "true"))
    if packages and not (is_allowed and shutil.which("apt-get")):
        sys.exit(
            f"This machine lacks {', '.join(packages)}. Run this line, then the same "
            f"command again:\n\n  sudo apt-get install {' '.join(packages)}\n"
        )


def install_system_packages(needs: Sequence[Need]) -> None:
    packages = missing(needs)
    if not packages:
        return
    root = as_root()
    install = ["apt-get", "install", "-y", "--no-install-recommends", *packages]
    quiet = (*root, "env", "DEBIAN_FRONTEND=noninteractive")
    # Fetching package lists takes time: only if installing fails, as they may be stale.
    line = shlex.join([*quiet, *install])
    update = shlex.join([*root, "apt-get", "update"])
    step("system packages", "sh", "-c", f"{line} || {{ {update} && {line}; }}")
    if left := missing(needs):
        sys.exit(f"{', '.join(left)}: installed, but still not found; see {LOG}")


def install_all_packages(needs: Sequence[Need], command: str) -> None:
    install_system_packages(needs)
    if command in BROWSING:
        install_where_possible(CHROMIUM, "the page is not tested in a browser")
    if command == "check":
        install_where_possible(FRAMA_C, "nothing is proved")


def install_where_possible(need: Need, without: str) -> None:
    """Say what goes without it where it can't be installed."""
    if not missing((need,)):
        return
    try:
        refuse_what_cannot_be_installed((need,))
        install_system_packages((need,))
    except SystemExit:
        sys.stdout.write(
            f"{need.package} is missing and could not be installed: {without}\n"
        )


def install_python_packages(groups: Sequence[str]) -> None:
    make_environment()
    install_requirements(groups)


def make_environment() -> None:
    python = venv("python")
    if not (Path(python).exists() and succeeds(python, "-m", "pip", "--version")):
        step("virtual environment", sys.executable, "-m", "venv", "--clear", str(VENV))
    # Programs in the rooms of benchmarks/ import it by its name.
    for packages in VENV.glob("lib/python3*/site-packages"):
        (packages / "imu_probe.pth").write_text(f"{ROOT}\n")


def install_requirements(groups: Sequence[str]) -> None:
    import tomllib  # Python 3.11, which main() has made sure of

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = list(project["project"]["dependencies"])
    for group in groups:
        wanted += project["dependency-groups"][group]
    if locked.is_used():
        wanted = locked.lines_for(wanted, locked.read(locked.LOCK.read_text()))
    stamp = VENV / "requirements.json"
    there = json.loads(stamp.read_text()) if stamp.exists() else []
    if set(wanted) <= set(there):
        return
    listed = BUILD / "requirements.txt"
    listed.write_text("\n".join(wanted))
    words = ["install", "--no-compile"]  # most modules of it are never imported
    words += ["--require-hashes"] if locked.is_used() else []
    step("Python packages", *pip(*words, "--requirement", str(listed)))
    stamp.write_text(json.dumps(sorted({*there, *wanted})))


def install_package() -> None:
    """Install imud in editable mode; again only if its C or its build files changed, or
    its modules others: the loader of an editable package has a list of them.
    """
    digest = hashlib.sha256(checkout.digest(checkout.CORE).encode())
    digest.update((ROOT / "pyproject.toml").read_bytes())
    for path in sorted((ROOT / "host").rglob("*.py")):
        digest.update(f"\0{path}".encode())
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


def install_page_tools() -> None:
    """Install what tools/web/package.json names: what checks the page, and avr8js."""
    step("tools of the page", venv("python"), "tools/vendor.py", "--install")


def pip(*arguments: str) -> tuple[str, ...]:
    quiet = ("--disable-pip-version-check", "--no-input", "--progress-bar=off")
    return (venv("python"), "-m", "pip", *arguments, *quiet)


def venv(program: str) -> str:
    return str(VENV / "bin" / program)


def at_once(*tasks: Callable[[], None]) -> None:
    """Run tasks in parallel; raise a failure once all of them have ended."""
    with ThreadPoolExecutor(len(tasks)) as pool:
        for under_way in [pool.submit(task) for task in tasks]:
            under_way.result()


LOG_LOCK = threading.Lock()


def step(name: str, *command: str) -> None:
    """Run a command, print its name and seconds; if it fails, exit with its output."""
    if sys.stdout.isatty():
        tell(f"{name} ...\n")
    start = time.monotonic()
    with tempfile.TemporaryFile("w+", errors="replace") as output:
        done = subprocess.run(
            command,
            cwd=ROOT,
            env=checkout.environment_of(VENV / "bin"),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            check=False,
        )
        output.seek(0)
        text = output.read()
    with LOG_LOCK, LOG.open("a") as log:  # each step's lines stay together
        log.write(f"$ {shlex.join(command)}\n{text}")
    tell(f"{name:<22}{time.monotonic() - start:7.1f} s\n")
    if done.returncode:
        tail = "\n".join(text.splitlines()[-25:])
        sys.exit(f"\n{tail}\n\n{name} failed; the whole output is in {LOG}")


def tell(line: str) -> None:
    sys.stdout.write(line)
    sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
