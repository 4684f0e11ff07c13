# SPDX-License-Identifier: MIT
"""Times of others' recordings: kept, continued where a counter wrapped, refused where
they can't be true; the same in a long file, which is read in parts.
"""

from __future__ import annotations

import csv
import errno
import itertools
import json
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from foreign_csv import EVEN, lines, motion_with, named
from imud import cli
from imud.errors import FileError
from imud.log.file import LogFile
from imud.log.reader import Logged, salvage
from imud.probes.probe import Probe
from imud.probes.record import Stamp, describe
from imud.recordings import foreign_log, foreign_text
from imud.recordings.foreign_map import ForeignMap
from imud.rotation import FloatArray
from imud.wire import messages
from imud.wire.messages import Message

Said = pytest.CaptureFixture[str]
PARTS = pytest.mark.parametrize("part", [foreign_text.PART, 700])  # lines


def raws_of(log: Path) -> list[dict[str, Any]]:
    found = (each for each in salvage(log) if isinstance(each, Logged))
    return [json.loads(each.data) for each in found if each.topic == "raw"]


@pytest.mark.parametrize("rate", ["time", "rate"])
def test_a_long_file_is_read_in_parts_as_if_in_one(
    rate: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said
) -> None:
    path = motion_with(tmp_path / "a.csv", EVEN + 5.0 * (EVEN > 20.0))
    rows = path.read_text().splitlines()
    rows[750], rows[2200] = "7,0,NA,1,0,0,0", rows[2199]
    path.write_text(lines(*rows))
    options = ["--rate", "100"] if rate == "rate" else []
    whole, parts, said = tmp_path / "whole.mcap", tmp_path / "parts.mcap", []
    for log in (whole, parts):
        assert cli.main(["import", str(path), "--to", str(log), *options]) == 0
        said.append(capsys.readouterr().out.splitlines()[:-1])
        monkeypatch.setattr(foreign_text, "PART", 700)
    assert said[0] == said[1]
    of_whole, of_parts = map(raws_of, (whole, parts))
    for one, other in zip(of_whole, of_parts, strict=True):
        for key in ("number", "missing", "t_device_us", "flags"):
            assert one[key] == other[key]
        assert one["acc_m_s2"] == pytest.approx(other["acc_m_s2"], abs=0.005)
        assert one["gyr_rad_s"] == pytest.approx(other["gyr_rad_s"], abs=0.001)


@pytest.mark.parametrize("end", ["was ended", "its rows are bad"])
def test_a_file_that_can_not_be_read_on_leaves_no_log(
    end: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(foreign_text, "PART", 700)
    path, log = motion_with(tmp_path / "a.csv", EVEN), tmp_path / "a.mcap"
    this = os.getpid()

    def parts() -> Iterator[foreign_log.Imported]:
        yield from itertools.islice(foreign_log.parts(path), 2)
        if end == "was ended" and os.getpid() != this:
            os.kill(os.getpid(), signal.SIGKILL)
        raise FileError(end)

    with pytest.raises(FileError, match=end):
        foreign_log.write(parts(), path, log)
    assert not log.exists()


def test_a_pipe_and_a_full_disk_are_told_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said
) -> None:
    pipe, log = tmp_path / "pipe.csv", tmp_path / "a.mcap"
    os.mkfifo(pipe)
    assert cli.main(["import", str(pipe)]) == 1
    assert "pipe.csv is a pipe, and is read more than once" in capsys.readouterr().err

    def add(*_: object) -> None:
        raise OSError(errno.ENOSPC, "no space")

    monkeypatch.setattr(LogFile, "add", add)
    path = motion_with(tmp_path / "a.csv", EVEN)
    assert cli.main(["import", str(path)]) == 1
    said = capsys.readouterr().err
    assert f"can't write {log}: No space left on device; what imud writes to" in said
    assert not log.exists()


def test_a_sample_is_told_as_its_frame_tells_it(tmp_path: Path) -> None:
    log = tmp_path / "a.mcap"
    foreign_log.write(
        foreign_log.parts(motion_with(tmp_path / "a.csv", EVEN)), log, log
    )
    frames = [e for e in salvage(log) if isinstance(e, Logged) and e.topic == "frame"]
    probe, told = Probe(frames[0].probe), list[dict[str, Any]]()
    for frame in frames:
        message = cast(Message, messages.decode(frame.data))
        probe.update(message, frame.data)
        if message.name == "raw":
            number, t_ns = 1 + len(told), frame.t_ns
            stamp = Stamp(number, 0, t_ns // 1000, t_ns, None, t_ns)
            told.append(describe(message, frame.data, frame.probe, stamp, probe.scales))
    assert json.loads(json.dumps(told)) == raws_of(log)


@pytest.mark.parametrize(
    ("start", "modulus"),
    [
        (2**16 - 777, 2**16),  # us, so that it wraps every 6.5 rows
        (2**24 - 5e6, 2**24),
        (2**32 - 5e6, 2**32),
        (86400.0 - 5.0, 86400.0),
    ],
)
@PARTS
def test_a_counter_that_wrapped_is_continued(
    start: float,
    modulus: float,
    part: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(foreign_text, "PART", part)
    ticks = 1.0 if modulus == 86400.0 else 1e6
    wrapped = np.round((start + EVEN * ticks) % modulus, 3)
    found = [*foreign_log.parts(motion_with(tmp_path / "a.csv", wrapped))]
    assert found[-1].counts.left_out == 0
    t_us = np.concatenate([each.t_us for each in found])
    assert np.abs(t_us - 1000 - 1e6 * EVEN).max() <= 1
    assert f"at {modulus:.10g}" in next(found[-1].told.lines())


@pytest.mark.parametrize(
    ("t", "why"),
    [
        (np.where(EVEN < 9.995, EVEN, EVEN - 3600), "row 1001: time steps back by 35"),
        (np.where(EVEN < 9.995, EVEN, EVEN - 1.0), "row 1001: time steps back by 0.99"),
        (np.where(EVEN < 9.995, EVEN, EVEN - 10.0), "row 1001: time steps back by 9.9"),
        (np.where(EVEN < 9.995, EVEN, EVEN + 1e9), "row 1001: time jumps by 1e+09 s"),
        (np.floor(EVEN * 10.0) / 10.0, "share each time: pass --rate 100"),
        (np.floor(EVEN), "share each time: pass --rate 100"),
        (EVEN[::-1], "sort the rows"),
        (np.arange(3000), "counts rows, or ms"),
        (EVEN * 1e4, "gravity rotates 0.11 times as fast as the gyroscope says"),
    ],
)  # fmt: skip
@PARTS
def test_times_that_are_none_are_refused_with_the_choice(
    t: FloatArray, why: str, part: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "gravity" not in why:  # which takes longer to turn
        monkeypatch.setattr(foreign_text, "PART", part)
    path = motion_with(tmp_path / "a.csv", t)
    with pytest.raises(FileError, match=re.escape(why)):
        [*foreign_log.parts(path)]
    *_, last = foreign_log.parts(path, ForeignMap(rate_hz=100.0))
    assert last.counts.samples == 3000


def clock(ms: int) -> str:
    return f"2026-03-04 23:59:59.{ms:03d}"


BEGAN_MS = 1_772_661_599_000  # 2026-03-04 21:59:59 UTC


@pytest.mark.parametrize("form", ["zone", "half an hour", "none", "ms", "clock", "s"])
@pytest.mark.parametrize("options", [[], ["--rate", "200"]])
def test_utc_is_kept_into_a_table_and_never_invented(
    form: str, options: list[str], tmp_path: Path
) -> None:
    """To the millisecond, 5 ms a row."""
    at_ms = [5 * row for row in range(40)]
    cells = {
        "zone": [f"{clock(ms)}+02:00" for ms in at_ms],
        "half an hour": [f"{clock(ms)} -0330" for ms in at_ms],
        "none": [f"{clock(ms)}".replace(" ", "T") for ms in at_ms],
        "ms": [str(BEGAN_MS + ms) for ms in at_ms],
        "clock": [clock(ms).split()[1] for ms in at_ms],
        "s": [f"{ms / 1000 + 1e4:.3f}" for ms in at_ms],
    }[form]
    names = ["time", *named("acc_{}_g", "gyr_{}_rad_s")]
    rows = [f"{cell},0,0.0{row % 7},1,0,0,0" for row, cell in enumerate(cells)]
    path = tmp_path / "a.csv"
    path.write_text(lines(",".join(names), *rows))
    assert cli.main(["import", str(path), *options]) == 0
    assert cli.main(["export", str(tmp_path / "a.mcap"), "--out", str(tmp_path)]) == 0
    (table,) = tmp_path.glob("a-*-raw.csv")
    with table.open() as file:
        found = [row["time_utc"] for row in csv.DictReader(file)]
    hour = {"zone": "04T21:59:59", "half an hour": "05T03:29:59", "ms": "04T21:59:59"}
    began = {"none": "04T23:59:59", **hour}.get(form)
    assert found == [(began and f"2026-03-{began}.{ms:03d}000Z") or "" for ms in at_ms]
