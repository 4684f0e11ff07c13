# SPDX-License-Identifier: MIT
"""Logs that last: rotation, disks that are full or gone, and what reads logs back."""

from __future__ import annotations

import csv
import io
import json
import os
import resource
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader
from pyarrow import parquet

import imud.sinks.log
from fakes import DaemonProcess, FakeProbe, Port, free_endpoint, status_of
from imud import cli
from imud.client import Client
from imud.daemon import lane as lane_module
from imud.daemon.lane import Lane
from imud.errors import FileError
from imud.log.file import Settings, pose_in_frame
from imud.log.reader import FRAME_ENCODING, Damage, Logged, LogHead, read_log, salvage
from imud.log.schemas import FOXGLOVE_SCHEMA
from imud.probes.record import Record
from imud.probes.session import Probe as HeardProbe
from imud.probes.session import Received, Session
from imud.recordings import replay
from imud.sinks.log import LogSink
from imud.wire import schema
from length import choose
from log_files import BEGIN_NS, PERIOD_NS, frames, records, write


def test_a_file_is_as_large_as_told_and_none_is_lost_between(tmp_path: Path) -> None:
    put = records(400)
    sink = LogSink(tmp_path, Settings(rotate_bytes=20_000))
    sink.open()
    for begin in range(0, len(put), 20):
        for record in put[begin : begin + 20]:
            sink.take(record)
        sink.flush()
    sink.close()
    files = sorted(tmp_path.iterdir())
    assert len(files) > 2
    found = [frame for path in files for frame in frames(path)]
    assert found == [record.content for record in put]
    for path in files:
        list(read_log(path))  # each has its end
    assert all(path.stat().st_size < 40_000 for path in files)


def test_the_index_in_memory_is_bounded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(imud.sinks.log, "INDEX_MAX", 12)
    put = records(60)
    write(tmp_path, *[put[at : at + 5] for at in range(0, 60, 5)])
    assert len(list(tmp_path.iterdir())) >= 4
    found = [frame for path in tmp_path.iterdir() for frame in frames(path)]
    assert sorted(found) == sorted(record.content for record in put)


def test_who_it_was_and_how_it_was_set_stand_in_each_file(tmp_path: Path) -> None:
    path = write(tmp_path, records(3), configuration='{"log":{}}')
    with path.open("rb") as file:
        found = {each.name: each.metadata for each in make_reader(file).iter_metadata()}
    assert found["configuration"]["json"] == '{"log":{}}'
    assert found["imud"]["schema_fingerprint"] == f"{schema.FINGERPRINT:#010x}"
    hello = found["hello"]
    assert (hello["probe"], hello["firmware"]) == ("left", "0.1.0+fake")
    assert hello["probe_id"] == "00112233445566aa"


def test_foxglove_finds_poses_that_it_can_draw(tmp_path: Path) -> None:
    path = write(tmp_path, records(1))
    with path.open("rb") as file:
        ((spec, channel, message),) = make_reader(file).iter_messages(
            topics=["imud/left/pose_in_frame"]
        )
    assert spec is not None
    assert (spec.name, spec.encoding) == ("foxglove.PoseInFrame", "jsonschema")
    assert channel.message_encoding == "json"
    assert json.loads(message.data) == {
        "timestamp": {"sec": BEGIN_NS // 10**9, "nsec": BEGIN_NS % 10**9},
        "frame_id": "world",
        "pose": {
            "position": {"x": 0.0, "y": 0.0, "z": 0.0},
            "orientation": {"w": 0.5, "x": 0.5, "y": -0.5, "z": 0.5},
        },
    }
    without = write(tmp_path / "plain", records(1), has_foxglove=False)
    topics = {each.topic for each in read_log(without) if isinstance(each, Logged)}
    assert topics == {"hello", "pose", "frame"}


# What Foxglove wants of its PoseInFrame, as its published schema has it: all of these.
POSE_IN_FRAME = {
    "timestamp": {"sec": "integer", "nsec": "integer"},
    "frame_id": "string",
    "pose": {
        "position": dict.fromkeys("xyz", "number"),
        "orientation": dict.fromkeys("xyzw", "number"),
    },
}


def wanted_of(spec: dict[str, Any]) -> Any:
    """A schema as names and types; nothing in it may be left out."""
    if spec["type"] != "object":
        return spec["type"]
    assert sorted(spec["required"]) == sorted(spec["properties"])
    return {name: wanted_of(each) for name, each in spec["properties"].items()}


def test_poses_for_foxglove_are_of_its_published_schema() -> None:
    assert FOXGLOVE_SCHEMA["title"] == "foxglove.PoseInFrame"
    assert wanted_of(FOXGLOVE_SCHEMA) == POSE_IN_FRAME
    checker = Draft202012Validator(FOXGLOVE_SCHEMA)
    for record in records(20):
        if record.topic == "pose":
            checker.validate(json.loads(pose_in_frame(record)))


def decoded(path: Path) -> Counter[str]:
    """How many of each topic; with nothing of imud's, each is what its schema says."""
    found: Counter[str] = Counter()
    with path.open("rb") as file:
        for spec, channel, message in make_reader(
            file, validate_crcs=True
        ).iter_messages():
            topic = channel.topic.rpartition("/")[2]
            found[topic] += 1
            if topic == "frame":
                assert channel.message_encoding == FRAME_ENCODING
                continue
            assert spec is not None, topic
            assert (spec.encoding, channel.message_encoding) == ("jsonschema", "json")
            body = json.loads(spec.data)
            Draft202012Validator.check_schema(body)
            said = json.loads(message.data)
            Draft202012Validator(body).validate(said)
            assert said.keys() <= body["properties"].keys() or topic == "status"
    return found


def test_with_mcap_alone_all_that_the_daemon_logs_is_what_its_schema_says(
    tmp_path: Path,
) -> None:
    port, probe = Port(tmp_path / "probe"), FakeProbe()
    with DaemonProcess(port.path, directory=tmp_path) as daemon:
        port.wait_open()
        port.write(probe.say("hello"))
        daemon.expect("found")
        port.write(probe.poses(50) + probe.say("raw") + probe.say("event"))
        with Client(daemon.endpoint) as client:
            until = time.monotonic() + 30
            while status_of(client)["ledger"]["logged"].get("event") != 1:
                assert time.monotonic() < until
                time.sleep(0.05)
        daemon.stop()
    port.vanish()
    found = decoded(daemon.log)
    assert (found["pose"], found["pose_in_frame"]) == (50, 50)
    assert (found["raw"], found["event"]) == (1, 1)
    assert found["status"] > 0
    assert found["frame"] >= 53


def test_what_the_daemon_says_of_itself_is_logged_with_its_schema(
    tmp_path: Path,
) -> None:
    head = {"probe": "left", "t_ns": 1}
    said = [
        {"type": "clock", **head, "step_ns": -5},
        {"type": "log", **head, "state": "paused", "reason": "full", "dropped": 3},
        {"type": "log", **head, "state": "on", "reason": None, "dropped": 9},
    ]
    put = [
        Record("left", str(each["type"]), json.dumps(each).encode(), b"", 0, 1, 1)
        for each in said
    ]
    assert decoded(write(tmp_path, put)) == {"clock": 1, "log": 2}


def test_a_probe_that_is_not_to_be_logged_is_not(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        records(4, name="left"),
        records(4, name="right"),
        unlogged=frozenset({"right"}),
    )
    probes = {each.probe for each in read_log(path) if isinstance(each, Logged)}
    assert probes == {"left"}


# A disk or folder that fails


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
    until = time.monotonic() + 30
    while sum(counts(lane)) < taken + dropped + len(put):
        assert time.monotonic() < until
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
        f"log fails and is tried again: {tmp_path} is on a disk with less than 500 MB "
        "free (log.floor_mb); logging pauses until there is room",
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
    with pytest.raises(FileError, match="logging pauses until there is room"):
        sink.take(records(1)[0])
    sink.flush()
    sink.close()
    assert list(tmp_path.iterdir()) == []


def test_what_a_full_disk_did_not_take_is_counted_and_leaves_no_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same error in the same places as a disk without a block left."""
    create = LogSink._create
    is_full = False

    def opened(sink: LogSink) -> tuple[Path, Any]:
        path, file = create(sink)
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
        assert sink.path is not None
        sink.path.unlink()  # it begins another
        for _ in range(5):
            assert hand_over(made, put[10:20]) == (0, 10)
        is_full = False
        assert hand_over(made, put[20:30]) == (10, 0)
    files = sorted(tmp_path.iterdir())
    assert [len(frames(path)) for path in files] == [10]


def test_a_limit_on_the_size_of_files_cuts_at_a_message_and_logging_goes_on(
    tmp_path: Path,
) -> None:
    """In a process of its own: limits hold for all that it writes."""
    script = f"""
import signal, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from pathlib import Path
from imud.daemon import lane as lane_module
from imud.daemon.lane import Lane
from imud.sinks.log import LogSink
from test_logs import counts, hand_over, records
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
lane_module.RETRY_S = 0.0
sink = LogSink(Path({str(tmp_path)!r}))
sink.period_s = 0.0
lane = Lane(sink)
lane.start()
put = records(2000)
for begin in range(0, 2000, 20):
    hand_over(lane, put[begin : begin + 20])
lane.close(30)
print(*counts(lane))
"""
    done = subprocess.run(
        [sys.executable, "-c", script],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000)),
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    logged, dropped = map(int, done.stdout.split())
    assert logged + dropped == 2000
    assert dropped > 0
    found = [frame for path in tmp_path.iterdir() for frame in frames(path)]
    assert len(found) == len(set(found)) >= logged > 1000


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
    assert "was removed while it was written" in caplog.text


def test_a_folder_that_becomes_read_only_costs_what_comes_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    put = records(40)
    sink = LogSink(tmp_path, Settings(rotate_bytes=1))
    refused = OSError(30, "Read-only file system")
    is_refused = False
    create = LogSink._create

    def opened(sink: LogSink) -> tuple[Path, Any]:
        if is_refused:
            raise refused
        return create(sink)

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


# Cut and damaged logs


def test_a_cut_log_is_recovered_beside_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put = records(60)
    path = write(tmp_path, put[:20], put[20:40], put[40:])
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    good = frames(path)
    assert 0 < len(good) < 60
    cut = path.read_bytes()
    assert cli.main(["recover", str(path)]) == 0
    saved = path.with_name(f"{path.stem}-recovered.mcap")
    assert "cut off" in capsys.readouterr().out
    assert path.read_bytes() == cut
    head, *_ = read_log(saved)  # to its end
    assert isinstance(head, LogHead)
    assert frames(saved) == good == [record.content for record in put[: len(good)]]
    with saved.open("rb") as file:
        assert make_reader(file).get_summary() is not None
    assert cli.main(["recover", str(path)]) == 1
    assert "is there already" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == sorted([path, saved])


def test_damage_in_the_middle_costs_only_what_it_struck(tmp_path: Path) -> None:
    put = records(100)
    path = write(tmp_path, *[put[at : at + 10] for at in range(0, 100, 10)])
    whole = path.read_bytes()
    summary_at = 9 * len(whole) // 10
    for at in range(200, summary_at, 211):
        struck = bytearray(whole)
        struck[at : at + 40] = bytes(40)
        path.write_bytes(struck)
        found = frames(path)
        assert set(found) <= {record.content for record in put}
        assert len(found) >= 70, at
        damages = [each for each in salvage(path) if isinstance(each, Damage)]
        assert all(each.size > 0 for each in damages if not each.is_tail)


@pytest.mark.long
def test_any_bytes_at_all_are_read_without_an_error_that_is_not_ours(
    tmp_path: Path,
) -> None:
    whole = write(tmp_path, records(30)).read_bytes()
    file = tmp_path / "any.mcap"
    for seed in range(choose(everyday=75, long=300)):
        state = seed * 2654435761 % 2**32
        struck = bytearray(whole)
        for _ in range(1 + seed % 20):
            state = (state * 1664525 + 1013904223) % 2**32
            struck[8 + state % (len(whole) - 8)] = state >> 24
        file.write_bytes(struck)
        list(salvage(file))


def test_a_whole_log_is_left_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, records(10))
    assert cli.main(["recover", str(path)]) == 0
    assert "is whole" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_that_is_no_log_is_taken_for_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "x"
    file.write_bytes(b"no log")
    for words in (["info"], ["recover"], ["export"], ["replay"]):
        for path in (file, tmp_path / "none", tmp_path):
            assert cli.main([*words, str(path)]) == 1
            assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [file]


# What is in it


def test_info_tells_probes_times_rates_and_losses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put = records(101)
    del put[50:53]
    path = write(tmp_path, put)
    assert cli.main(["info", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["is_whole"]
    assert (told["end_ns"] - told["begin_ns"]) == 100 * PERIOD_NS
    (probe,) = told["probes"]
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
    assert "cut off (imud recover saves what is good)" in capsys.readouterr().out


# As tables


def test_csv_holds_each_value_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put = records(50)
    path = write(tmp_path, put)
    out = tmp_path / "tables"
    assert cli.main(["export", str(path), "--to", "csv", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    for topic in ("pose", "raw", "event"):
        file = out / f"{path.stem}-left-{topic}.csv"
        wanted = [record.said for record in put if record.topic == topic]
        assert f"{file}: {len(wanted)} rows" in said
        rows = list(csv.DictReader(io.StringIO(file.read_text("utf-8"))))
        assert len(rows) == len(wanted)
        for row, record in zip(rows, wanted, strict=True):
            assert int(row["t_ns"]) == record["t_ns"]
            assert int(row["seq"]) == record["seq"]
            if topic == "pose":
                assert [float(row[f"q_{n}"]) for n in "wxyz"] == list(record["q"])
                assert (row["position_m_x"], row["flags"]) == ("", "at_rest")
    assert cli.main(["export", str(path), "--to", "csv", "--out", str(out)]) == 1
    assert "is there already" in capsys.readouterr().err


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
    clock = {"type": "clock", **head, "step_ns": -4}
    put = [
        Record("left", str(each["type"]), json.dumps(each).encode(), b"", 0, 7, 7)
        for each in (status, twin, log, clock)
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
        said = capsys.readouterr()
        assert said.err.splitlines() == [
            f"{cut} is cut off or damaged: what is good is exported",
            f"imud: can't read {none}: No such file or directory",
        ]
        assert f"{out / f'cut-left-pose.{kind}'}: 62 rows" in said.out
    (row,) = parquet.read_table(out / f"{whole.stem}-left-status.parquet").to_pylist()
    assert (row["t_ns"], row["state"], row["pose_rate_hz"]) == (7, "streaming", 99.5)
    assert (row["ledger_sent"], row["ledger_lost"]) == (12, 1)
    assert (row["clock_offset_ns"], row["clock_skew_ppm"]) == (1 << 60, -3.5)
    assert (row["log_state"], row["twin_state"], row["port"]) == ("on", None, None)
    for topic, line in (
        ("twin", "7,,,differs,5,1"),
        ("log", "7,paused,full,2"),
        ("clock", "7,-4"),
    ):
        file = out / f"{whole.stem}-left-{topic}.csv"
        assert file.read_text("utf-8").splitlines()[1:] == [line]


def test_without_pyarrow_parquet_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    path = write(tmp_path, records(3))
    assert cli.main(["export", str(path), "--to", "parquet"]) == 1
    assert "pip install 'imud[parquet]'" in capsys.readouterr().err


# Once more


def test_pace_follows_the_times_of_the_log() -> None:
    now, slept = [100.0], []

    def sleep(seconds: float) -> None:
        slept.append(round(seconds, 6))
        now[0] += seconds

    pace = replay.Pace(4.0, lambda: now[0], sleep)
    for t_ns in (0, 10**9, 1_500_000_000, 1_400_000_000, 3 * 10**9):
        pace.wait(t_ns)
    assert slept == [0.25, 0.125, 0.375]
    slept.clear()
    free = replay.Pace(None, lambda: now[0], sleep)
    free.wait(0)
    free.wait(10**12)
    assert slept == []


def test_a_log_replayed_on_a_pty_gives_the_frames_that_were_logged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put = records(3000)
    path = write(tmp_path, put)
    link = tmp_path / "probe"
    words = ["replay", str(path), "--speed", "max", "--link", str(link)]
    playing = threading.Thread(target=cli.main, args=(words,))
    playing.start()
    while not link.is_symlink():
        assert playing.is_alive()
    probe = HeardProbe("left")
    session = Session(lambda _: probe, None, probe)
    found: list[bytes] = []
    port = os.open(link, os.O_RDONLY | os.O_NOCTTY)
    try:
        while len(found) < len(put):
            events = session.receive(b"\0" * (not found) + os.read(port, 4096), None)
            found += [each.content for each in events if isinstance(each, Received)]
    finally:
        os.close(port)
    playing.join()
    assert found == [record.content for record in put]
    assert session.corrupt.total() == 0
    assert not link.exists()
    assert "probe left is on" in capsys.readouterr().out


def test_a_log_replayed_into_a_daemon_is_heard_as_a_probe(tmp_path: Path) -> None:
    probe = FakeProbe()
    put = records(200, probe)
    hello = probe.content("hello")
    last = put[-1]
    put.append(msgspec.structs.replace(last, topic="hello", payload=b"", content=hello))
    path = write(tmp_path / "in", put)
    link = tmp_path / "probe"
    words = ["replay", str(path), "--speed", "max", "--link", str(link)]
    playing = threading.Thread(target=cli.main, args=(words,))
    playing.start()
    while not link.is_symlink():
        assert playing.is_alive()
    with DaemonProcess(link, directory=tmp_path) as daemon:
        daemon.expect("probe 00112233445566aa found")
        playing.join()
        daemon.stop()
        assert frames(daemon.log) == [record.content for record in put]


def test_a_log_replayed_over_zenoh_is_what_was_published(tmp_path: Path) -> None:
    put = records(300)
    path = write(tmp_path / "in", put)
    link = tmp_path / "none"
    with DaemonProcess(link, directory=tmp_path, log=False) as daemon:
        daemon.expect("listens on")
        with Client(daemon.endpoint) as client, Client(daemon.endpoint) as player:
            heard: list[tuple[str, bytes]] = []
            key = "imud/left/*"
            subscriber = client.session.declare_subscriber(
                key, lambda s: heard.append((str(s.key_expr), s.payload.to_bytes()))
            )
            # Whoever subscribes is known to the router before it answers.
            client.statuses()
            what = replay.recording([path])
            assert replay.to_network(what, player, None) == 0
            subscriber_done = threading.Event()
            marker = client.session.declare_subscriber(
                "end", lambda _: subscriber_done.set()
            )
            client.statuses()
            player.session.put("end", b"")
            assert subscriber_done.wait(30)
            marker.undeclare()
            subscriber.undeclare()
    wanted = [("imud/left/frame", record.content) for record in put]
    assert [each for each in heard if each[0].endswith("frame")] == wanted
    poses = [("imud/left/pose", r.payload) for r in put if r.topic == "pose"]
    assert [each for each in heard if each[0].endswith("/pose")] == poses


def test_of_several_probes_one_is_chosen_for_a_link(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, records(3, name="left"), records(3, name="right"))
    assert cli.main(["replay", str(path), "--link", str(tmp_path / "x")]) == 1
    assert "choose one with --probe" in capsys.readouterr().err
    assert cli.main(["replay", str(path), "--probe", "up"]) == 1
    assert "no probe up; there is left, right" in capsys.readouterr().err


def test_a_log_of_another_schema_is_not_given_out_as_of_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The seed of a frame's CRC would say that it is."""
    path = write(tmp_path, records(3))
    monkeypatch.setattr(schema, "FINGERPRINT", schema.FINGERPRINT ^ 1)
    assert cli.main(["replay", str(path)]) == 1
    assert "is of another schema than this imud" in capsys.readouterr().err


def test_an_endpoint_without_a_network_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, records(3))
    assert cli.main(["replay", str(path), "--connect", free_endpoint()]) == 1
    assert capsys.readouterr().err.startswith("imud: no imud at")


def test_the_defaults_of_the_sink_and_of_the_configuration_are_one() -> None:
    from imud.config.settings import Log

    log, settings = Log(), Settings()
    assert settings.rotate_s == log.rotate_minutes * 60
    assert settings.has_foxglove == log.foxglove
