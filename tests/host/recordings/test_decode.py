# SPDX-License-Identifier: MIT
"""`imud decode`: captures and logs, whole and damaged, for people and as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from fakes import FakeProbe
from imud import cli
from imud.probes.record import Record
from imud.recordings import decode
from imud.sinks.log import LogSink
from imud.wire import schema
from log_files import records, write


def decoded(
    path: Path, capsys: pytest.CaptureFixture[str], code: int = 0
) -> tuple[list[dict[str, Any]], str]:
    assert cli.main(["decode", str(path), "--json"]) == code
    captured = capsys.readouterr()
    return [json.loads(line) for line in captured.out.splitlines()], captured.err


def capture(path: Path, data: bytes) -> Path:
    file = path / "capture.bin"
    file.write_bytes(data)
    return file


def test_a_pose_is_as_promised_to_the_letter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe()
    data = probe.say("pose") + probe.say(
        "pose",
        q=(1.0, 0.0, 0.0, 0.0),
        position=(0.001, -0.25, 1.5),
        normal=(0.0, 0.0, 1.0),
        tilt_sigma=None,
        heading_sigma=None,
        pose_flags=("starting", "tared"),
    )
    cli.main(["decode", str(capture(tmp_path, data + probe.say("hello"))), "--json"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == (
        '{"type":"pose","probe":"00112233445566aa","seq":0,"number":1,"missing":0,'
        '"t_device_us":0,"t_ns":null,"t_bound_us":null,"age_us":null,"q":[0.5,0.5,-0.5,0.5],"position_m":null,"normal":null,'
        '"tilt_sigma_deg":0.37,"heading_sigma_deg":1.25,"flags":["at_rest"],'
        '"since_origin":null}'
    )
    assert lines[1] == (
        '{"type":"pose","probe":"00112233445566aa","seq":1,"number":2,"missing":0,'
        '"t_device_us":5000,"t_ns":null,"t_bound_us":null,"age_us":null,"q":[1.0,0.0,0.0,0.0],"position_m":[0.001,-0.25,1.5],'
        '"normal":[0.0,0.0,1.0],"tilt_sigma_deg":null,"heading_sigma_deg":null,'
        '"flags":["starting","tared"],"since_origin":{"heading_sigma_deg":null,'
        '"tilt_sigma_deg":null,"age_s":null,"void":"unheard"}}'
    )


def test_what_follows_in_the_same_bytes_does_not_reach_back(tmp_path: Path) -> None:
    probe = FakeProbe()
    tared = probe.say("event", event="tared", cause="command", detail=0)
    poses = b"".join(probe.say("pose", pose_flags=("tared",)) for _ in range(3))
    data = probe.say("hello") + tared + poses
    probe.restart()
    data += probe.say("hello") + probe.say("pose", pose_flags=("tared",))
    items = decode.decode_file(capture(tmp_path, data), decode.Tally())
    found = [item["since_origin"].void for item in items if item["type"] == "pose"]
    assert found == [None, None, None, "unheard"]


def test_a_number_without_words_goes_by_its_name(tmp_path: Path) -> None:
    data = FakeProbe().say("pose")
    (pose,) = decode.decode_file(capture(tmp_path, data), decode.Tally())
    assert "vibration_m_s2" not in decode.words(pose)
    line = decode.words(pose | {"vibration_m_s2": 0.5})
    assert line.endswith("1.25  vibration_m_s2 0.5  at_rest")


def test_raw_is_in_si_and_in_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe()
    data = probe.say("raw") + probe.say("raw", mag=None) + probe.say("hello")
    (first, second, _), _ = decoded(capture(tmp_path, data), capsys)
    assert first == {
        "type": "raw",
        "probe": probe.name,
        "seq": 0,
        "number": 1,
        "missing": 0,
        "t_device_us": 0,
        "t_ns": None,
        "t_bound_us": None,
        "age_us": None,
        # To one step of the firmware's fixed point.
        "acc_m_s2": pytest.approx([0, -16 * 0.004788403, 2048 * 0.004788403], abs=2e-6),
        "gyr_rad_s": pytest.approx([0.001065264, -0.002130528, 0.003195792], abs=6e-8),
        "mag_uT": pytest.approx([1.5, -3.0, 45.0], abs=8e-6),
        "params_digest": 0,
        "temperature_c": 23.45,
        "acc_counts": [0, -16, 2048],
        "gyr_counts": [1, -2, 3],
        "mag_counts": [10, -20, 300],
        "flags": [],
    }
    assert (second["mag_uT"], second["mag_counts"]) == (None, None)


def test_without_a_hello_raw_has_no_scale_and_the_probe_no_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe()
    data = probe.say("raw") + probe.say("pose")
    (raw, pose), _ = decoded(capture(tmp_path, data), capsys)
    assert (raw["acc_m_s2"], raw["acc_counts"]) == (None, [0, -16, 2048])
    assert raw["probe"] == pose["probe"] == "unknown"


@pytest.mark.parametrize(
    ("name", "field", "value"),
    [
        ("hello", "probe_id", "00112233445566aa"),
        ("hello", "reset_cause", ["power_on"]),
        ("event", "event", "stream_started"),
        ("event", "cause", "button"),
        ("status", "state", "streaming"),
        ("status", "supply", None),
        ("reply", "result", "ok"),
        ("reply", "value", [0, 0]),
    ],
)
def test_all_else_goes_by_the_names_of_the_schema(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    field: str,
    value: Any,
) -> None:
    data = FakeProbe().say(name)
    (item,), _ = decoded(capture(tmp_path, data), capsys)
    assert list(item)[:4] == ["type", "probe", "seq", "number"]
    assert list(item)[5:9] == ["t_device_us", "t_ns", "t_bound_us", "age_us"]
    assert list(item)[9:] == [
        f.name for m in schema.MESSAGES if m.name == name for f in m.fields
    ]
    assert item["type"] == name
    assert item[field] == value


def test_damage_is_counted_at_the_end_and_ends_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe()
    whole = probe.say("hello") + probe.poses(5)
    struck = bytearray(probe.say("pose"))
    struck[-8] ^= 0x10
    data = b"\x05junk\0" + whole + bytes(struck) + b"\x09\0" + probe.poses(2) * 2
    items, report = decoded(capture(tmp_path, data), capsys)
    assert [item["seq"] for item in items] == [0, 1, 2, 3, 4, 5, 7, 8]
    assert report.splitlines() == [
        f"{probe.name}: 9 sent = 8 received + 0 skewed + 1 lost; 2 duplicated, "
        "0 stray, 1 boot",
        f"{len(data)} bytes, 10 frames, 2 corrupt (1 bad_cobs, 1 bad_crc), "
        "the first truncated",
    ]


def test_a_log_gives_the_very_same_and_the_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe, other = FakeProbe(), FakeProbe()
    hello = other.content("hello")
    sink = LogSink(tmp_path / "logs")
    sink.open()
    data = probe.say("hello")
    for name in ("raw", "pose", "event", "status"):
        data += probe.say(name)
        sequence, content = other.sequence, other.content(name)
        t_ns = 1000 + sequence
        payload = b"{}" if name == "pose" else b""
        sink.write(
            Record("stylus", name, payload, content, sequence, t_ns, t_ns, hello)
        )
    sink.close()
    assert sink.path is not None
    from_capture, _ = decoded(capture(tmp_path, data), capsys)
    from_log, report = decoded(sink.path, capsys)
    assert [item["t_ns"] for item in from_log] == [1001, 1002, 1003, 1004]
    for item in from_log:
        item.update(t_ns=None, age_us=None, probe=probe.name)
    assert from_log == from_capture[1:]
    assert report == (
        "stylus: 4 sent = 4 received + 0 skewed + 0 lost; "
        "0 duplicated, 0 stray, 1 boot\n"
    )


def test_a_log_that_was_cut_says_so_and_gives_the_rest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe()
    sink = LogSink(tmp_path)
    sink.open()
    hello = probe.content("hello")
    sink.write(Record("p", "pose", b"{}", probe.content("pose"), 1, 5, 5, hello))
    sink.flush()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(sink.path.read_bytes())
    sink.close()
    items, report = decoded(cut, capsys)
    assert len(items) == 1
    assert "the log is truncated: imud was killed, or is still writing it" in report


def test_damaged_places_cost_what_they_hit_and_are_no_loss_of_the_wire(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every reader of logs continues behind them, says so, and ends with 1."""
    put = records(300)
    path = write(tmp_path, *(put[at : at + 20] for at in range(0, 300, 20)))
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    data = bytearray(path.read_bytes())
    for number in (4, 9):
        data[summary.chunk_indexes[number].chunk_start_offset + 100] ^= 0x10
    path.write_bytes(data)
    assert cli.main(["decode", str(path), "--json"]) == 1
    captured = capsys.readouterr()
    kept = len(captured.out.splitlines())
    assert 300 - 40 <= kept < 300
    *counts, last = captured.err.splitlines()
    assert last == (
        f"imud: {path} is damaged in 2 places; the intact part was read, imud recover "
        "saves it"
    )
    damaged = 300 - kept
    words = f"300 sent = {kept} received + 0 skewed + 0 lost + {damaged} damaged"
    assert any(words in line for line in counts)
    assert cli.main(["info", str(path)]) == 1
    captured = capsys.readouterr()
    assert words in captured.out
    assert "damaged in 2 places" in captured.err
    out = ["--out", str(tmp_path / "tables")]
    assert cli.main(["export", str(path), *out]) == 1
    assert "damaged in 2 places" in capsys.readouterr().err


def test_one_flip_in_what_recover_wrote_costs_no_more_than_in_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put = records(400)
    path = write(tmp_path, *(put[at : at + 20] for at in range(0, 400, 20)))
    path.write_bytes(path.read_bytes()[:-30])
    assert cli.main(["recover", str(path)]) == 0
    (saved,) = tmp_path.glob("*-recovered.mcap")
    data = bytearray(saved.read_bytes())
    data[len(data) // 3] ^= 1
    saved.write_bytes(data)
    capsys.readouterr()
    assert cli.main(["decode", str(saved), "--json"]) == 1
    assert len(capsys.readouterr().out.splitlines()) >= 380


def test_a_log_that_is_being_written_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sink = LogSink(tmp_path)
    sink.open()
    for record in records(5):
        sink.write(record)
    sink.flush()
    assert cli.main(["info", str(sink.path)]) == 0
    assert "MB, being written; by imud" in capsys.readouterr().out
    sink.close()
    assert cli.main(["info", str(sink.path)]) == 0
    assert "MB, whole; by imud" in capsys.readouterr().out


def test_a_capture_of_another_schema_is_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe(schema_fingerprint=schema.FINGERPRINT ^ 1)
    items, report = decoded(capture(tmp_path, probe.say("hello")), capsys, code=1)
    assert items == []
    assert f"has schema {schema.FINGERPRINT ^ 1:#010x} (firmware 0.1.0+fake)" in report


def test_words_for_people(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    probe = FakeProbe()
    data = probe.say("hello") + probe.say("event") + probe.say("raw")
    data += probe.say("pose", q=(1.0, 0.0, 0.0, 0.0), position=(0.1, 0.2, 0.3))
    path = capture(tmp_path, data)
    assert cli.main(["decode", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "firmware 0.1.0+fake, board nano" in lines[0]
    assert lines[1].endswith("event stream_started, cause button, detail 0")
    assert "acc (0.000, -0.077, 9.807) m/s2" in lines[2]
    assert "23.4 degC" in lines[2] or "23.5 degC" in lines[2]
    assert "yaw    0.00  pitch   0.00  roll    0.00 deg  tilt ±  0.37" in lines[3]
    assert "at (0.1000, 0.2000, 0.3000) m  at_rest" in lines[3]
