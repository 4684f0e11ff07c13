# SPDX-License-Identifier: MIT
"""`imud check` with a daemon and a fake probe, and where there is nothing to check."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from chain import Chain
from fakes import FakeProbe, free_endpoint
from imud.calibration.poses import BASE_DOWN
from imud.cli import check_ports, check_run, check_source, main, reached
from imud.ports import local
from ports_desk import Device
from raw_probe import Stream, capture, lying


@pytest.fixture
def chain(bench: Chain, monkeypatch: pytest.MonkeyPatch) -> Chain:
    monkeypatch.setattr(check_source, "HEARD_S", 0.3)
    bench.probe.commands.clear()
    return bench


@pytest.fixture
def nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """No daemon is at the default endpoint."""
    monkeypatch.setattr(reached, "ENDPOINT", free_endpoint())


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Its one line on stderr."""
    assert main(["check", *words]) == 1
    error = capsys.readouterr().err
    assert error.startswith("imud: ")
    assert error.count("\n") == 1
    return error


def has_serial_ports(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    found = [Device(name, location=name) for name in names]
    monkeypatch.setattr(local.list_ports, "comports", lambda: found)


def test_a_probe_of_a_daemon_is_checked_and_does_as_before(
    chain: Chain, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    words = ["--connect", chain.daemon.endpoint, "--seconds", "1.5"]
    words += ["--no-poses", "--no-button", "--report", str(tmp_path / "board.md")]
    with Stream(chain, lying([BASE_DOWN.up] * 4), asks="start"):
        main(["check", chain.probe.name, *words])
    captured = capsys.readouterr()
    assert captured.err == ""
    assert "(by imud run)" in captured.out
    assert "samples, no failed transfers" in captured.out
    report = (tmp_path / "board.md").read_text()
    assert chain.probe.name not in report
    assert str(chain.port.path) not in report
    asked = [
        (each["command"], each["arguments"])
        for each in chain.probe.commands
        if each["command"] not in ("time", "params_tell")
    ]
    assert asked == [
        *(("fields", (3, 0)), ("start", (0, 0))),
        *(("fields", (1, 0)), ("stop", (0, 0))),
    ]


def test_the_port_of_a_daemon_is_checked_by_it(
    chain: Chain,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(check_run, "DEAD_S", 0.5)
    words = ["--connect", chain.daemon.endpoint, "--seconds", "0.5", "--json"]
    with Stream(chain, ()):
        main(["check", str(chain.port.path), *words])
    report: dict[str, Any] = json.loads(capsys.readouterr().out)
    rows = {row["name"]: row for row in report["rows"]}
    assert rows["sensor bus"]["measured"] == "no samples"


def test_a_probe_that_is_not_there_is_one_line_with_those_that_are(
    chain: Chain,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(reached, "FIRST_S", 0.2)
    line = refused(capsys, "stylus", "--connect", chain.daemon.endpoint)
    assert f"no probe stylus; choose one: {chain.probe.name}" in line


@pytest.mark.usefixtures("nobody")
def test_a_name_without_a_daemon_asks_for_the_port(
    capsys: pytest.CaptureFixture[str],
) -> None:
    endpoint = reached.ENDPOINT
    line = refused(capsys, "stylus", "--connect", endpoint)
    assert "give its port instead: imud check /dev/ttyUSB0" in line


@pytest.mark.usefixtures("nobody")
@pytest.mark.parametrize(
    ("ports", "words"),
    [
        ((), "no USB serial port; plug the board in"),
        (("/dev/ttyUSB3", "/dev/ttyACM1"), "name one: /dev/ttyACM1, /dev/ttyUSB3"),
        (("/dev/ttyUSB3",), "may be another program's; if it is the board's: imud "),
    ],
)
def test_without_a_name_exactly_one_known_port_is_needed(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    ports: tuple[str, ...],
    words: str,
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    has_serial_ports(monkeypatch, *ports)
    assert words in refused(capsys, "--connect", reached.ENDPOINT)


@pytest.mark.usefixtures("nobody")
def test_a_port_that_is_not_there_or_none_at_all_is_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = ("--connect", reached.ENDPOINT)
    line = refused(capsys, str(tmp_path / "ttyUSB0"), *where)
    assert "does not exist; plug the board in" in line
    monkeypatch.setattr(check_ports, "WARNED_S", 0.0)
    file = tmp_path / "file"
    file.write_text("no port\n")
    assert "check that it is a serial port" in refused(capsys, str(file), *where)


@pytest.mark.usefixtures("nobody")
def test_a_port_without_a_probe_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check_ports, "PROBE_S", 1.0)
    ours, theirs = os.openpty()
    try:
        line = refused(capsys, os.ttyname(theirs), "--connect", reached.ENDPOINT)
    finally:
        os.close(ours)
        os.close(theirs)
    assert "check that it is flashed (docs/flash.md)" in line


def test_a_file_is_checked_and_one_without_a_probe_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = capture(tmp_path / "a.bin", FakeProbe(), lying([BASE_DOWN.up] * 4))
    main(["check", "--from", str(path)])
    assert "verdict: " in capsys.readouterr().out
    (tmp_path / "b.bin").write_bytes(b"\0" * 40)
    line = refused(capsys, "--from", str(tmp_path / "b.bin"))
    assert "has no messages of a probe" in line
    line = refused(capsys, "other", "--from", str(path))
    assert "has no data of probe other, only of" in line


def test_a_report_goes_where_it_can(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = capture(tmp_path / "a.bin", FakeProbe(), lying([BASE_DOWN.up] * 4))
    line = refused(
        capsys, "--from", str(path), "--report", str(tmp_path / "none" / "a.json")
    )
    assert "can't write" in line
    with pytest.raises(SystemExit):
        main(["check", "--report", "board.txt"])
    assert "ends in .md or .json, not board.txt" in capsys.readouterr().err
