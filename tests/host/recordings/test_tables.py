# SPDX-License-Identifier: MIT
"""The contents of a log: as a summary, as tables."""

from __future__ import annotations

import csv
import io
import json
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet

from imud import cli
from imud.probes.record import Record
from imud.rotation import from_heading_pitch_roll
from log_files import PERIOD_NS, records, write

EPOCH = datetime.fromtimestamp(0, UTC)


def test_info_tells_probes_times_rates_and_losses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put = records(101)
    del put[50:53]
    path = write(tmp_path, put)
    assert cli.main(["info", str(path), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert info["is_whole"]
    assert (info["end_ns"] - info["begin_ns"]) == 100 * PERIOD_NS
    (probe,) = info["probes"]
    assert (probe["probe"], probe["firmware"]) == ("left", "0.1.0+fake")
    assert (probe["received"], probe["lost"]) == (98, 3)
    assert probe["topics"]["frame"] == {
        "messages": 98,
        "rate_hz": pytest.approx(97.0),
    }
    assert cli.main(["info", str(path)]) == 0
    text = capsys.readouterr().out
    assert "101 sent = 98 received + 0 skewed + 3 lost" in text
    assert "whole" in text
    path.write_bytes(path.read_bytes()[:-30])
    assert cli.main(["info", str(path)]) == 0
    assert "truncated (imud recover saves the intact part)" in capsys.readouterr().out


def test_csv_holds_each_value_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put = records(50)
    path = write(tmp_path, put)
    out = tmp_path / "tables"
    assert cli.main(["export", str(path), "--to", "csv", "--out", str(out)]) == 0
    output = capsys.readouterr().out
    for topic in ("pose", "raw", "event"):
        file = out / f"{path.stem}-left-{topic}.csv"
        wanted = [record.values for record in put if record.topic == topic]
        assert f"{file}: {len(wanted)} rows" in output
        rows = list(csv.DictReader(io.StringIO(file.read_text("utf-8"))))
        assert len(rows) == len(wanted)
        for row, record in zip(rows, wanted, strict=True):
            assert int(row["t_ns"]) == record["t_ns"]
            assert int(row["seq"]) == record["seq"]
            since = datetime.fromisoformat(row["time_utc"]) - EPOCH
            assert since // timedelta(microseconds=1) == record["t_ns"] // 1000
            if topic == "pose":
                angles = [float(row[f"{n}_deg"]) for n in ("yaw", "pitch", "roll")]
                turned = from_heading_pitch_roll(*np.radians(angles))
                assert abs(turned @ np.array(record["q"])) == pytest.approx(1)
                assert [float(row[f"q_{n}"]) for n in "wxyz"] == list(record["q"])
                assert (row["position_x_m"], row["flags"]) == ("", "at_rest")
    assert cli.main(["export", str(path), "--to", "csv", "--out", str(out)]) == 1
    assert "already exists" in capsys.readouterr().err


def test_parquet_holds_the_same_with_types(tmp_path: Path) -> None:
    path = write(tmp_path, records(50))
    assert cli.main(["export", str(path), "--to", "parquet"]) == 0
    assert cli.main(["export", str(path), "--to", "csv"]) == 0
    for topic in ("pose", "raw", "event"):
        table = parquet.read_table(tmp_path / f"{path.stem}-left-{topic}.parquet")
        file = tmp_path / f"{path.stem}-left-{topic}.csv"
        rows = list(csv.DictReader(io.StringIO(file.read_text("utf-8"))))
        assert table.column_names == list(rows[0])
        assert str(table.schema.field("t_ns").type) == "int64"
        for row, typed in zip(rows, table.to_pylist(), strict=True):
            text = {k: "" if v is None else str(v) for k, v in typed.items()}
            assert text == row


def test_several_logs_and_what_the_daemon_says_of_probes_become_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head = {"probe": "left", "t_ns": 7}
    status = {
        "type": "status",
        **head,
        "state": "streaming",
        "pose_rate_hz": 99.5,
        "ledger": {"sent": 12, "lost": 1},
        "clock": {"offset_ns": 1 << 60, "skew_ppm": -3.5},
        "log": {"state": "on"},
    }
    twin = {"type": "twin", **head, "state": "differs", "compared": 5, "differed": 1}
    log = {"type": "log", **head, "state": "paused", "reason": "full", "dropped": 2}
    clock = {"type": "clock", **head, "step_ns": -4, "timeline": 1, "reason": "set"}
    far, back = [0.1, 0.0, 0.0], [0.01, 0.0, 0.0]
    closed = {"path_m": [far, back], "closed_m": None, "closed_sigma_m": None}
    ways = {"type": "path", **head, "by": "button", "strokes": 2, "off_m": back}
    put = [
        Record("left", str(each["type"]), json.dumps(each).encode(), b"", 0, 7, 7)
        for each in (status, twin, log, clock, ways | closed)
    ]
    whole = write(tmp_path / "a", put)
    cut = write(tmp_path / "b", records(40), records(40))
    cut.write_bytes(cut.read_bytes()[:-30])
    none = tmp_path / "none.mcap"
    cut = cut.rename(tmp_path / "b" / "cut.mcap")
    out = tmp_path / "out"
    words = ["export", str(whole), str(none), str(cut), "--out", str(out)]
    for kind in ("csv", "parquet"):
        assert cli.main([*words, "--to", kind]) == 1
        captured = capsys.readouterr()
        assert captured.err.splitlines() == [
            f"imud: can't read {none}: No such file or directory",
        ]
        assert f"{out / f'cut-left-pose.{kind}'}: 62 rows" in captured.out
    rows = parquet.read_table(out / f"{whole.stem}-left-path.parquet").to_pylist()
    assert [row["stroke"] for row in rows] == [1, 2]
    assert [row["path_x_m"] for row in rows] == [0.1, 0.01]
    assert {(row["closed_x_m"], row["off_x_m"]) for row in rows} == {(None, 0.01)}
    (row,) = parquet.read_table(out / f"{whole.stem}-left-status.parquet").to_pylist()
    assert (row["t_ns"], row["state"], row["pose_rate_hz"]) == (7, "streaming", 99.5)
    assert (row["ledger_sent"], row["ledger_lost"]) == (12, 1)
    assert (row["clock_offset_ns"], row["clock_skew_ppm"]) == (1 << 60, -3.5)
    assert (row["log_state"], row["twin_state"], row["port"]) == ("on", None, None)
    for topic, line in (
        ("twin", "7,,,differs,5,1"),
        ("log", "7,paused,full,2"),
        ("clock", "7,-4,1,set"),
    ):
        file = out / f"{whole.stem}-left-{topic}.csv"
        assert file.read_text("utf-8").splitlines()[1:] == [line]


def test_without_pyarrow_parquet_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    path = write(tmp_path, records(3))
    assert cli.main(["export", str(path), "--to", "parquet"]) == 1
    assert "pip install 'imu-probe[parquet]'" in capsys.readouterr().err
