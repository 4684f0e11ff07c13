# SPDX-License-Identifier: MIT
"""Shared by tests: paths, and the start of processes."""

from __future__ import annotations

import fcntl
import os
import platform
import signal
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

import native
from chromium import CHROMIUM
from imud import checkout
from imud.virtual.boards import BOARDS

pytest_plugins = ["native_mark", "length"]

ROOT = Path(__file__).resolve().parent.parent

# xdist sets the size of a terminal, which would hold for those that tests make.
for name in ("COLUMNS", "LINES"):
    os.environ.pop(name, None)

# A shell's & has SIGINT ignored, and the programs that tests start would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        checkout.refresh_core()
    # No process that a test starts needs the sanitizer that this one was started with;
    # those that xdist starts do.
    if hasattr(config, "workerinput") or config.getoption("dist", "no") == "no":
        native.keep_sanitizer()
        if os.environ.get("IMU_ASAN") == "1":
            native.ease_large_arrays()


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """The first process of xdist collects alone: it compiles modules and C, which the
    others then find.
    """
    if not hasattr(session.config, "workerinput"):
        return (yield)
    native.CACHE.mkdir(parents=True, exist_ok=True)
    with (native.CACHE / ".collect").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            fcntl.flock(file, fcntl.LOCK_SH)
        return (yield)


def pytest_sessionstart(session: pytest.Session) -> None:
    if not hasattr(session.config, "workerinput"):
        for path in complaints():
            path.unlink()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    for path in complaints():
        terminalreporter.section(
            f"{path.relative_to(ROOT)}: a sanitizer ended a process"
        )
        terminalreporter.write_line(path.read_text(errors="replace"))
    if CHROMIUM is None:
        terminalreporter.write_line(
            "chromium is not there, so the page was not tested in a browser: "
            "apt-get install chromium-headless-shell"
        )


def complaints() -> list[Path]:
    """The reports of sanitizers, as `make test` configures them."""
    return sorted((ROOT / "build").glob("sanitizer.*"))


@pytest.fixture(scope="session")
def root() -> Path:
    """The project's folder."""
    return ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Recordings with optical truth that are not part of the project."""
    data = ROOT.parent / "shared" / "data"
    if not data.is_dir():
        pytest.skip("the recordings of ../shared/data are not here")
    return data


class Boards(dict[str, tuple[Path, Path]]):
    """By name: the simulator of a virtual board, and its image. They are looked for
    when a test asks for them, so that it needs no images of other boards.
    """

    def __missing__(self, name: str) -> tuple[Path, Path]:
        self[name] = built_simulator(name), built_image(name)
        return self[name]


@pytest.fixture(scope="session")
def boards() -> Boards:
    """The virtual boards, each if it is built."""
    return Boards()


@pytest.fixture(scope="session")
def image() -> Path:
    """The image that a user flashes on a Nano."""
    return built_image("nano")


@pytest.fixture(scope="session")
def nano() -> Path:
    """The virtual Nano."""
    return built_simulator("nano")


@pytest.fixture(scope="session")
def f405() -> Path:
    """The virtual STM32F405."""
    return built_simulator("f405")


@pytest.fixture(scope="session")
def f405_image() -> Path:
    """The image that a user flashes on an STM32F405."""
    return built_image("f405")


@pytest.fixture(scope="session")
def stock() -> Path:
    path = Path(sys.prefix) / "bin" / "micropython"
    if not path.exists():
        # The condition of pyproject.toml: PyPI has wheels of it for these alone. Where
        # it has one the test fails.
        has_wheel = sys.version_info < (3, 14) and platform.machine() == "x86_64"
        assert not has_wheel, f"{path} is missing: run make test"
        pytest.skip("PyPI has no MicroPython for this Python")
    return path


def built_simulator(board: str) -> Path:
    return built(ROOT / BOARDS[board].simulator, "make sim")


def built_image(board: str) -> Path:
    found = built(ROOT / BOARDS[board].image, f"make firmware BOARD={board}")
    checkout.refresh_image(found)
    return found


def built(path: Path, command: str) -> Path:
    if not path.exists():
        pytest.fail(f"{path.relative_to(ROOT)} is not there: {command}", pytrace=False)
    return path
