# SPDX-License-Identifier: MIT
"""Files built in a checkout are compared with its sources."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from imud import _core, checkout
from imud.errors import BuildFailed

OTHER = "0" * 64


class Machine:
    """Takes commands and the start of a program down instead of running them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, exit_code: int = 0) -> None:
        self.ran: list[list[str]] = []
        self.started: list[str] = []
        self.exit_code = exit_code
        monkeypatch.setattr(subprocess, "run", self._run)
        monkeypatch.setattr(os, "execv", self._start)
        monkeypatch.setattr(os, "environ", dict(os.environ))

    def _run(
        self, command: list[str], env: Mapping[str, str], **_: object
    ) -> subprocess.CompletedProcess[str]:
        assert "PLATFORMIO_CORE_DIR" not in env
        self.ran.append(command)
        return subprocess.CompletedProcess(command, self.exit_code, "no compiler\n")

    def _start(self, program: str, words: list[str]) -> None:
        assert program == words[0] == sys.executable
        self.started.extend(words)


def changed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sources differ from those of all that was built."""
    monkeypatch.setattr(checkout, "digest", lambda *_: OTHER)


def test_a_digest_tells_contents_and_names_apart(tmp_path: Path) -> None:
    def digest() -> str:
        return checkout.digest(("*.c", "a.*", "x/**/*.c"), tmp_path)

    found = {digest()}
    (tmp_path / "a.c").write_text("1")
    found.add(digest())
    (tmp_path / "a.c").write_text("2")
    found.add(digest())
    (tmp_path / "a.c").rename(tmp_path / "b.c")
    found.add(digest())
    (tmp_path / "x" / "y").mkdir(parents=True)
    (tmp_path / "x" / "y" / "a.c").write_text("2")
    found.add(digest())
    assert len(found) == 5
    (tmp_path / "a.h.txt.o").unlink(missing_ok=True)
    (tmp_path / "other.h").write_text("")
    assert digest() in found


def test_the_core_in_use_is_of_the_sources_here() -> None:
    assert checkout.is_checkout()
    assert checkout.digest(checkout.CORE) == _core.SOURCES


def test_nothing_is_built_where_nothing_has_changed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = Machine(monkeypatch)
    checkout.refresh_core()
    assert (machine.ran, machine.started, capsys.readouterr().err) == ([], [], "")


def test_a_core_of_other_sources_is_built_and_the_program_starts_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = Machine(monkeypatch)
    changed(monkeypatch)
    monkeypatch.setattr(sys, "orig_argv", ["python3", "-m", "imud", "list"])
    checkout.refresh_core()
    ((python, script, what),) = machine.ran
    assert (python, Path(script).name, what) == (sys.executable, "setup.py", "package")
    assert machine.started == [sys.executable, "-m", "imud", "list"]
    assert capsys.readouterr().err == (
        "imud._core does not match the sources in firmware/core: rebuilding\n"
    )
    with pytest.raises(BuildFailed, match="make setup"):  # that did not help
        checkout.refresh_core()


def test_a_core_that_can_not_be_built_is_an_error_with_the_compilers_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = Machine(monkeypatch, exit_code=1)
    changed(monkeypatch)
    with pytest.raises(BuildFailed, match="once corrected, run: make setup"):
        checkout.refresh_core()
    assert machine.started == []
    assert capsys.readouterr().err.endswith("no compiler\n")


def test_an_installed_package_has_nothing_to_compare_with(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    machine = Machine(monkeypatch)
    changed(monkeypatch)
    monkeypatch.setattr(checkout, "ROOT", tmp_path)
    checkout.refresh_core()
    assert machine.ran == []


@pytest.mark.parametrize(
    ("place", "command"),
    [
        (".pio/build/nano/firmware.elf", ["--environment", "nano"]),
        (".pio/build/stm32f405/firmware.elf", ["--environment", "stm32f405"]),
    ],
)
def test_an_image_of_other_sources_is_built_again(
    place: str,
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    image = tmp_path / place
    image.parent.mkdir(parents=True)
    image.write_bytes(b"\x7fELF and no section")
    (tmp_path / "platformio.ini").write_text("")
    machine = Machine(monkeypatch)
    checkout.refresh_image(image)
    (ran,) = machine.ran
    assert ran[-len(command) :] == command
    assert capsys.readouterr().err.endswith(": rebuilding\n")
    image.write_bytes(b"\x7fELF" + checkout.noted(checkout.BOARD, tmp_path))
    checkout.refresh_image(image)
    assert len(machine.ran) == 1


def test_an_image_from_elsewhere_is_left_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = Machine(monkeypatch)
    for place in ("firmware.elf", "nano.elf", ".pio/build/nano/firmware.elf"):
        image = tmp_path / place  # no platformio.ini: an image that was copied
        image.parent.mkdir(parents=True, exist_ok=True)
        image.write_bytes(b"\x7fELF")
        checkout.refresh_image(image)
    assert machine.ran == []


@pytest.mark.parametrize("board", ["nano", "f405"])
def test_an_image_carries_the_digest_of_its_sources(
    boards: dict[str, tuple[Path, Path]], board: str
) -> None:
    _, image = boards[board]
    assert checkout.noted(checkout.BOARD) in image.read_bytes()
