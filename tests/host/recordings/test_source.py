# SPDX-License-Identifier: MIT
"""Captures and stdin, wherever a log is read."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from fakes import FakeProbe
from imud import cli
from imud.wire.frame import FrameDecoder
from log_files import records, replaying, write


def capture(path: Path) -> tuple[Path, FakeProbe]:
    probe = FakeProbe()
    data = b"".join(probe.say("raw") + probe.say("pose") for _ in range(50))
    path.write_bytes(b"\0" + probe.say("hello") + data)
    return path, probe


def feed(monkeypatch: pytest.MonkeyPatch, data: bytes) -> None:
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(data)))


def test_a_capture_is_summarised_in_the_probes_own_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, probe = capture(tmp_path / "uart.bin")
    assert cli.main(["info", str(file)]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{file}: ")
    assert "0.0 to 0.5 s of the probe's own time, 0.5 s" in said
    assert f"probe {probe.name}: nano" in said
    assert "101 sent = 101 received + 0 skewed + 0 lost" in said
    feed(monkeypatch, file.read_bytes())
    assert cli.main(["info", "-", "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert (info["log"], info["probes"][0]["received"]) == ("-", 101)


def test_a_capture_becomes_tables_beside_it(tmp_path: Path) -> None:
    file, probe = capture(tmp_path / "uart.bin")
    assert cli.main(["export", str(file)]) == 0
    table = tmp_path / f"uart-{probe.name}-pose.csv"
    rows = list(csv.DictReader(io.StringIO(table.read_text("utf-8"))))
    assert len(rows) == 50
    assert int(rows[0]["t_ns"]) == 1000 * int(rows[0]["t_device_us"])


def test_a_capture_is_played_as_it_was_said(tmp_path: Path) -> None:
    file, _ = capture(tmp_path / "uart.bin")
    link = tmp_path / "probe"
    found = b""
    with replaying(file, link), link.open("rb", buffering=0) as port:
        while found.count(0) < 101:
            found += port.read(4096)
    decoder = FrameDecoder()
    assert FrameDecoder().feed(found) == decoder.feed(file.read_bytes())


@pytest.mark.parametrize("is_log", [True, False])
def test_stdin_is_decoded_and_exported_like_a_file(
    *,
    is_log: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = write(tmp_path, records(60)) if is_log else capture(tmp_path / "a.bin")[0]
    assert cli.main(["decode", str(file), "--json"]) == 0
    expected = capsys.readouterr().out
    feed(monkeypatch, file.read_bytes())
    assert cli.main(["decode", "-", "--json"]) == 0
    assert capsys.readouterr().out == expected
    feed(monkeypatch, file.read_bytes())
    out = tmp_path / "tables"
    assert cli.main(["export", "-", "--out", str(out)]) == 0
    assert any(path.name.startswith("stdin-") for path in out.iterdir())


@pytest.mark.parametrize("command", ["info", "export", "replay"])
def test_a_capture_of_nothing_is_refused_on_one_line(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "silence.bin"
    file.write_bytes(bytes(1000))
    assert cli.main([command, str(file)]) == 1
    assert capsys.readouterr().err == (
        f"imud: {file} is neither a log nor a capture with messages of a probe\n"
    )
