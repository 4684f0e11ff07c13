# SPDX-License-Identifier: MIT
"""`imud check` of what the images send: a fault is named in its own line, and a healthy
board has none."""

from __future__ import annotations

import itertools
import json
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import serial

from fakes import PATIENCE_S, Forked
from imud import cli
from imud.cli import check_ports, check_run, check_source, check_turn
from imud.params.trusted import known_to
from imud.virtual import memory, modules, motion, turning
from imud.wire import messages
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message
from system.live import LiveProbe
from system.test_image import CLICK
from system.virtual import Stub, every_board, run

RATE_HZ = 1000
SECONDS = 12

# Fault, the rows that are not good, and words of the first one's advice. A row that
# only repeats another one's fault would send people to the wrong place.
FAULTS: dict[str, tuple[dict[str, Any], dict[str, str], str]] = {
    "no answer": (
        {"kind": "nack"},
        {"sensor bus": "fault"},
        "check power, SDA",
    ),
    "a loose wire": (
        {"kind": "nack", "at_us": 5_000_000, "for_us": 15_000},
        {"sensor bus": "look at this", "missed samples": "look at this"},
        "shorter wires",
    ),
    "a held line": (
        {"kind": "stuck_sda"},
        {"sensor bus": "fault"},
        "SDA or SCL is held low",
    ),
    "no data-ready": (
        {"kind": "no_data_ready", "at_us": 9_000_000},
        {"sensor bus": "fault"},
        "the sensor",
    ),
    "an unknown chip": (
        {"kind": "wrong_who_am_i", "value": 0xFF},
        {"sensor bus": "fault", "inertial chip": "fault"},
        "see the row: inertial chip",
    ),
    "a weak gyroscope": (
        {"kind": "gyr_self_test"},
        {"self-test gyroscope": "fault"},
        "broken or counterfeit",
    ),
    "a weak accelerometer": (
        {"kind": "acc_self_test"},
        {"self-test accelerometer": "fault"},
        "broken or counterfeit",
    ),
    "a chip that hung": (
        {"kind": "frozen", "at_us": 4_000_000},
        {"stuck axes": "fault"},
        "the chip has hung",
    ),
    "a weak supply": (
        {"kind": "brown_out", "at_us": 6_000_000},
        {"start": "fault"},
        "the supply drops out",
    ),
    "a reset": (
        {"kind": "reset", "at_us": 6_000_000},
        {"start": "look at this"},
        "reset was pressed",
    ),
    "nano: a clone": (
        {"kind": "wrong_who_am_i", "value": 0x75},
        {"inertial chip": "look at this"},
        "works like an MPU-9250",
    ),
    "nano: a register that changes": (
        {"kind": "register_flip", "at_us": 6_000_000, "reg": 0x1C, "value": 0},
        {"configuration": "fault", "missed samples": "look at this"},
        "a register lost its value",
    ),
    "f405: a register that changes": (
        {"kind": "register_flip", "at_us": 6_000_000, "reg": 0x23, "die": 1},
        {"configuration": "fault", "missed samples": "look at this"},
        "a register lost its value",
    ),
    "nano: a magnetometer that hung": (
        {"kind": "mag_hung"},
        {"magnetometer": "fault"},
        "does not answer: no heading",
    ),
    "nano: a magnetometer that hangs": (
        {"kind": "mag_hung", "at_us": 6_000_000, "clocks": 3},
        {"magnetometer": "fault", "sensor bus": "look at this"}
        | {"missed samples": "look at this"},
        "the magnetometer blocks its bus",
    ),
    "a sensor without power for a moment": (
        {"kind": "sensor_brown_out", "at_us": 6_000_000},
        {"sensor bus": "look at this", "missed samples": "look at this"},
        "the sensor signals no samples",
    ),
    "f405: no magnetometer": (
        {"kind": "no_mag"},
        {"self-test magnetometer": "fault", "magnetometer": "fault"},
        "own stimulus",
    ),
    "f405: no crystal": (
        {"kind": "crystal"},
        {"clock": "fault"},
        "the crystal does not run",
    ),
}
CASES = [
    pytest.param(board, name, id=f"{board} {name}")
    for board in ("nano", "f405")
    for name in FAULTS
    if ":" not in name or name.startswith(f"{board}:")
]


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board that a busy machine holds up is waited for."""
    for module, names in (
        (check_ports, ("START_S", "PROBE_S", "WARNED_S")),
        (check_source, ("PARAMS_S", "SILENT_S")),
        (check_turn, ("LATE_S",)),
    ):
        for name in names:
            monkeypatch.setattr(module, name, PATIENCE_S)


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The motion of a module from the shop that lies base down, for an emulator."""
    count = (SECONDS + 2) * RATE_HZ
    still = motion.Motion(
        float(RATE_HZ),
        gyr=np.zeros((count, 3)),
        acc=np.tile([0.0, 0.0, 9.80665], (count, 1)),
        mag=np.tile([0.0, 20.0, -44.0], (count, 1)),
        is_recorded=False,
    )
    felt = modules.named("shop", 4).measures(still, np.random.default_rng(1))
    path = tmp_path_factory.mktemp("table") / "still"
    with path.open("wb") as file:
        motion.write_stream(file, [felt], count=count)
    return path


def checked(
    stub: Stub,
    table: Path,
    capsys: pytest.CaptureFixture[str],
    *faults: dict[str, Any],
) -> tuple[int, dict[str, Any]]:
    """The exit code and the report of what the image sends at rest."""
    options = ("--motion", table, *CLICK, *stub.raw_too)
    done = run(stub, SECONDS, *options, faults=faults)
    code = cli.main(["check", "--from", str(done.record), "--json"])
    report: dict[str, Any] = json.loads(capsys.readouterr().out)
    return code, report


def troubles(report: dict[str, Any]) -> dict[str, str]:
    """The rows that are neither good nor left out."""
    return {
        row["name"]: row["verdict"]
        for row in report["rows"]
        if row["verdict"] not in ("good", "not judged")
    }


@every_board
def test_a_healthy_board_is_good(
    stub: Stub, table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, report = checked(stub, table, capsys)
    assert (code, troubles(report)) == (0, {})
    left_out = {row["name"] for row in report["rows"] if row["verdict"] == "not judged"}
    assert left_out == {"clock"}  # a capture has no times of a host


@pytest.mark.parametrize("stub", ["nano"], indirect=True)
def test_a_dead_magnetometer_is_named(
    stub: Stub, table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, report = checked(stub, table, capsys, {"kind": "no_ak8963"})
    assert (code, troubles(report)) == (1, {"magnetometer": "fault"})
    (row,) = (row for row in report["rows"] if row["name"] == "magnetometer")
    assert "MPU-9250 does not answer: no heading" in row["advice"]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("stub", "name"), CASES, indirect=["stub"])
def test_a_fault_is_named_in_its_own_line(
    stub: Stub, table: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    fault, expected, words = FAULTS[name]
    code, report = checked(stub, table, capsys, fault)
    assert troubles(report) == expected
    assert code == (1 if "fault" in expected.values() else 0)
    rows = {row["name"]: row for row in report["rows"]}
    assert words in rows[next(iter(expected))]["advice"]


@pytest.mark.parametrize("stub", ["nano"], indirect=True)
def test_a_port_is_checked_without_a_daemon(
    stub: Stub,
    table: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # It measures for seconds of the emulator, which a busy machine holds up.
    now = stub.folder / "now"
    probe = LiveProbe(stub, "--motion", table, "--now", now)
    clock = SimpleNamespace(
        monotonic=lambda: int.from_bytes(now.read_bytes(), sys.byteorder) * 1e-9
    )
    monkeypatch.setattr(check_run, "time", clock)
    path = stub.folder / "board"
    words = ["check", str(probe.port), "--seconds", "5", "--no-poses", "--no-button"]
    code = cli.main([*words, "--report", str(path)])
    told = capsys.readouterr().out
    summary = probe.end()
    report = json.loads(path.with_suffix(".json").read_text())
    markdown = path.with_suffix(".md").read_text()
    rows = {row["name"]: row for row in report["rows"]}
    # What a busy machine may spoil aside, all that was tried is good.
    of_the_host = {"latency", "messages lost", "clock"}
    others = {row["verdict"] for name, row in rows.items() if name not in of_the_host}
    assert others == {"good", "not judged"}, told
    assert code == any(rows[name]["verdict"] == "fault" for name in of_the_host)
    assert "not judged: button, LED; " in told, told
    if rows["clock"]["verdict"] == "good":
        assert rows["clock"]["numbers"]["bound_ppm"] < 5000
    assert rows["port"]["measured"] == "a pty: a virtual probe"
    assert summary["seconds"] > 5
    for text in (markdown, json.dumps(report)):
        assert str(stub.folder) not in text
    assert report["counters"]["state"] == "streaming"


@pytest.mark.parametrize("stub", ["nano"], indirect=True)
@pytest.mark.parametrize(
    ("turn_deg", "verdict", "words"),
    [
        ("30", "good", ""),
        pytest.param(
            "20", "fault", "laid against the stops?", marks=pytest.mark.nightly
        ),
    ],
)
def test_a_known_turn_is_judged(
    stub: Stub,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    turn_deg: str,
    verdict: str,
    words: str,
) -> None:
    eeprom = tmp_path / "eeprom"
    known = known_to(0.007, 0.1, gyr=0.001)
    memory.memory_with(stub.image, stub.simulator, known, eeprom)
    pieces = turning.pieces("turn", modules.calibrated(), 3, RATE_HZ)
    felt = motion.join(list(itertools.islice(pieces, 16)))
    path = tmp_path / "turning"
    with path.open("wb") as file:
        motion.write_stream(file, [felt], count=len(felt))
    probe = LiveProbe(stub, "--motion", path, "--eeprom", eeprom)
    code = cli.main(["check", str(probe.port), "--json", "--turn", turn_deg])
    told = capsys.readouterr()
    probe.end()
    assert told.out, told.err
    report = json.loads(told.out)
    assert (code, report["verdict"]) == (int(verdict == "fault"), verdict), report
    assert words in report["rows"][0]["advice"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("stub", ["nano"], indirect=True)
@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_one_that_is_ended_early_leaves_the_board_idle_and_the_port_free(
    stub: Stub, table: Path, by: signal.Signals
) -> None:
    probe = LiveProbe(stub, "--motion", table)
    words = ("-m", "imud", "check", probe.port)
    with Forked(*words, stdout=subprocess.PIPE) as check:
        assert "Lay it base down" in check.stdout.readline()
        check.send_signal(by)
        assert check.wait(PATIENCE_S) == 130
    with serial.Serial(str(probe.port), timeout=PATIENCE_S, exclusive=True) as port:
        decoder = FrameDecoder()
        states: list[Any] = []
        while not states:
            contents = decoder.feed(port.read_until(b"\0"))
            found = [messages.decode(content) for content in contents]
            states += [
                message.fields["state"]
                for message in found
                if isinstance(message, Message) and message.name == "status"
            ]
    probe.end()
    assert states == ["idle"]
