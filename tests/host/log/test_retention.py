# SPDX-License-Identifier: MIT
"""Old logs make room, and nothing else does."""

from __future__ import annotations

import logging
import os
import time
from pathlib import Path

import pytest

import imud.sinks.log
from imud.log.file import Settings
from imud.log.retention import DAY_S, Retention
from imud.log.writer import MAGIC
from imud.sinks.log import LogSink
from log_files import frames, records

NOW_S = 1_800_000_000.0


def finished(
    folder: Path, hour: int, size: int = 1000, age_s: float | None = None
) -> Path:
    path = folder / f"imud-20260102T{hour:02}0000Z.mcap"
    path.write_bytes(bytes(size - len(MAGIC)) + MAGIC)
    at_s = NOW_S - (age_s if age_s is not None else 3600.0 * (24 - hour))
    os.utime(path, (at_s, at_s))
    return path


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_oldest_go_until_the_rest_is_as_small_as_told(tmp_path: Path) -> None:
    paths = [finished(tmp_path, hour) for hour in range(5)]
    kept = Retention(bytes=3500).sweep(tmp_path, NOW_S)
    assert left(tmp_path) == [path.name for path in paths[2:]]
    assert (kept.files, kept.bytes) == (3, 3000)
    assert (kept.removed, kept.removed_bytes) == (2, 2000)
    assert Retention(bytes=3000).sweep(tmp_path, NOW_S).removed == 0


def test_those_that_are_too_old_go_however_small_the_rest_is(tmp_path: Path) -> None:
    finished(tmp_path, 1, age_s=9.1 * DAY_S)
    young = finished(tmp_path, 2, age_s=6.9 * DAY_S)
    assert Retention(days=7.0, bytes=10**9).sweep(tmp_path, NOW_S).removed == 1
    assert left(tmp_path) == [young.name]


def test_what_is_not_ours_or_has_no_end_stays(tmp_path: Path) -> None:
    others = ["imud-20260102T000000Z-recovered.mcap", "notes.txt", "card-1.mcap"]
    for name in others:
        (tmp_path / name).write_bytes(bytes(5000) + MAGIC)
    cut = finished(tmp_path, 0)
    cut.write_bytes(bytes(4000))
    sink = LogSink(tmp_path)
    sink.open()
    assert sink.path is not None
    for record in records(5):
        sink.write(record)
    sink.flush()
    finished(tmp_path, 1)
    kept = Retention(days=1e-9, bytes=1).sweep(tmp_path)
    assert left(tmp_path) == sorted([*others, cut.name, sink.path.name])
    assert (kept.files, kept.unfinished, kept.removed) == (2, 2, 1)
    sink.close()
    assert Retention(bytes=1).sweep(tmp_path).removed == 1


def test_a_folder_stays_as_small_as_told_while_logs_are_written(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(imud.sinks.log, "SWEEP_S", 0.0)
    put = records(3000)
    keep = 60_000
    settings = Settings(rotate_bytes=8000, retention=Retention(bytes=keep))
    sink = LogSink(tmp_path, settings)
    sink.open()
    largest = 0
    with caplog.at_level(logging.INFO, "imud"):
        for begin in range(0, len(put), 20):
            for record in put[begin : begin + 20]:
                sink.write(record)
            sink.flush()
            time.sleep(0.002)  # the thread that removes has its turn
            sizes = [path.stat().st_size for path in tmp_path.iterdir()]
            largest = max(largest, sum(sizes))
    sink.close()
    assert largest < keep + 3 * 10_000
    assert sink.kept is not None
    assert sink.kept.bytes <= keep
    removed = [r.getMessage() for r in caplog.records if "removed" in r.getMessage()]
    assert len(removed) >= 3
    assert "(log.keep_mb, log.keep_days)" in removed[0]
    # What is left is whole, and the newest. So many files a second reuse names.
    left_over = sorted(tmp_path.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    found = [frame for path in left_over for frame in frames(path)]
    assert found == [record.content for record in put[-len(found) :]]
