# SPDX-License-Identifier: MIT
"""`imud flash --board micropython` and `--wifi`: from a blank board to a hello over the
air. The board is MicroPython's unix port with a raw REPL; its network is simulated.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import IPv4Address
from pathlib import Path
from typing import Any

import msgspec
import pytest

import programs
from demanded import leave_out
from fakes import PATIENCE_S, DaemonProcess, free_endpoint
from imud import checkout, cli, packaged
from imud.cli import check_ports, flash_micropython, reached
from imud.errors import ConfigError, FlashError
from imud.flash import micropython, serial_port, wifi
from imud.flash.micropython import Prompt
from imud.wire.schema import FINGERPRINT
from micropython_frames import PROGRAMS

ROOT = Path(__file__).resolve().parents[3]
MODULE = ROOT / "build" / "mpy" / "imuprobe-x64.mpy"
STOCK = Path(sys.prefix) / "bin" / "micropython"
PICO_W = "Raspberry Pi Pico W with RP2040"
SCHEMA = f"{FINGERPRINT:08x}"
X64 = 6 | 3 << 8 | 2 << 10
ODD = 'O\'Brien \\ "2" \u00e9\u4e2d'  # a name that a network may have
MINE = "from probe.start import start\nstart(1, 2, 3, 4, 5)\n"
PINS = ("i2c", "sda", "scl", "ready", "button", "led")
# Waits that end as soon as they may.
PATIENT = {
    check_ports: ("START_S", "PROBE_S", "WARNED_S"),
    flash_micropython: ("HELLO_S",),
    micropython: ("PROMPT_S", "ANSWER_S"),
    wifi: ("GREET_S",),
}
AIR = {"seen": ["home", "guest"], "password": "secret", "address": "127.0.0.1"}


@pytest.fixture(autouse=True)
def _module(stock: Path) -> None:  # noqa: ARG001 - it is there
    if not MODULE.exists():
        leave_out("this machine can't fetch MicroPython's sources")


@pytest.fixture(autouse=True)
def firmware(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An installed imu-probe-firmware; no daemon, and no state of this user."""
    monkeypatch.setattr(checkout, "is_checkout", lambda: False)
    folder = tmp_path / "firmware"
    (folder / "probe").mkdir(parents=True)
    (folder / MODULE.name).write_bytes(MODULE.read_bytes())
    rows = [row_of(folder, MODULE.name)]
    for path in (ROOT / "firmware" / "micropython").glob("probe/*.py"):
        (folder / "probe" / path.name).write_bytes(path.read_bytes())
        rows.append(row_of(folder, f"probe/{path.name}"))
    (folder / "manifest.json").write_text(json.dumps({"images": rows}))
    monkeypatch.setattr(packaged, "folder_of", lambda _name: folder)
    endpoint = free_endpoint()
    monkeypatch.setattr(reached, "ENDPOINT", endpoint)
    monkeypatch.setattr("imud.cli.arguments.ENDPOINT", endpoint)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    for room, names in PATIENT.items():
        for name in names:
            monkeypatch.setattr(room, name, PATIENCE_S)
    return folder


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        asked.bind(("127.0.0.1", 0))
        return int(asked.getsockname()[1])


def row_of(folder: Path, name: str) -> dict[str, Any]:
    raw = (folder / name).read_bytes()
    return {
        **{"file": name, "board": "micropython", "filter": "all", "version": "9.9.9"},
        **{"schema": SCHEMA, "bytes": len(raw)},
        "sha256": hashlib.sha256(raw).hexdigest(),
    }


@contextmanager
def board(
    folder: Path, machine: str = PICO_W, mpy: int = X64, **air: object
) -> Iterator[str]:
    """A board at its prompt; its port."""
    folder.mkdir(exist_ok=True)
    (folder / "air.json").write_text(json.dumps(AIR | air))
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    path = f"{folder}:{PROGRAMS / 'fake'}"
    process = subprocess.Popen(
        [STOCK, PROGRAMS / "prompt.py"],
        **{"stdin": ours, "stdout": ours, "cwd": folder},
        env={"MICROPYPATH": path, "BOARD_MACHINE": machine, "BOARD_MPY": str(mpy)},
    )
    try:
        yield os.ttyname(theirs)
    finally:
        process.kill()
        process.wait()
        os.close(ours)
        os.close(theirs)


def test_a_blank_board_greets_over_usb_and_is_written_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    files = tmp_path / "board"
    words = ["--board", "micropython"]
    with board(files) as port:
        assert cli.main(["flash", port, "--wifi", "home", "--dry-run"]) == 0
        assert "nothing was written" in capsys.readouterr().out
        assert not (files / "main.py").exists()
        assert cli.main(["flash", port, *words]) == 0
        said = capsys.readouterr().out
        monkeypatch.setattr(micropython, "PROMPT_S", 0.0)
        assert cli.main(["flash", port, *words]) == 1
        monkeypatch.setattr(micropython, "PROMPT_S", PATIENCE_S)
    assert "no prompt of MicroPython: if the board runs" in capsys.readouterr().err
    assert "Raspberry Pi Pico W, x64\n17 of 17 files copied and read back" in said
    assert "runs mpy 1.29 linux" in said
    assert (files / "imuprobe.mpy").read_bytes() == MODULE.read_bytes()
    start = "start(i2c=0, sda=4, scl=5, ready=6, button=15, led='LED')"
    assert start in (files / "main.py").read_text()
    (files / "probe" / "bus.py").write_text("damaged")
    (files / "main.py").write_text("import blink\n")
    with board(files) as port:
        assert cli.main(["flash", port, *words]) == 1
        assert "has a main.py that is not a probe's; save" in capsys.readouterr().err
        (files / "main.py").write_text(MINE)
        assert cli.main(["flash", port, *words]) == 0
    said = capsys.readouterr().out
    assert "its main.py, which starts a probe, stays" in said
    assert "1 of 16 files copied" in said
    assert (files / "main.py").read_text() == MINE


def test_a_blank_board_greets_over_the_air_in_one_command(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """As a person does it: MicroPython is on the board (1), this command (2), and the
    cable comes out (3).
    """
    monkeypatch.setattr("getpass.getpass", lambda _question: "secret")
    monkeypatch.setattr(flash_micropython, "EVERYWHERE", "127.0.0.1")
    monkeypatch.setattr(flash_micropython, "UDP_PORT", free_udp_port())
    (tmp_path / "imud.toml").write_text("[ports]  # of this desk\nrates = [500000]\n")
    with board(tmp_path / "board") as port:
        assert cli.main(["flash", port, "--wifi", "home"]) == 1
        assert "not opened, and nothing was written" in capsys.readouterr().err
        assert not (tmp_path / "board" / "main.py").exists()
        assert cli.main(["flash", port, "--wifi", "home", "--yes"]) == 0
        said = capsys.readouterr().out
    probe = re.search(r"(\w{16}) greets over the air, on udp:127.0.0.1:", said)
    assert probe is not None, said
    assert "who has it can read the password" in said
    assert "unplug it; it is a probe of: imud run --config imud.toml" in said
    assert "secret" not in said
    key = tmp_path / "state" / "imud" / "keys" / "probes" / f"{probe[1]}.key"
    assert (tmp_path / "board" / "probe.key").read_text() == key.read_text()
    told = json.loads((tmp_path / "board" / "wifi.json").read_text())
    assert told["host"] == "127.0.0.1"
    with board(tmp_path / "board") as port:
        assert cli.main(["flash", port, "--forget-wifi", "--dry-run"]) == 0
        assert (tmp_path / "board" / "wifi.json").exists()
        assert cli.main(["flash", port, "--forget-wifi"]) == 0
    assert not {*(tmp_path / "board").iterdir()} & {
        tmp_path / "board" / name for name in ("wifi.json", "probe.key")
    }


def test_a_daemon_lends_the_port_and_takes_it_back(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(micropython, "PROMPT_S", 0.0)
    files = tmp_path / "board"
    shutil.copytree(tmp_path / "firmware" / "probe", files / "probe")
    (files / micropython.MODULE).write_bytes(MODULE.read_bytes())
    (files / micropython.MAIN).write_text(micropython.boards()[0].main)
    with board(files) as port:
        with serial_port.opened(port, micropython.BAUD) as wire:
            wire.write(b"\x04")
        with DaemonProcess(port, directory=tmp_path, log=False) as daemon:
            found = re.search(r"probe (\w{16}) found", daemon.expect("found on"))
            assert found is not None
            words = ["--board", "micropython", "--connect", daemon.endpoint]
            assert cli.main(["flash", found[1], *words]) == 1
            assert "hold its button down while" in capsys.readouterr().err
            daemon.expect("found on|: open$")
            daemon.stop()


@contextmanager
def prompt_of(folder: Path, **how: Any) -> Iterator[Prompt]:
    with board(folder, **how) as port, serial_port.opened(port, 115_200) as wire:
        yield Prompt(wire)


@pytest.mark.parametrize(
    ("air", "name", "password", "says"),
    [
        ({}, "home", "sekret", "home refused the password; run it again"),
        ({}, "attic", "", "no network attic, but: caf\ufffd, guest, home. It has 2.4"),
        ({"seen": []}, "home", "", "sees no network home, but: caf\ufffd"),
        ({"seen": [ODD]}, ODD, ODD, "é中 refused the password; run"),
        ({"password": None}, "home", "", "sees home, but did not join it in 0 s"),
        ({}, "home", "secret", r"127.0.0.1, heard nothing .* open UDP port 9 in its"),
        (
            {"address": "198.18.0.7"},
            "home",
            "secret",
            "in the network 198.0.0.0/8, thi",
        ),
    ],
)
def test_each_failure_of_the_network_is_told_in_words(
    air: dict[str, Any],
    name: str,
    password: str,
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(wifi, "JOIN_S", 0)
    monkeypatch.setattr(wifi, "GREET_S", 0)
    here = IPv4Address("127.0.0.1")
    with prompt_of(tmp_path / "board", **air) as prompt:
        with pytest.raises(FlashError, match="file system is full; remove files"):
            prompt.ask("raise OSError(28)")
        package = {f"probe/{n}.py": b"" for n in ("__init__",)}
        udp = ROOT / "firmware" / "micropython" / "probe"
        names = ("plain_settings", "relay", "udp")
        package |= {f"probe/{n}.py": (udp / f"{n}.py").read_bytes() for n in names}
        prompt.put(package | {wifi.KEY: b"00" * 32}, lambda _done, _of: None)
        with pytest.raises(FlashError, match=says):
            wifi.greet(prompt, wifi.join(prompt, name, password), here, 9)


@pytest.mark.parametrize(
    ("machine", "mpy", "says"),
    [
        (PICO_W, 6 | 2 << 8 | 4 << 10, "MicroPython 1.25 on Raspberry .* is too old"),
        (PICO_W, 0, "is too old: get 1.25 or newer from https://micropython.org"),
        (PICO_W, 7 | 4 << 10, "newer than this imud: update imu-probe and"),
        ("ESP32 module with ESP32", 6 | 3 << 8 | 10 << 10, "no module for an Xtensa"),
        ("Other with RP2040", X64, "its pins are unknown, only those of Raspberry Pi"),
        ("ESP32C3 module with ESP32C3", 6 | 3 << 8 | 11 << 10, "rv32imc.mpy: get both"),
        ("Raspberry Pi Pico with RP2040", X64, "has no Wi-Fi; leave --wifi out"),
    ],
)
def test_a_board_with_nothing_for_it_is_refused_in_words(
    machine: str, mpy: int, says: str, tmp_path: Path
) -> None:
    with (
        prompt_of(tmp_path / "board", machine=machine, mpy=mpy) as prompt,
        pytest.raises(FlashError, match=says),
    ):
        micropython.files_for(prompt.board(needs_wifi=True), SCHEMA)


@pytest.mark.parametrize(
    ("name", "before", "after", "says"),
    [
        (
            "probe/loop.py",
            "def run",
            "def ran",
            "loop.py was modified: its SHA-256 is not",
        ),
        (
            "manifest.json",
            "probe/loop.py",
            "probe/loop",
            "has no probe/loop.py: get both again",
        ),
        ("manifest.json", SCHEMA, "0" * 8, "has schema 00000000, but"),
    ],
)
def test_forged_and_old_files_are_refused(
    name: str, before: str, after: str, says: str, firmware: Path
) -> None:
    path = firmware / name
    path.write_text(path.read_text().replace(before, after))
    board = msgspec.structs.replace(micropython.boards()[0], arch="x64")
    with pytest.raises(FlashError, match=says):
        micropython.files_for(board, SCHEMA)


def test_a_board_whose_button_is_held_at_start_is_at_its_prompt() -> None:
    code = "from probe.start import start; start(0, 4, 5, 6, 15); print('prompt')"
    path = f"{ROOT / 'firmware' / 'micropython'}:{PROGRAMS / 'fake'}"
    about = {"BOARD_MACHINE": "", "BOARD_MPY": "0", "BOARD_PINS": "0"}
    done = programs.ran(STOCK, "-c", code, env={"MICROPYPATH": path} | about)
    assert done.stdout == "prompt\n", done.stderr


@pytest.mark.parametrize("answer", ["5", "('Pico', (1,), 'x')", "(" * 9999, "{[]}"])
def test_a_board_that_answers_anything_is_told_in_words(
    answer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Prompt, "ask", lambda *_: answer)
    with pytest.raises(FlashError, match="the board answered"):
        Prompt.__new__(Prompt).board()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--board", "nano", "--wifi", "home"], "--board nano is for a board without"),
        (["--wifi", ""], "--wifi needs the name of a network"),
        (["--board", "micropython", "--image", "a.hex"], "not for micropython"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        cli.main(["flash", "/dev/null", *words])
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    "fault",
    [
        BrokenPipeError(),
        PermissionError(13, "no", "a.key"),
        UnicodeEncodeError("utf-8", "\udcff", 0, 1, "no"),
    ],
)
def test_a_fault_beside_the_port_is_not_blamed_on_it(fault: Exception) -> None:
    ours, theirs = os.openpty()
    with (
        pytest.raises(type(fault)),
        serial_port.opened(os.ttyname(theirs), 115_200),
    ):
        raise fault
    os.close(ours)
    os.close(theirs)


def test_a_password_that_is_not_typed_ends_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def ended(_question: str) -> str:
        raise EOFError

    monkeypatch.setattr("getpass.getpass", ended)
    monkeypatch.setattr(flash_micropython, "EVERYWHERE", "127.0.0.1")
    monkeypatch.setattr(flash_micropython, "UDP_PORT", free_udp_port())
    assert cli.main(["flash", "/dev/null", "--wifi", "home", "--yes"]) == 1
    assert "no password; the board was not changed" in capsys.readouterr().err


def test_the_guide_has_the_boards_and_their_pins(root: Path) -> None:
    guide = (root / "docs" / "micropython.md").read_text()
    for board in micropython.boards():
        pins = [board.pins.get(each, "") for each in PINS]
        wifi = "yes" if board.has_wifi else "no"
        cells = [board.name, *map(str, pins), board.arch, wifi, board.tried]
        assert f"| {' | '.join(cells)} |".replace("  ", " ") in guide


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", "[ports]\n{}"),
        ("twin = true\n", "twin = true\n\n[ports]\n{}"),
        ('[ports]\nfind = true\nudp = ""  # off\n', "[ports]\n{}find = true\n"),
        ("ports.find = true\n", "imud.toml"),
    ],
)
def test_the_port_is_added_to_the_daemons_file_or_nothing_changes(
    before: str, after: str, tmp_path: Path
) -> None:
    file, private = tmp_path / "imud.toml", tmp_path / "private.toml"
    file.symlink_to(private)
    file.write_text(before)
    file.chmod(0o600)
    if "{}" not in after:
        with pytest.raises(ConfigError, match=f"can't open it in .*{after}: add to"):
            flash_micropython.open_udp(file, tmp_path)
        after = before
    else:
        flash_micropython.open_udp(file, tmp_path)
    lines = f'udp = "0.0.0.0:8736"\nudp_keys = "{tmp_path}"\n'
    assert file.read_text() == after.format(lines)
    assert {*tmp_path.glob("*.toml*")} == {file, private}
    assert file.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o600
