# SPDX-License-Identifier: MIT
"""`imud sim`: finds what it runs, feeds it, and repeats what it prints."""

from __future__ import annotations

import argparse
import itertools
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imud import cli
from imud.errors import FileError
from imud.virtual import boards, motion, sensors, sim
from imud.wire import messages
from imud.wire.frame import FrameDecoder

PYTHON = sys.executable

# A substitute for the emulator: prints its arguments, and how much motion it received.
ECHO = """
import json, sys
data = sys.stdin.buffer.read()
print(json.dumps([sys.argv[1:], len(data), data[:24].hex()]), file=sys.stderr)
sys.exit(3)
"""
# Never reads its motion and runs until it is asked to stop.
STUBBORN = """
import os, signal, sys
def end(*_):
    os.write(2, b"summary in words\\n")
    sys.exit(0)
signal.signal(signal.SIGTERM, end)
os.write(2, b"ready /tmp/some-link\\n")  # at once: a signal may come amid a print
while True:
    signal.pause()
"""


def parse(*words: object, board: str = "nano") -> argparse.Namespace:
    return cli.build_parser().parse_args(["sim", board, *map(str, words)])


@pytest.fixture
def stand_in(tmp_path: Path) -> Any:
    """Makes an emulator from a script, and the options that choose it."""

    def make(script: str) -> list[str]:
        program = tmp_path / "nano"
        program.write_text(f"#!{PYTHON}\n{script}")
        program.chmod(0o755)
        image = tmp_path / "firmware.elf"
        image.write_bytes(b"")
        return ["--simulator", str(program), "--image", str(image)]

    return make


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "hand.npz"
    sensors.generate(1.0, seed=1).save(path)
    return path


def test_a_build_is_found_from_any_folder_below(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = tmp_path / boards.NANO.simulator
    built.parent.mkdir(parents=True)
    built.write_bytes(b"")
    below = tmp_path / "a" / "b"
    below.mkdir(parents=True)
    monkeypatch.chdir(below)
    monkeypatch.delenv("IMUD_SIM", raising=False)
    assert boards.NANO.find_simulator() == built


def test_a_build_is_found_beside_the_virtual_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = tmp_path / "project" / boards.NANO.image
    built.parent.mkdir(parents=True)
    built.write_bytes(b"")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.delenv("IMUD_IMAGE", raising=False)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "project" / ".venv"))
    assert boards.NANO.find_image() == built


def test_an_option_goes_before_the_environment_and_that_before_the_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, named, built = (tmp_path / name for name in ("given", "named", "built"))
    for path in (given, named, built):
        path.write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IMUD_SIM", str(named))
    package = ("imu_probe_none", "nano")
    assert boards.find(given, "IMUD_SIM", Path("built"), *package) == given
    assert boards.find(None, "IMUD_SIM", Path("built"), *package) == named
    monkeypatch.setenv("IMUD_SIM", "")
    assert boards.find(None, "IMUD_SIM", Path("built"), *package) == built


def test_without_a_checkout_the_packages_have_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / ".venv"))
    monkeypatch.setattr(boards.checkout, "is_checkout", lambda: False)
    for variable in ("IMUD_SIM", "IMUD_IMAGE"):
        monkeypatch.delenv(variable, raising=False)
    with pytest.raises(FileError, match=r"pip install 'imu-probe\[sim\]'"):
        boards.NANO.find_simulator()
    monkeypatch.syspath_prepend(str(tmp_path))
    for package, name in (("sim", "nano"), ("firmware", "nano-fuse.elf")):
        folder = tmp_path / f"imu_probe_{package}"
        folder.mkdir()
        (folder / "__init__.py").touch()
        (folder / name).touch()
    assert boards.NANO.find_simulator() == tmp_path / "imu_probe_sim" / "nano"
    image = tmp_path / "imu_probe_firmware" / "nano-fuse.elf"
    assert boards.NANO.find_image() == image
    with pytest.raises(FileError, match="make firmware BOARD=pico"):
        boards.PICO.find_image()


def test_what_is_missing_is_said_in_one_line_with_what_to_do(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / ".venv"))
    monkeypatch.delenv("IMUD_SIM", raising=False)
    assert cli.main(["sim", "nano"]) == 1
    error = capsys.readouterr().err
    assert error == "imud: build/sim/nano is not built yet; run `make firmware sim`\n"


def test_a_named_file_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(
        FileError, match=r"none does not exist; run `make firmware sim`"
    ):
        boards.NANO.find_simulator(tmp_path / "none")


# Arguments.


NO_SENSE = [
    ["--record", "a.bin"],
    ["--record", "a.bin", "--link", "b", "--seconds", "1"],
    ["--seconds", "0"],
    ["--seconds", "inf"],
    ["--seconds", "soon"],
    ["--rate", "0"],
    ["--rate", "381"],
    ["--seed", "-1"],
    ["--save-motion", "a.npz"],
    ["--save-motion", "a.npz", "--seconds", "1", "--motion", "b.npz"],
    ["--faster"],
    ["--hand", "nobody"],
    ["--hand", "calibrate", "--motion", "a.npz"],
    ["--module", "shop", "--save-motion", "a.npz", "--seconds", "1"],
]
# Of what a board does not have.
NOT_THERE = [
    ("nano", ["--rate", "201"]),
    ("nano", ["--card", "card.img"]),
    ("nano", ["--battery", "3700"]),
    ("f405", ["--battery", "5001"]),
    ("f405", ["--battery", "-1"]),
]


@pytest.mark.parametrize(
    ("board", "words"), [*itertools.product(boards.BOARDS, NO_SENSE), *NOT_THERE]
)
def test_arguments_that_make_no_sense_are_usage_errors(
    board: str, words: list[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(["sim", board, *words])
    assert end.value.code == 2


def test_each_board_has_a_port_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/1000")
    links = [str(sim.default_link(board)) for board in boards.BOARDS.values()]
    names = ("nano", "f405", "pico", "mega")
    assert links == [f"/run/user/1000/imud-{name}" for name in names]


def test_a_port_is_seen_while_its_virtual_probe_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    link, port = sim.default_link(boards.NANO), tmp_path / "pts"
    link.symlink_to(port)
    port.touch()
    with sim.held(link):
        assert [*sim.running_links()] == [link]
        port.unlink()  # not made yet
        assert [*sim.running_links()] == []
        port.touch()
        with monkeypatch.context() as patch:
            patch.setattr("os.getuid", lambda: -1)  # another user's
            assert [*sim.running_links()] == []
    assert [*sim.running_links()] == []
    (tmp_path / "imud-nano.lock").touch()  # of one that was killed
    assert [*sim.running_links()] == []


def test_a_bad_recording_is_one_line(
    tmp_path: Path, stand_in: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.csv"
    path.write_text("t_s\n0\n")
    words = ["sim", "nano", *stand_in(ECHO), "--motion", str(path)]
    assert cli.main(words) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"imud: {path}:1: no column gyr_x_rad_s,")
    assert error.count("\n") == 1


def test_a_module_that_is_none_is_one_line(
    stand_in: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["sim", "nano", *stand_in(ECHO), "--module", "best"]) == 1
    error = capsys.readouterr().err
    assert "no module best: use shop" in error
    assert error.count("\n") == 1


def test_options_become_the_emulators(stand_in: Any, tmp_path: Path) -> None:
    words = stand_in(ECHO)
    args = parse(
        *words,
        *("--seconds", "2.5", "--faults", "f.json", "--eeprom", "e.bin"),
        *("--summary", "s.json", "--seed", "7", "--fast", "--stream"),
    )
    assert sim.command_line(args, Path("link")) == [
        str(tmp_path / "nano"),
        *("--image", str(tmp_path / "firmware.elf")),
        *("--motion", "-", "--seed", "7", "--pty", "link"),
        *("--seconds", "2.5", "--faults", "f.json", "--eeprom", "e.bin"),
        *("--summary", "s.json", "--fast", "--press", "200000:500000"),
    ]


def test_card_radio_and_battery_go_to_the_board_that_has_them(
    stand_in: Any, tmp_path: Path
) -> None:
    own = ["--card", "card.img", "--radio", "rn41.json", "--battery", "3700"]
    args = parse(*stand_in(ECHO), *own, board="f405")
    assert sim.command_line(args, Path("link")) == [
        str(tmp_path / "nano"),
        *("--image", str(tmp_path / "firmware.elf")),
        *("--motion", "-", "--seed", "1", "--pty", "link", *own),
    ]


def sent(*words: str, board: str = "nano") -> list[messages.Message]:
    args = parse(*words, board=board)
    frames = sim.commands_us(args.board, wants_raw=args.raw, rate_hz=args.rate)
    decoder = FrameDecoder()
    decoded = []
    for at_us, frame in frames:
        assert at_us >= sim.PRESS_US[1]
        decoded += [messages.decode(content) for content in decoder.feed(frame)]
    assert all(isinstance(message, messages.Message) for message in decoded)
    return [each for each in decoded if isinstance(each, messages.Message)]


def test_raw_and_rate_are_commands_as_the_firmware_reads_them() -> None:
    raw_rate, fields, pose_rate = sent("--raw", "--rate", "50")
    assert raw_rate.fields == {"command": "rate", "token": 1, "arguments": (1, 200)}
    assert fields.fields == {"command": "fields", "token": 2, "arguments": (3, 0)}
    assert pose_rate.fields == {"command": "rate", "token": 3, "arguments": (0, 50)}
    assert [each.sequence for each in (raw_rate, fields, pose_rate)] == [0, 1, 2]
    assert sent() == []
    (raw_rate, _) = sent("--raw", board="f405")
    assert raw_rate.fields["arguments"] == (1, 380)


def test_motion_goes_in_words_come_out_and_the_exit_code_is_passed_on(
    stand_in: Any, recording: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    words = ["--motion", str(recording), "--record", "a.bin"]
    assert cli.main(["sim", "nano", *stand_in(ECHO), *words]) == 3
    arguments, length, header = json.loads(capfd.readouterr().err)
    assert arguments[2:4] == ["--motion", "-"]
    assert length == 32 + 1000 * 36
    assert bytes.fromhex(header)[:8] == motion.STREAM_MAGIC


def test_the_hand_is_saved_as_it_is_felt(
    stand_in: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "kept.npz"
    words = ["--seconds", "2", "--seed", "5", "--save-motion", str(path)]
    assert cli.main(["sim", "nano", *stand_in(ECHO), *words]) == 3
    _, length, _ = json.loads(capfd.readouterr().err)
    kept = motion.load(path)
    assert length == 32 + len(kept) * 36
    assert np.allclose(kept.gyr, sensors.generate(2.0, seed=5).gyr, atol=1e-6)
    assert kept.quat is not None


@pytest.fixture
def running(stand_in: Any) -> Iterator[subprocess.Popen[str]]:
    """`imud sim nano` over an emulator that continues until it is asked to stop."""
    words = [PYTHON, "-m", "imud", "sim", "nano", *stand_in(STUBBORN)]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_the_summary(
    running: subprocess.Popen[str], number: signal.Signals
) -> None:
    ready = running.stderr.readline()
    assert ready == ("ready /tmp/some-link (imud run /tmp/some-link; Ctrl-C ends it)\n")
    running.send_signal(number)
    assert running.stderr.read() == "summary in words\n"
    assert running.wait() == 0


def test_a_second_virtual_probe_does_not_take_the_port_of_the_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link = tmp_path / "probe"
    with sim.held(link):
        assert cli.main(["sim", "nano", "--link", str(link), "--seconds", "1"]) == 1
        assert capsys.readouterr().err == (
            f"imud: {link} is the port of another virtual probe; pass --link {link}-2 "
            "--seed 2 for a further one with its own id\n"
        )
        with sim.held(tmp_path / "other"):
            pass
    with sim.held(link):  # it is free again
        pass
    assert [*tmp_path.iterdir()] == []
