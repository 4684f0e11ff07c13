# SPDX-License-Identifier: MIT
"""`imud card read` and `list`: what a probe wrote comes back message by message."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from msgspec.structs import replace

from card_files import (
    Terminal,
    bare,
    blocks_of,
    contents_of,
    frames_of,
    laid,
    lines_of,
    logs_in,
    partition_of,
    place_of,
    prepared,
    run,
    tape,
    with_log,
)
from fakes import FakeProbe
from imud import cli
from imud.log.reader import Logged
from imud.probes.record import record_of
from imud.probes.session import Probe, Received, Session
from imud.sinks.log import LogSink
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import decode
from log_files import read_log


def test_what_a_probe_wrote_comes_back_message_by_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe(board="f405")
    contents = contents_of(probe, 3000)
    path = with_log(prepared(tmp_path / "card.img"), laid([tape(contents)]))
    capsys.readouterr()
    assert run("read", path, "--to", tmp_path / "logs") == 0
    card_id = place_of(path)[2]
    (log,) = (tmp_path / "logs").iterdir()
    assert log.name == f"card-{card_id:08x}-{probe.name}-1.mcap"
    assert frames_of(log) == contents
    first, second, third = lines_of(capsys)
    written = len(tape(contents).payloads)
    blocks = place_of(path)[1] // 512 - 1
    assert first == (
        f"card {card_id:08x}: 1 recording, {written} of {blocks} blocks written, "
        "0 torn or worn"
    )
    assert second == (
        f"recording 1: probe {probe.name}, 0:00:15.0, 1125 raw, 1125 pose, "
        f"3001 sent = 3001 received + 0 skewed + 0 lost, ended cleanly: {log}"
    )
    assert third.startswith("times are the device's, from 1970 on; --started UTC")


def test_a_log_of_a_card_is_the_live_log_of_the_same_messages(tmp_path: Path) -> None:
    contents = contents_of(FakeProbe(), 200)
    path = bare(tmp_path, laid([tape(contents)], 0x1234))
    assert run("read", path, "--to", tmp_path / "card") == 0
    # As the daemon does it.
    sink = LogSink(tmp_path / "live")
    sink.open()
    probe = Probe(FakeProbe().name)
    session = Session(lambda _: probe, 0)
    for event in session.receive(b"".join(map(encode_frame, contents)), 0):
        if isinstance(event, Received):
            t_ns = event.stamp.t_device_us * 1000
            stamp = replace(event.stamp, t_ns=t_ns, t_received_ns=t_ns)
            sink.write(
                record_of(
                    *(event.message, event.content, probe.probe_id, stamp),
                    event.scales,
                    references=probe.references,
                )
            )
    sink.close()

    def told(folder: Path) -> tuple[list[Any], list[Any]]:
        (log,) = folder.iterdir()
        with log.open("rb") as file:
            reader = make_reader(file)
            records = [
                (
                    *(channel.topic, channel.message_encoding, spec and spec.name),
                    *(spec and spec.data, message.data, message.log_time),
                    *(message.publish_time, message.sequence),
                )
                for spec, channel, message in reader.iter_messages()
            ]
            metadata = [
                (each.name, each.metadata)
                for each in reader.iter_metadata()
                if each.name != "origin"  # of the daemon's logs alone
            ]
        return records, metadata

    live, card_made = told(tmp_path / "live"), told(tmp_path / "card")
    # Raw and pose are there as JSON, too, and 75 poses as Foxglove draws them.
    assert len(live[0]) == len(contents) + 150 + 75
    assert card_made == live


def test_several_probes_on_one_card_are_a_log_each(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probes = [FakeProbe(), FakeProbe(probe_id=bytes(range(8)), boot_count=9)]
    probes.append(probes[0])
    tapes = [tape(contents_of(p, 30 + 10 * n)) for n, p in enumerate(probes)]
    path = with_log(prepared(tmp_path / "card.img"), laid(tapes))
    run("read", path, "--to", tmp_path)
    logs = logs_in(tmp_path)
    for number, (probe, each) in enumerate(zip(probes, tapes, strict=True), 1):
        assert probe.name in logs[number].name
        assert frames_of(logs[number]) == [message.content for message in each.messages]
    capsys.readouterr()
    assert run("list", path) == 0
    rows = [re.split(r"  +", line) for line in lines_of(capsys)[1:]]
    assert rows == [
        ["recording", "probe", "duration", "samples", "lost", "bad", "end"],
        *(
            [
                *(str(n), p.name, f"0:00:{len(t.messages[1:]) * 0.005:04.1f}"),
                str(
                    sum(decode(message.content).name == "raw" for message in t.messages)
                ),
                *(f"0 of {len(t.messages)}", "0 blocks", "ended cleanly"),
            ]
            for n, (p, t) in enumerate(zip(probes, tapes, strict=True), 1)
        ),
    ]


def test_one_recording_can_be_read_alone_and_dated(tmp_path: Path) -> None:
    late = FakeProbe()
    late.time_us = 4_294_900_000  # a wrap of device time is in the recording
    path = bare(tmp_path, blocks_of([FakeProbe(), late], 0x1234))
    began = "2026-01-02T03:04:05.5Z"
    to = tmp_path / "logs"
    assert run("read", path, "--to", to, "--recording", 2, "--started", began) == 0
    assert list(logs_in(to)) == [2]
    times = [i.t_ns for i in read_log(logs_in(to)[2]) if isinstance(i, Logged)]
    times = [t_ns for t_ns in times if t_ns]  # metadata has none
    began_ns = 1767323045_500_000_000
    assert min(times) == began_ns
    assert max(times) == began_ns + 40 * 5_000_000


def test_what_was_read_before_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tapes = [tape(contents_of(FakeProbe())) for _ in range(2)]
    run("read", bare(tmp_path, laid(tapes[:1], 0x1234)), "--to", tmp_path)
    before = logs_in(tmp_path)[1]
    before.write_bytes(b"mine")
    run("read", bare(tmp_path, laid(tapes, 0x1234)), "--to", tmp_path)
    assert before.read_bytes() == b"mine"
    assert frames_of(logs_in(tmp_path)[2]) == [
        message.content for message in tapes[1].messages
    ]
    assert f"recording 1: {before} already exists" in lines_of(capsys)


def test_decode_tells_of_a_card_and_of_its_logs_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bare(tmp_path, blocks_of([FakeProbe(), FakeProbe()], 0x1234))
    run("read", path, "--to", tmp_path)
    capsys.readouterr()

    def decoded(file: Path) -> tuple[list[dict[str, Any]], str]:
        assert cli.main(["decode", str(file), "--json"]) == 0
        captured = capsys.readouterr()
        items = [json.loads(line) for line in captured.out.splitlines()]
        return [item | {"t_ns": None, "age_us": None} for item in items], captured.err

    whole, told = decoded(path)
    logs = logs_in(tmp_path)
    assert whole == decoded(logs[1])[0] + decoded(logs[2])[0]
    assert len(whole) == 82
    name = FakeProbe().name
    for number in (1, 2):
        assert (
            f"recording {number} of {name}: 41 sent = 41 received + 0 skewed + 0 lost"
            in told
        )


def test_the_reader_in_the_docs_reads_it_too(tmp_path: Path, root: Path) -> None:
    (script,) = re.findall(
        r"```python\n(.*?)```", (root / "docs" / "f405.md").read_text(), re.DOTALL
    )
    tapes = [tape(contents_of(FakeProbe(), count)) for count in (90, 60)]
    bare(tmp_path, laid(tapes, 0x1234))
    subprocess.run([sys.executable, "-c", script], cwd=tmp_path, check=True)
    for number, each in enumerate(tapes, 1):
        data = (tmp_path / f"recording-{number}.bin").read_bytes()
        assert FrameDecoder().feed(data) == [
            message.content for message in each.messages
        ]


def test_a_copy_that_was_cut_short_gives_what_it_has(tmp_path: Path) -> None:
    each = tape(contents_of(FakeProbe(), 400))
    path = bare(tmp_path, laid([each], 0x1234))
    os.truncate(path, 20 * 512 + 100)
    run("read", path, "--to", tmp_path)
    assert frames_of(logs_in(tmp_path)[1]) == [
        message.content for message in each.messages if message.blocks.stop <= 19
    ]


def test_a_bare_partition_is_read_as_well(tmp_path: Path) -> None:
    whole = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    part = partition_of(whole, tmp_path / "part.img")
    assert run("read", part, "--to", tmp_path) == 0
    assert len(frames_of(logs_in(tmp_path)[1])) == 41


def test_a_recording_of_another_schema_is_named_and_the_others_are_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = FakeProbe(schema_fingerprint=0x12345678, firmware="9.9.9")
    path = bare(tmp_path, blocks_of([other, FakeProbe()], 0x1234))
    assert run("read", path, "--to", tmp_path) == 1
    captured = capsys.readouterr()
    assert "recording 1: probe 00112233445566aa has schema 0x12345678" in captured.out
    assert captured.err == f"imud: 1 recording of {path} can't be read\n"
    assert list(logs_in(tmp_path)) == [2]


def test_a_bar_is_shown_on_a_terminal_and_taken_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    path = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    run("read", path, "--to", tmp_path)
    drawn = screen.getvalue()
    for label in ("preparing", "looking", "reading"):
        assert f"{label} " in drawn
    assert drawn.endswith("\r\033[K")
