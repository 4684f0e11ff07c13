# SPDX-License-Identifier: MIT
"""`imud flash`, whole: a person's task, on a virtual Nano with the bootloaders that it
is sold with, with a daemon that runs and without one.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import bootloaders
from bootloaders import ATMEGABOOT, OPTIBOOT_4
from demanded import leave_out
from fakes import PATIENCE_S, DaemonProcess, free_endpoint
from imud import checkout, cli
from imud.cli import flash_params, reached
from imud.client import Client
from imud.params import file
from imud.version import version
from length import choose
from system.live import LiveProbe
from system.virtual import NANO, Stub

ONE = pytest.mark.parametrize(
    "bootloader", choose(everyday=[OPTIBOOT_4], long=[OPTIBOOT_4, ATMEGABOOT])
)
PARAMS = file.parse('[options]\nbutton_does = "tell"\nreference = "full"\n').params
KEPT = f"active, as before: params {PARAMS.digest:08x}"

VERSION = version().encode()

# Of both the EEPROM and the wire have changed since: the first one that this protocol
# had, and the first one with params.
OLD = ("139f65d9", "1b53428b")


@pytest.fixture
def stub(nano: Path, image: Path, tmp_path: Path) -> Stub:
    return Stub(NANO, nano, image, tmp_path)


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where params are kept meanwhile. No daemon is at the default endpoint."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    endpoint = free_endpoint()
    monkeypatch.setattr(reached, "ENDPOINT", endpoint)
    monkeypatch.setattr("imud.cli.arguments.ENDPOINT", endpoint)
    # A busy machine holds up a board, which is waited for.
    for name in ("check_ports.START_S", "check_ports.PROBE_S", "flash_params.PARAMS_S"):
        monkeypatch.setattr(f"imud.cli.{name}", PATIENCE_S)
    return tmp_path / "state" / "imud" / "flash"


@contextlib.contextmanager
def board(
    stub: Stub, bootloader: str, image: Path | None = None
) -> Iterator[LiveProbe]:
    """A Nano that is reset as its port is opened, and that keeps its EEPROM."""
    one = Stub(NANO, stub.simulator, image or stub.image, stub.folder)
    options = bootloaders.options(bootloader)
    memory = stub.folder / "eeprom"
    probe = LiveProbe(one, "--reset-on-open", "--eeprom", memory, *options)
    try:
        yield probe
    finally:
        probe.end()


def offered(stub: Stub, **changes: object) -> Path:
    """A copy of the image and its manifest, as a release has them."""
    built = stub.image.with_suffix(".hex")
    row = json.loads(built.with_name("manifest.json").read_text())["images"][0]
    folder = stub.folder / "offered"
    folder.mkdir(exist_ok=True)
    shutil.copy(built, folder / built.name)
    (folder / "manifest.json").write_text(json.dumps({"images": [row | changes]}))
    return folder / built.name


class Flash:
    """Runs `imud flash`."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def ends_well(self, *words: object) -> str:
        """What it says."""
        status = cli.main(["flash", *map(str, words)])
        out, err = self._capsys.readouterr()
        assert (status, err) == (0, "")
        return out

    def is_refused(self, *words: object) -> str:
        """The one line that it says instead."""
        assert cli.main(["flash", *map(str, words)]) == 1
        line = self._capsys.readouterr().err
        assert line.startswith("imud: ")
        assert line.count("\n") == 1
        return line


@pytest.fixture
def flash(capsys: pytest.CaptureFixture[str]) -> Flash:
    return Flash(capsys)


class Served:
    """A daemon on a probe's port, a client of it, and the probe's name."""

    def __init__(self, daemon: DaemonProcess, client: Client) -> None:
        self.client = client
        self.name = client.wait_for(seconds=PATIENCE_S)
        self.words = (self.name, "--connect", daemon.endpoint)

    def give_params(self) -> None:
        self.client.change_params(self.name, PARAMS.encode())


@contextlib.contextmanager
def served(probe: LiveProbe, folder: Path) -> Iterator[Served]:
    with DaemonProcess(probe.port, directory=folder) as daemon:
        daemon.expect("listens on")
        with Client(daemon.endpoint) as client:
            yield Served(daemon, client)
        daemon.stop()


def older(stub: Stub) -> Path:
    """The image as it was before this version; it says so in its hello."""
    version = VERSION + b"+"
    code = stub.image.read_bytes()
    assert code.count(version) == 1
    path = stub.folder / "older.elf"
    path.write_bytes(code.replace(version, b"0.0.9+"))
    return path


@pytest.mark.long
@ONE
def test_a_running_daemon_lends_its_port_and_the_params_stay(
    stub: Stub, bootloader: str, flash: Flash, state: Path
) -> None:
    with board(stub, bootloader) as probe, served(probe, stub.folder) as desk:
        desk.give_params()
        image = offered(stub)
        words = (*desk.words, "--image", image, "--force")
        said = flash.ends_well(*words, "--dry-run")
        assert "nothing was written" in said
        said = flash.ends_well(*words)
        assert "pages written and read back" in said
        assert KEPT in said
        assert not [*state.iterdir()]  # not needed any more
        assert desk.client.params(desk.name)["digest"] == f"{PARAMS.digest:08x}"
        assert desk.client.command(desk.name, "start")["ok"]


@pytest.mark.nightly
@ONE
def test_without_a_daemon_it_brings_its_own(
    stub: Stub, bootloader: str, flash: Flash
) -> None:
    with board(stub, bootloader) as probe:
        with served(probe, stub.folder) as desk:
            desk.give_params()
        said = flash.ends_well(probe.port, "--image", offered(stub), "--force")
        assert KEPT in said


@pytest.mark.long
@ONE
def test_params_that_are_gone_are_loaded_again(
    stub: Stub, bootloader: str, flash: Flash, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with a chip whose EEPROM is erased with its flash."""
    kept = flash_params.keep

    def then_lose(client: Client, status: dict[str, Any], *, is_forced: bool) -> None:
        kept(client, status, is_forced=is_forced)
        client.change_params(str(status["probe"]), b"")

    monkeypatch.setattr(flash_params, "keep", then_lose)
    with board(stub, bootloader) as probe, served(probe, stub.folder) as desk:
        desk.give_params()
        said = flash.ends_well(*desk.words, "--image", offered(stub), "--force")
        assert "active: no params; loading the previous ones" in said
        assert KEPT in said
        assert desk.client.params(desk.name)["digest"] == f"{PARAMS.digest:08x}"


@pytest.mark.long
@pytest.mark.parametrize("share", choose(everyday=[0.5], long=[0.1, 0.3, 0.7, 0.95]))
@ONE
def test_killed_in_the_midst_it_says_how_to_go_on_and_then_does(
    stub: Stub, bootloader: str, share: float, flash: Flash
) -> None:
    with board(stub, bootloader) as probe:
        with served(probe, stub.folder) as desk:
            desk.give_params()
        image = offered(stub)
        words = [str(probe.port), "--image", str(image), "--force"]
        # In a terminal of its own, which shows how far it is.
        master, slave = os.openpty()
        killed = subprocess.Popen(
            [sys.executable, "-P", "-m", "imud", "flash", *words],
            stdout=subprocess.DEVNULL,
            stderr=slave,
        )
        os.close(slave)
        heard, percent = "", -1
        while percent < 100.0 * share:
            heard += os.read(master, 4096).decode(errors="replace")
            # Writing, and not the reading back that comes after it.
            percent = max(map(int, re.findall(r"writing\D* (\d+)%", heard)), default=-1)
        killed.send_signal(signal.SIGKILL)
        killed.wait(PATIENCE_S)
        os.close(master)

        line = flash.is_refused(probe.port, "--image", image)
        assert f"pass its type: imud flash {probe.port} --board nano" in line
        said = flash.ends_well(probe.port, "--image", image, "--board", "nano")
        assert "no firmware of ours answers" in said
        assert " runs " in said
        assert KEPT in said  # which the run that was killed has saved


def test_what_is_no_step_ahead_or_another_boards_is_refused(
    stub: Stub, flash: Flash, tmp_path: Path
) -> None:
    with board(stub, OPTIBOOT_4) as probe, served(probe, stub.folder) as desk:
        name, words = desk.name, desk.words
        has = desk.client.statuses(name)[0]["hello"]["firmware"]

        def with_manifest(**changes: object) -> str:
            return flash.is_refused(*words, "--image", offered(stub, **changes))

        assert "older than the board's" in with_manifest(version="0.0.9+1234567")
        assert "has schema 00000000" in with_manifest(schema="00000000")
        assert "its SHA-256 differs" in with_manifest(sha256="0" * 64)
        assert "fits an Arduino Nano, not f405" in with_manifest(board="f405")

        bare = tmp_path / "bare.hex"
        shutil.copy(stub.image.with_suffix(".hex"), bare)
        line = flash.is_refused(*words, "--image", bare)
        assert "if you built it for this board: --board nano" in line
        line = flash.is_refused(*words, "--board", "f405")
        assert f"{name} is an Arduino Nano, not f405" in line
        line = flash.is_refused("nosuch", *words[1:])
        assert f"no probe nosuch; choose one: {name}" in line
        # Nothing of all that touched the board.
        assert desk.client.statuses(name)[0]["hello"]["firmware"] == has


def test_a_board_without_a_bootloader_is_left_as_it_was(
    stub: Stub, flash: Flash
) -> None:
    with board(stub, bootloaders.NONE) as probe:
        line = flash.is_refused(probe.port, "--image", offered(stub), "--force")
        assert "no bootloader answers at 115200 or 57600 baud" in line
        assert line.endswith("; nothing was written\n")
        assert " runs " not in line


@pytest.mark.long
@pytest.mark.parametrize("commit", choose(everyday=OLD[:1], long=OLD))
@ONE
def test_old_firmware_is_replaced(
    stub: Stub, bootloader: str, commit: str, flash: Flash
) -> None:
    bootloaders.options(bootloader)  # or it is left out
    old = _built(commit, stub.folder / "old")
    with board(stub, bootloader, old) as probe:
        said = flash.ends_well(probe.port, "--image", offered(stub))
        assert "firmware 0.1.0 -> " in said
        assert "this imud can't read its params: flashing does not change them" in said
        assert "active: no params" in said


def _built(commit: str, folder: Path) -> Path:
    """The Nano's image of an earlier commit."""
    archive = subprocess.run(
        ["git", "archive", commit], cwd=checkout.ROOT, capture_output=True, check=False
    )
    if archive.returncode != 0:
        leave_out(f"commit {commit} is not here: a clone without history")
    folder.mkdir()
    subprocess.run(["tar", "x"], cwd=folder, input=archive.stdout, check=True)
    # Compilers that came later have warnings that it did not know.
    settings = folder / "platformio.ini"
    settings.write_text(settings.read_text().replace("-Werror", ""))
    subprocess.run(
        [sys.executable, "-m", "platformio", "run", "--silent", "-e", "nano"],
        cwd=folder,
        env=checkout.environment_of(Path(sys.executable).parent),
        check=True,
        capture_output=True,
    )
    return folder / ".pio" / "build" / "nano" / "firmware.elf"
