# SPDX-License-Identifier: MIT
"""Old logs make room, and nothing else does; those that a crash cut off get an end."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

import imud.sinks.log
from imud.log import finish
from imud.log.file import LogFile, Settings
from imud.log.retention import DAY_S, STAMP, Retention, this_machine
from imud.log.writer import MAGIC
from imud.machine import system
from imud.sinks.log import LogSink
from log_files import frames, records, write

NOW_S = 1_800_000_000.0


def made(
    folder: Path,
    number: int,
    age_days: float,
    clock: str = "utc",
    machine: str | None = None,
    end: bytes = MAGIC,
    size: int = 1000,
) -> str:
    """A log whose clock said that age, in its name, its contents and its file."""
    at_s = NOW_S - age_days * DAY_S
    stamp = time.strftime(STAMP, time.gmtime(at_s))
    path = folder / f"imud-{stamp}_{number + 100}.mcap"
    who = this_machine() if machine is None else machine
    about = {"machine": who, "number": str(number), "began": stamp, "clock": clock}
    with path.open("wb") as file:
        LogFile(file, Settings(), about if number else None).flush()
        file.write(bytes(size - file.tell() - len(end)) + end)
    os.utime(path, (at_s, at_s))
    return path.name


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_oldest_go_until_the_rest_is_as_small_as_told(tmp_path: Path) -> None:
    names = [made(tmp_path, number, 9 - number) for number in range(1, 6)]
    kept = Retention(bytes=3500).sweep(tmp_path, NOW_S)
    assert left(tmp_path) == names[2:]
    assert (kept.files, kept.bytes, kept.excess) == (3, 3000, 0)
    assert (kept.removed, kept.removed_bytes) == (2, 2000)
    assert Retention(bytes=3000).sweep(tmp_path, NOW_S).removed == 0


@pytest.mark.parametrize(
    "ages",
    [
        (1, 2, 3, 20_000),  # the last one in 1970
        (5, 20_800, 4, 3),  # one before
        (1, 9, 5, 7),  # set back and forth
        (2, 2, 2, 2),  # equal names but for their numbers
        (-30, 4, -9_000, 2),  # 2051
    ],
)
@pytest.mark.parametrize("clock", ["utc", "unknown"])
def test_what_was_written_last_stays_whatever_the_clock_said(
    tmp_path: Path, ages: tuple[float, ...], clock: str
) -> None:
    names = [made(tmp_path, n, age, clock) for n, age in enumerate(ages, 1)]
    Retention(bytes=2500).sweep(tmp_path, NOW_S)
    assert left(tmp_path) == sorted(names[2:])


def test_logs_of_versions_without_numbers_are_older_and_1970_is_no_age(
    tmp_path: Path,
) -> None:
    names = [made(tmp_path, 0, age) for age in (40, 20_000, 30)]
    numbered = made(tmp_path, 1, 50)
    Retention(bytes=2500).sweep(tmp_path, NOW_S)
    assert left(tmp_path) == sorted([names[1], numbered])


def test_logs_of_another_machine_have_their_place_by_time_and_not_by_number(
    tmp_path: Path,
) -> None:
    for number in (500, 501):
        made(tmp_path, number, 30, machine="other")
    own = [made(tmp_path, number, 3 - number) for number in (1, 2)]
    Retention(bytes=2500).sweep(tmp_path, NOW_S)
    assert left(tmp_path) == sorted(own)


def test_those_that_are_too_old_go_however_small_the_rest_is(tmp_path: Path) -> None:
    made(tmp_path, 1, 3, "unknown")  # before one that is too old
    made(tmp_path, 2, 9.1)
    names = [made(tmp_path, 3, 600, "unknown"), made(tmp_path, 4, 6.9)]
    names.append(made(tmp_path, 5, 400, "unknown"))
    made(tmp_path, 900, 9.1, machine="other")
    retention = Retention(days=7.0, bytes=10**9)
    assert retention.sweep(tmp_path, NOW_S, is_dated=False).removed == 0
    assert retention.sweep(tmp_path, NOW_S).removed == 3
    assert left(tmp_path) == sorted(names)
    far_s = NOW_S + 30_000 * DAY_S  # 2108: the two newest stay
    assert retention.sweep(tmp_path, far_s).removed == 2
    assert left(tmp_path) == [names[2]]


def test_what_is_not_ours_or_no_file_stays_and_costs_none_of_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = ["imud-20260102T000000Z-recovered.mcap", "notes.txt", "card-1.mcap"]
    for name in others:
        (tmp_path / name).write_bytes(bytes(5000) + MAGIC)
    special = [f"imud-20260101T00000{n}Z.mcap" for n in range(3)]
    (tmp_path / special[0]).symlink_to(others[1])
    (tmp_path / special[1]).mkdir()
    os.mkfifo(tmp_path / special[2])
    # Of this one nobody can tell whether it is being written.
    unknown = made(tmp_path, 1, 9, end=b"")
    newest = made(tmp_path, 2, 8)
    lock = system.try_lock

    def locked(file: object, *, is_shared: bool = False) -> bool:
        if getattr(file, "name", None) == str(tmp_path / unknown):
            raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))
        return lock(file, is_shared=is_shared)  # type: ignore[arg-type]

    monkeypatch.setattr(system, "try_lock", locked)
    kept = Retention(bytes=1000).sweep(tmp_path, NOW_S)
    assert left(tmp_path) == sorted([*others, *special, unknown, newest])
    assert (kept.files, kept.unfinished, kept.excess) == (2, 1, 1000)


def test_one_that_can_not_be_removed_costs_no_newer_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [made(tmp_path, number, 9) for number in (1, 2, 3)]
    unlink = Path.unlink

    def kept_by_system(path: Path, *, missing_ok: bool = False) -> None:
        if path.name == names[0]:
            raise PermissionError(errno.EPERM, "Operation not permitted")
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", kept_by_system)
    kept = Retention(bytes=2000).sweep(tmp_path, NOW_S)
    assert left(tmp_path) == names
    assert kept.excess == 1000
    assert kept.fault == f"{names[0]}: Operation not permitted"


def test_those_cut_off_go_like_others_and_the_newest_finished_one_stays(
    tmp_path: Path,
) -> None:
    cut = [made(tmp_path, number, 9, end=b"") for number in (1, 2)]
    whole = made(tmp_path, 3, 9)
    later = made(tmp_path, 4, 9, end=b"", size=5000)
    with (tmp_path / later).open("rb") as file:
        assert system.try_lock(file)  # it is being written
        Retention(bytes=6000).sweep(tmp_path, NOW_S)
        assert left(tmp_path) == [whole, later]
        assert cut
        Retention(bytes=1).sweep(tmp_path, NOW_S)
        assert left(tmp_path) == [whole, later]


def cut_off(folder: Path) -> tuple[Path, list[bytes]]:
    """A log that lacks its last part, and what is in it."""
    path = write(folder, *[records(40)[at : at + 10] for at in (0, 10, 20, 30)])
    path.write_bytes(path.read_bytes()[: 3 * path.stat().st_size // 4])
    os.utime(path, (NOW_S, NOW_S))
    return path, frames(path)


def test_logs_that_were_cut_off_are_finished_at_the_next_start(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "imud")
    path, good = cut_off(tmp_path)
    empty = tmp_path / "imud-20260101T000000Z.mcap"
    empty.touch()
    blank = tmp_path / "imud-20260102T000000Z.mcap"
    with blank.open("wb") as file:
        LogFile(file, Settings()).flush()
    foreign = tmp_path / "imud-20260103T000000Z.mcap"
    foreign.write_text("a person's")
    (tmp_path / f"{path.name}.part").write_bytes(b"of an earlier attempt")
    sink = LogSink(tmp_path)
    sink.open()
    sink._finishing.join()
    sink.close()
    assert left(tmp_path) == sorted([foreign.name, path.name, sink.path.name])
    assert path.read_bytes().endswith(MAGIC)
    assert frames(path) == good
    assert path.stat().st_mtime == NOW_S
    assert f"finished 3 of {tmp_path} that were cut off" in caplog.text
    assert "a person's" in foreign.read_text()


def test_where_a_log_can_not_be_finished_it_stays_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, good = cut_off(tmp_path)
    before = path.read_bytes()
    with path.open("rb") as file:
        assert system.try_lock(file)
        assert list(finish.finish_all([path])) == []  # another daemon writes it
    with monkeypatch.context() as patch:
        patch.setattr(system, "free_bytes", lambda _: 10**6 + len(before))
        (found,) = finish.finish_all([path], floor_bytes=10**6)
        assert found.fault == f"can't finish {path}: No space left on device"
    with monkeypatch.context() as patch:
        full = OSError(errno.EIO, "Input/output error")
        raises = SimpleNamespace(fsync=lambda _: (_ for _ in ()).throw(full))
        patch.setattr("imud.log.copy.os.fsync", raises.fsync)
        (found,) = finish.finish_all([path])
        assert "Input/output error" in found.fault
    assert left(tmp_path) == [path.name]
    assert path.read_bytes() == before
    (found,) = finish.finish_all([path])
    assert (found.fault, frames(path)) == ("", good)


def test_no_age_counts_until_the_clock_was_steady(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    utc_s, now_s, is_utc = NOW_S, 0.0, True
    monkeypatch.setattr(
        imud.sinks.log,
        "sync_of_host",
        lambda: SimpleNamespace(is_synchronised=is_utc),
    )
    monkeypatch.setattr(
        imud.sinks.log,
        "time",
        SimpleNamespace(time=lambda: utc_s + now_s, monotonic=lambda: now_s),
    )
    sink = LogSink(tmp_path)
    assert not sink._is_dated()
    now_s = imud.sinks.log.STEADY_S
    assert sink._is_dated()
    utc_s += 70 * 365 * DAY_S  # for a moment
    assert not sink._is_dated()
    utc_s = NOW_S
    now_s += 10
    assert not sink._is_dated()
    now_s += imud.sinks.log.STEADY_S
    assert sink._is_dated()
    is_utc = False
    assert not sink._is_dated()


def test_each_log_has_a_number_above_all_in_the_folder(tmp_path: Path) -> None:
    made(tmp_path, 41, 1, machine="other")
    paths = [write(tmp_path, records(1)) for _ in range(3)]
    Retention(bytes=1).sweep(tmp_path)
    assert left(tmp_path) == [paths[-1].name]


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
            with contextlib.suppress(FileNotFoundError):  # it removes one just now
                sizes = [path.stat().st_size for path in tmp_path.iterdir()]
                largest = max(largest, sum(sizes))
    sink.close()
    assert largest < keep + 3 * 10_000
    assert sink.kept.bytes <= keep
    removed = [r.getMessage() for r in caplog.records if "removed" in r.getMessage()]
    assert len(removed) >= 3
    assert "(log.keep_mb, log.keep_days)" in removed[0]
    # What is left is whole, and the newest. So many files a second reuse names.
    left_over = sorted(tmp_path.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    found = [frame for path in left_over for frame in frames(path)]
    assert found == [record.content for record in put[-len(found) :]]
