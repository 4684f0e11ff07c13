# SPDX-License-Identifier: MIT
"""The log: what goes in comes out, to the end or to a quarter second before a kill."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from fakes import FakeProbe
from imud import cli
from imud.errors import FileError
from imud.log.file import Settings
from imud.log.reader import Logged, LogHead
from imud.probes.record import Presence, Record
from imud.sinks.log import LogSink
from imud.wire import schema
from log_files import read_log

# Puts records through the hub as the daemon does, 200 a second, and says the time of
# each as soon as it has put it.
WRITER = """
import sys, time
from pathlib import Path
from fakes import FakeProbe
from imud.daemon.hub import Hub
from imud.probes.record import Record
from imud.sinks.log import LogSink

hub, probe = Hub(), FakeProbe()
hub.add(LogSink(Path(sys.argv[1])))
hello = probe.content("hello")
while True:
    t_ns = time.time_ns()
    payload = b'{"type":"pose","t_ns":%d}' % t_ns
    sequence = probe.sequence
    content = probe.content("pose")
    hub.put(Record(probe.name, "pose", payload, content, sequence, t_ns, t_ns, hello))
    sys.stdout.write(f"{t_ns}\\n")
    sys.stdout.flush()
    time.sleep(0.005)
"""


def records(probe: FakeProbe, count: int) -> Iterator[Record]:
    hello = probe.content("hello")
    for number in range(count):
        content = probe.content("pose")
        payload = json.dumps({"n": number}).encode()
        yield Record(
            probe.name, "pose", payload, content, number, number + 1, number + 1, hello
        )


def logged(path: Path, topic: str) -> list[Logged]:
    found = [record for record in read_log(path) if isinstance(record, Logged)]
    return [record for record in found if record.topic == topic]


def test_what_is_logged_is_read_back_with_who_wrote_it(tmp_path: Path) -> None:
    sink, probe = LogSink(tmp_path / "deep" / "logs"), FakeProbe()
    sink.open()
    assert sink.path is not None
    put = list(records(probe, 50))
    for record in put:
        sink.write(record)
    sink.write(Presence(probe.name, is_alive=False))
    sink.write(Record(probe.name, "status", b"{}", b"", 0, 99, 99))
    sink.write(Record(probe.name, "reply", b"", put[0].content, 0, 99, 99))
    sink.flush()
    sink.close()
    head = next(read_log(sink.path))
    assert isinstance(head, LogHead)
    assert head.fingerprint == schema.FINGERPRINT
    assert [r.data for r in logged(sink.path, "pose")] == [r.payload for r in put]
    assert [(r.data, r.t_ns) for r in logged(sink.path, "frame")] == [
        *((r.content, r.t_ns) for r in put),
        (put[0].content, 99),
    ]
    assert [r.data for r in logged(sink.path, "hello")] == [put[0].hello]
    assert len(logged(sink.path, "status")) == 1


def test_a_log_that_is_cut_anywhere_gives_what_is_whole(tmp_path: Path) -> None:
    sink, probe = LogSink(tmp_path), FakeProbe()
    sink.open()
    sizes = []
    for count, record in enumerate(records(probe, 12), 1):
        sink.write(record)
        sink.flush()
        sizes.append((sink.path.stat().st_size, count))
    sink.close()
    whole = sink.path.read_bytes()
    cut = tmp_path / "cut.mcap"
    for size in range(8, sizes[-1][0], 7):
        cut.write_bytes(whole[:size])
        found: list[Logged | LogHead] = []
        with pytest.raises(FileError, match="is truncated"):
            for item in read_log(cut):
                found.append(item)
        frames = [r for r in found if isinstance(r, Logged) and r.topic == "frame"]
        assert len(frames) >= max((n for at, n in sizes if at <= size), default=0)


def test_two_logs_of_one_second_do_not_overwrite_each_other(tmp_path: Path) -> None:
    sinks = [LogSink(tmp_path) for _ in range(3)]
    for sink in sinks:
        sink.open()
    for sink in sinks:
        sink.close()
    assert len({sink.path for sink in sinks}) == 3


def test_a_file_an_hour_and_each_whole(tmp_path: Path) -> None:
    sink, probe = LogSink(tmp_path, Settings(rotate_s=0.0)), FakeProbe()
    sink.open()
    put = list(records(probe, 4))
    for record in put:
        sink.write(record)
        sink.flush()
    sink.close()
    files = sorted(tmp_path.iterdir())
    frames = [r for path in files for r in logged(path, "frame")]
    assert [r.t_ns for r in frames] == [r.t_ns for r in put]
    assert len(files) == 4


def test_a_place_that_takes_no_log_is_named(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(FileError, match=r"can't log to .*file.*--log DIR"):
        LogSink(file).open()


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(10))
def test_at_most_a_quarter_second_is_lost_by_kill_9(tmp_path: Path, seed: int) -> None:
    """Two writers at a time, each killed at a moment of its own."""
    counts = np.random.default_rng(seed).integers(60, 260, 2).tolist()
    folders = [tmp_path / str(number) for number in range(2)]
    with ThreadPoolExecutor(2) as pool:
        killed = list(pool.map(write_until_killed, folders, counts))
    for folder, put in zip(folders, killed, strict=True):
        (path,) = folder.iterdir()
        assert cli.main(["recover", str(path)]) == 0
        found = [each.t_ns for each in cut_off(path) if each.topic == "frame"]
        assert found == put[: len(found)]
        # A busy machine holds up the writer as it holds up the log.
        held_up_ns = max(after - before for before, after in pairwise(put))
        assert put[-1] - found[-1] <= 250_000_000 + held_up_ns
        saved = folder / f"{path.stem}-recovered.mcap"
        assert [each.t_ns for each in logged(saved, "frame")] == found


def write_until_killed(folder: Path, count: int) -> list[int]:
    """The times of the records that were put until it was killed."""
    here = Path(__file__).resolve().parents[2]
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(folder)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(here)},
    )
    with writer, writer.stdout:
        put = [int(writer.stdout.readline()) for _ in range(count)]
        writer.send_signal(signal.SIGKILL)
        put += [int(line) for line in writer.stdout if line.endswith("\n")]
    return put


def cut_off(path: Path) -> list[Logged]:
    """The contents of a truncated file."""
    found = []
    with pytest.raises(FileError, match="is truncated"):
        for item in read_log(path):
            if isinstance(item, Logged):
                found.append(item)
    return found
