# SPDX-License-Identifier: MIT
"""Logs on a disk or in a folder that fails."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from imud.daemon import lane as lane_module
from imud.daemon.lane import Lane
from imud.errors import FileError
from imud.log.file import Settings
from imud.probes.record import Record
from imud.sinks.log import LogSink
from log_files import frames, read_log, records


@contextmanager
def lane(sink: LogSink, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lane]:
    """As the daemon runs it, without waiting long after a fault."""
    monkeypatch.setattr(lane_module, "RETRY_S", 0.0)
    sink.period_s = 0.0
    made = Lane(sink)
    made.start()
    yield made
    assert made.close(30)


def counts(lane: Lane) -> tuple[int, int]:
    return sum(lane.taken("left").values()), lane.dropped("left")


def hand_over(lane: Lane, put: list[Record]) -> tuple[int, int]:
    """How many were logged and how many dropped, by the lane's own counts."""
    taken, dropped = counts(lane)
    with lane._wake:  # as one batch
        for record in put:
            lane.put(record)
    while sum(counts(lane)) < taken + dropped + len(put):
        time.sleep(0.001)
    return counts(lane)[0] - taken, counts(lane)[1] - dropped


def test_below_its_floor_logging_pauses_with_one_line_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    disk = SimpleNamespace(f_bavail=1000, f_frsize=1_000_000)
    monkeypatch.setattr(os, "statvfs", lambda _: disk)
    monkeypatch.setattr(os, "fstatvfs", lambda _: disk)
    put = records(60)
    sink = LogSink(tmp_path, Settings(floor_bytes=500 * 10**6))
    caplog.set_level("INFO", "imud")
    with lane(sink, monkeypatch) as made:
        assert hand_over(made, put[:10]) == (10, 0)
        disk.f_bavail = 499
        assert hand_over(made, put[10:20]) == (10, 0)  # these were brought out
        for _ in range(3):
            assert hand_over(made, put[20:30]) == (0, 10)
        disk.f_bavail = 540  # not enough to begin again
        assert hand_over(made, put[30:40]) == (0, 10)
        disk.f_bavail = 551
        assert hand_over(made, put[40:50]) == (10, 0)
    assert [record.getMessage() for record in caplog.records] == [
        f"log failed, retrying: {tmp_path} is on a disk with less than 500 MB "
        "free (log.floor_mb); logging is paused until space is free",
        "log works again",
    ]
    files = sorted(tmp_path.iterdir())
    assert [len(frames(path)) for path in files] == [20, 10]
    for path in files:
        list(read_log(path))


def test_a_disk_that_is_full_at_the_start_does_not_keep_imud_from_starting(
    tmp_path: Path,
) -> None:
    sink = LogSink(tmp_path, Settings(floor_bytes=1 << 60))
    sink.open()
    with pytest.raises(FileError, match="logging is paused until space is free"):
        sink.write(records(1)[0])
    sink.flush()
    sink.close()
    assert list(tmp_path.iterdir()) == []


def test_what_a_full_disk_did_not_take_is_counted_and_leaves_no_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same error in the same places as a disk without a block left."""
    create = LogSink._create
    is_full = False

    def opened(sink: LogSink, stamp: str) -> tuple[Path, Any]:
        path, file = create(sink, stamp)
        if is_full:
            file.close()
            return path, Path("/dev/full").open("wb")
        return path, file

    monkeypatch.setattr(LogSink, "_create", opened)
    monkeypatch.setattr(os, "fdatasync", lambda _: None)
    put = records(50)
    sink = LogSink(tmp_path)
    with lane(sink, monkeypatch) as made:
        assert hand_over(made, put[:10]) == (10, 0)
        is_full = True
        sink.path.unlink()  # it begins another
        for _ in range(5):
            assert hand_over(made, put[10:20]) == (0, 10)
        is_full = False
        assert hand_over(made, put[20:30]) == (10, 0)
    files = sorted(tmp_path.iterdir())
    assert [len(frames(path)) for path in files] == [10]


def test_a_folder_that_is_removed_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    put = records(40)
    sink = LogSink(tmp_path / "logs")
    with lane(sink, monkeypatch) as made:
        assert hand_over(made, put[:10]) == (10, 0)
        for path in (tmp_path / "logs").iterdir():
            path.unlink()
        (tmp_path / "logs").rmdir()
        assert hand_over(made, put[10:20]) == (0, 10)
        assert hand_over(made, put[20:30]) == (10, 0)
    (path,) = (tmp_path / "logs").iterdir()
    assert frames(path) == [record.content for record in put[20:30]]
    assert "was removed during writing" in caplog.text


def test_a_folder_that_becomes_read_only_costs_what_comes_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    put = records(40)
    sink = LogSink(tmp_path, Settings(rotate_bytes=1))
    refused = OSError(30, "Read-only file system")
    is_refused = False
    create = LogSink._create

    def opened(sink: LogSink, stamp: str) -> tuple[Path, Any]:
        if is_refused:
            raise refused
        return create(sink, stamp)

    monkeypatch.setattr(LogSink, "_create", opened)
    with lane(sink, monkeypatch) as made:
        assert hand_over(made, put[:10]) == (10, 0)
        is_refused = True
        assert hand_over(made, put[10:20]) == (0, 10)
        assert hand_over(made, put[20:30]) == (0, 10)
        is_refused = False
        assert hand_over(made, put[30:40]) == (10, 0)
    assert caplog.text.count("Read-only file system") == 1
    found = [frame for path in sorted(tmp_path.iterdir()) for frame in frames(path)]
    assert found == [record.content for record in [*put[:10], *put[30:40]]]
