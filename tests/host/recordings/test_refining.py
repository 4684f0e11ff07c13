# SPDX-License-Identifier: MIT
"""`imud refine` and `imud audit`: poses afterwards, beside those on line."""

from __future__ import annotations

import csv
import json
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from host.refine.made import RATE_HZ, made, off_deg
from host.refine.test_strokes import END, stroked
from imud import cli, rotation
from imud.errors import ConfigError, FileError
from imud.log.copy import copy_good
from imud.log.file import Channels
from imud.log.reader import Logged, salvage
from imud.log.writer import LogWriter
from imud.params.file import read
from imud.params.value import Params
from imud.probes.record import Record
from imud.recordings import audit, audit_page, refining, source
from imud.recordings.raw_samples import Stretch, stretches_of
from imud.recordings.refining import Refined
from imud.refine.model import CALIBRATED, Recording
from imud.refine.whole import parts_of
from imud.rotation import FloatArray

Said = pytest.CaptureFixture[str]
HELLO: dict[str, Any] = {"firmware": "1", "sensor": "mpu9250", "sample_rate": RATE_HZ}


def log_of(recording: Recording, path: Path) -> Path:
    """The samples as a log."""
    table = path.with_suffix(".npz")
    times_s = np.arange(len(recording.gyr)) / RATE_HZ
    vectors = {name: getattr(recording, name) for name in ("acc", "gyr", "mag")}
    np.savez(table, time_s=times_s, **vectors)
    assert cli.main(["import", str(table), "--to", str(path)]) == 0
    return path


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_refined_poses_stand_beside_the_samples(tmp_path: Path, capsys: Said) -> None:
    recording, truth = made(own=np.array([12.0, -7.0, 5.0]))
    log = log_of(recording, tmp_path / "walk.mcap")
    params = tmp_path / "found.toml"
    assert cli.main(["refine", str(log), "--params", str(params)]) == 0
    said = capsys.readouterr().out
    assert "30 s; 1-sigma errors: tilt 0." in said
    new = tmp_path / "walk-refined.mcap"
    assert cli.main(["export", str(new), "--out", str(tmp_path / "tables")]) == 0
    (raws,) = (tmp_path / "tables").glob("*-raw.csv")
    (table,) = (tmp_path / "tables").glob("*-refined-pose.csv")
    raw, poses = rows_of(raws), rows_of(table)
    assert len(poses) == len(raw) == len(truth)
    assert [row["t_ns"] for row in poses] == [row["t_ns"] for row in raw]
    quats = np.array([[float(row[f"q_{axis}"]) for axis in "wxyz"] for row in poses])
    off = off_deg(quats, truth)
    sigmas = [float(row["heading_sigma_deg"]) for row in poses]
    assert off.max() < 2.0
    assert (off < 2.0 * np.hypot(0.5, sigmas)).all()
    assert float(poses[0]["since_origin_heading_sigma_deg"]) < 0.1
    mag = read(params).params.mag
    assert mag is not None
    lsb = np.array(mag.bias_counts)
    assert lsb / np.linalg.norm(lsb) == pytest.approx(
        np.array([12.0, -7.0, 5.0]) / 14.76, abs=0.1
    )


def test_a_log_is_not_written_over(tmp_path: Path, capsys: Said) -> None:
    log = log_of(made()[0], tmp_path / "walk.mcap")
    (tmp_path / "walk-refined.mcap").touch()
    assert cli.main(["refine", str(log)]) != 0
    assert "already exists" in capsys.readouterr().err


def test_what_is_refined_is_not_refined_again(tmp_path: Path, capsys: Said) -> None:
    log = log_of(made(12.0)[0], tmp_path / "walk.mcap")
    assert cli.main(["refine", str(log), "--probe", "nobody"]) != 0
    assert "no probe nobody; available: " in capsys.readouterr().err
    assert cli.main(["refine", str(log)]) == 0
    assert cli.main(["refine", str(tmp_path / "walk-refined.mcap")]) != 0
    assert "has refined poses already" in capsys.readouterr().err


def test_too_few_samples_are_told(tmp_path: Path, capsys: Said) -> None:
    log = log_of(made(9.0)[0], tmp_path / "short.mcap")
    assert cli.main(["refine", str(log)]) != 0
    assert "has no raw samples of 10 s and more" in capsys.readouterr().err
    assert not [*tmp_path.glob("*refined*")]


def test_the_field_in_motion_can_be_left_out(tmp_path: Path, capsys: Said) -> None:
    recording, truth = made()
    bent = recording.mag.copy()
    bent[300:1200] += 40.0  # beside iron, while it moves
    spoilt = Recording(RATE_HZ, recording.gyr, recording.acc, bent)
    log = log_of(spoilt, tmp_path / "iron.mcap")
    assert cli.main(["refine", str(log), "--method", "simple"]) == 0
    assert cli.main(["export", str(tmp_path / "iron-refined.mcap")]) == 0
    capsys.readouterr()
    (table,) = tmp_path.glob("*-refined-pose.csv")
    quats = np.array(
        [[float(row[f"q_{axis}"]) for axis in "wxyz"] for row in rows_of(table)]
    )
    assert off_deg(quats, truth).max() < 2.0


def test_north_is_where_one_says() -> None:
    pen = refined(np.zeros(3)).poses
    pen.fields[:] = 0.0, 20.0, -43.0
    pen.fields[100] = 20.0, 20.0, -43.0  # at 10 s: 45 degrees to the east
    for north, turn in ((10.0, -45.0), ("place", 0.0), (5.0, 0.0)):
        to_north = refining.to_north([pen], north, 0.1)
        turned = rotation.multiply(to_north, pen.quats)
        _, found = audit.differences(turned, pen.quats)
        assert found == pytest.approx(turn, abs=0.3)
    with pytest.raises(ConfigError, match="the recording is shorter"):
        refining.to_north([pen], 31.0, 0.1)


def refined(turn: FloatArray) -> Refined:
    """A stretch whose on-line poses are the true ones, turned by this in the world."""
    recording, truth = made()
    stretch = Stretch("pen", "imu", HELLO, Params())
    stretch.t_us = array("d", (np.arange(len(truth)) * 1e6 / RATE_HZ).tolist())
    online = rotation.multiply(rotation.from_rotation_vector(turn), truth)
    for t_us, q in zip(stretch.t_us, online.tolist(), strict=True):
        stretch.poses_us.append(t_us)
        stretch.poses.extend((*q, 0.5, 1.0, 0.0, 11.0))
    ((part, _),) = parts_of(recording, CALIBRATED)
    return Refined(stretch, part)


def test_an_audit_finds_what_the_poses_were_off_by() -> None:
    found = audit.audit_of(refined(np.radians([3.0, 0.0, -8.0])))
    assert found is not None
    assert found.all.tilt == pytest.approx(3.0, abs=0.3)
    assert found.all.heading == pytest.approx(8.0, abs=0.7)
    assert np.median(found.heading) > 0.0  # clockwise
    assert found.all.tilt_inside == 0.0
    assert [each.name for each in found.by_cause()] == ["in motion"]
    assert [each.count for each in found.by_minute()] == [found.all.count]


def test_good_poses_pass_an_audit() -> None:
    found = audit.audit_of(refined(np.radians([0.2, 0.1, -0.5])))
    assert found is not None
    assert found.all.tilt_inside > 0.95
    assert found.all.heading_inside > 0.95


def test_a_persons_reference_is_compared() -> None:
    pen = refined(np.radians([0.0, 0.0, -5.0]))
    lines = list(audit.referred(pen, audit.Reference(bearing=90.0)))
    assert len(lines) == 2
    assert lines[1].startswith("  on line: points to 95.")
    _, turned = audit.differences(pen.poses.quats[-1:], pen.poses.quats[:1])
    known = audit.Reference(turn=float(turned[0]) - 2.0)
    lines = list(audit.referred(pen, known))
    assert len(lines) == 2
    assert all("off by +2." in each or "off by +1." in each for each in lines), lines


def test_an_audit_is_a_page_of_its_own(tmp_path: Path, capsys: Said) -> None:
    log = log_of(made()[0], tmp_path / "walk.mcap")
    assert cli.main(["audit", str(log)]) != 0  # of others' samples alone
    assert "no poses to the world's axes" in capsys.readouterr().err
    one = audit.audit_of(refined(np.radians([1.0, 0.0, 2.0])))
    assert one is not None
    page = audit_page.page_of("a<b.mcap", audit.UNSEEN, [one])
    assert "a&lt;b.mcap" in page
    assert "//" not in page.replace("</", "")  # nothing from a network
    assert page.count("<svg") == 2


def test_a_foreign_file_is_not_audited_over(tmp_path: Path, capsys: Said) -> None:
    log = log_of(made(12.0)[0], tmp_path / "walk.mcap")
    page = tmp_path / "walk-audit.html"
    page.write_text("mine")
    assert cli.main(["audit", str(log)]) == 1
    assert "is no page of imud audit" in capsys.readouterr().err
    assert page.read_text() == "mine"
    one = audit.audit_of(refined(np.zeros(3)))
    assert one is not None
    page.write_text(audit_page.page_of("walk.mcap", audit.UNSEEN, [one]))
    assert cli.main(["audit", str(log)]) == 1
    assert "no poses to the world's axes" in capsys.readouterr().err


def test_what_is_made_of_stdin_needs_a_name(capsys: Said) -> None:
    for command in ("refine", "audit"):
        with pytest.raises(ConfigError, match="name what is written with --to"):
            source.beside(Path("-"), None, f"-{command}")
    for option in ("--turn", "--bearing", "--north"):
        with pytest.raises(SystemExit) as end:
            cli.main(["audit", "-", option, "nan"])
        assert end.value.code == 2
        assert "nan is not a finite number" in capsys.readouterr().err


def test_poses_of_two_probes_are_written_by_time(tmp_path: Path) -> None:
    found = []
    for name, late_ns in (("pen", 0), ("cup", 10_000_000)):
        each = refined(np.zeros(3))
        each.stretch.probe = name
        for t_us in each.stretch.t_us:
            t_ns = round(t_us * 1000) + late_ns
            each.stretch.times.extend((t_ns, t_ns, 0))
        found.append(each)
    beside = refining.Beside(found)
    path = tmp_path / "both.mcap"
    with path.open("wb") as file:
        writer = LogWriter(file, "test")
        beside.add(writer, 20_000_000_000)
        beside.add(writer, 40_000_000_000)
        writer.finish()
    read = [each for each in salvage(path) if isinstance(each, Logged)]
    poses = [each for each in read if each.topic == "pose"]
    assert [each.probe for each in poses[:3]] == [
        "pen-refined",
        "cup-refined",
        "pen-refined",
    ]
    assert [each.t_ns for each in poses] == sorted(each.t_ns for each in poses)
    assert len(poses) == sum(len(each.poses.quats) for each in found)
    assert {each.topic for each in read} == {"pose", "pose_in_frame"}


def test_ctrl_c_keeps_what_is_done(
    tmp_path: Path, capsys: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = log_of(made(12.0)[0], tmp_path / "walk.mcap")
    calls = []

    def stopped(*args: Any) -> Iterator[Any]:
        calls.append(args)
        yield from parts_of(*args[:2])
        raise KeyboardInterrupt

    monkeypatch.setattr(refining, "parts_of", stopped)
    monkeypatch.setattr(refining, "stretches_of", lambda *to: [*stretches_of(*to)] * 2)
    assert cli.main(["refine", str(log)]) == 0
    assert "stopped: what is done is kept" in capsys.readouterr().err
    assert len(calls) == 1  # the second stretch was not begun
    assert (tmp_path / "walk-refined.mcap").exists()


def test_times_that_do_not_rise_are_refused() -> None:
    stretch = Stretch("pen", "imu", HELLO, Params())
    for at in range(600):
        stretch.t_us.append(1e6 * (at == 599) * 20)
        stretch.values.extend((0.0,) * 9)
        stretch.is_bad.append(0)
    with pytest.raises(FileError, match="of its samples are in the log"):
        stretch.recording()


def test_strokes_are_measured_again(tmp_path: Path, capsys: Said) -> None:
    recording, way = stroked()
    plain = log_of(recording, tmp_path / "plain.mcap")
    first = next(each for each in salvage(plain) if isinstance(each, Logged))
    told_us = round(1e6 * (END + 0.4))  # the firmware tells it four windows late
    told = {
        **{"type": "stroke", "probe": first.probe, "seq": 1, "number": 0, "missing": 0},
        **{"t_device_us": told_us, "t_ns": told_us * 1000, "stroke": 1, "windows": 15},
        **{"end": "rest", "displacement_m": [0.1, 0.0, 0.0], "flags": []},
        **{"displacement_sigma_m": [0.01, 0.01, 0.01]},
        **{"path_m": None, "path_sigma_m": None},
    }
    running = told | {"end": "running", "t_device_us": told_us - 100_000}
    due = [
        json.dumps(each).encode()
        for each in (running, told, {}, told | {"windows": -5})
    ]

    def add(writer: LogWriter, until_ns: int) -> None:
        t_ns = told_us * 1000
        while due and t_ns < until_ns:
            record = Record(first.probe, "stroke", due.pop(0), b"", 1, t_ns, t_ns)
            Channels(writer).add("imud", record)

    log = tmp_path / "walk.mcap"
    copy_good(plain, log, lambda _: None, add)
    assert cli.main(["refine", str(log), "--north", "place"]) == 0
    assert "1 strokes, 1 measured: 1-sigma error 2." in capsys.readouterr().out
    assert cli.main(["export", str(tmp_path / "walk-refined.mcap")]) == 0
    (table,) = tmp_path.glob("*-refined-stroke.csv")
    (row,) = rows_of(table)
    assert (row["stroke"], row["windows"], row["end"]) == ("1", "15", "rest")
    found = [float(row[f"displacement_{axis}_m"]) for axis in "xyz"]
    assert found == pytest.approx(way, abs=0.008)
    assert 0.001 < float(row["displacement_sigma_x_m"]) < 0.004
