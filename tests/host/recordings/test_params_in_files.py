# SPDX-License-Identifier: MIT
"""Samples are calibrated with the params of their probe and their moment, in captures,
logs, tables and cards.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from msgspec.structs import replace

from card_files import bare, laid, tape
from card_files import run as run_card
from fakes import FakeProbe
from fakes.records import calibrated_records, parts_of
from imud import _core, cli
from imud.log.reader import Logged
from imud.probes.record import Record, record_of
from imud.probes.session import Probe, Received, Session
from imud.recordings.decode import Tally, decode_file
from imud.recordings.info import info_of
from imud.wire.frame import encode_frame
from imud.wire.params import digest_of
from imud.wire.params import parts_of as values_of
from log_files import BEGIN_NS, PERIOD_NS, read_log, write

ONE, OTHER, THIRD = (calibrated_records(seed) for seed in (1, 2, 3))


def talk(probe: FakeProbe, before: bytes, after: bytes) -> list[bytes]:
    """The messages of a probe whose params change between its samples."""
    signed = digest_of(after) - ((digest_of(after) >> 31) << 32)
    probe.hello_fields = probe.hello_fields | {"params_digest": digest_of(before)}
    contents = [probe.content("hello"), *parts_of(probe, before, probe.content)]
    contents += [probe.content("raw") for _ in range(3)]
    contents += parts_of(probe, after, probe.content)
    contents.append(probe.content("event", event="params_changed", detail=signed))
    contents.append(probe.content("event", event="restarted", detail=1))
    probe.hello_fields = probe.hello_fields | {"params_digest": digest_of(after)}
    contents.append(probe.content("hello"))
    return contents + [probe.content("raw") for _ in range(2)]


def expected(hello: bytes, *records: bytes) -> list[tuple[Any, ...]]:
    """Digest and quantities of the example sample, under these params in turn."""
    found = []
    for each in records:
        raw = FakeProbe().content("raw")
        values = [list(v or ()) for v in _core.Calibrator(hello, each).apply(raw)]
        found.append((digest_of(each), *values))
    return found


def told_by(items: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    keys = ("params_digest", "acc_m_s2", "gyr_rad_s", "mag_uT")
    return [
        tuple(list(v) if isinstance(v, tuple) else v for v in map(item.get, keys))
        for item in items
        if item["type"] == "raw"
    ]


def decoded(path: Path) -> list[dict[str, Any]]:
    return list(decode_file(path, Tally()))


def records_of(name: str, contents: list[bytes]) -> list[Record]:
    """As the daemon makes them of what it reads at once."""
    probe = Probe(name)
    session = Session(lambda _: probe, 0)
    made = []
    data = b"".join(map(encode_frame, contents))
    for at, event in enumerate(session.receive(data, 0)):
        if isinstance(event, Received):
            t_ns = BEGIN_NS + at * PERIOD_NS
            stamp = replace(event.stamp, t_ns=t_ns, t_received_ns=t_ns)
            made.append(
                record_of(event.message, event.content, name, stamp, event.scales)
            )
    return made


def test_a_capture_is_calibrated_sample_by_sample(tmp_path: Path) -> None:
    contents = talk(FakeProbe(), ONE, OTHER)
    path = tmp_path / "capture"
    # Samples ahead of the first hello have the params of that.
    path.write_bytes(b"".join(map(encode_frame, contents)))
    wanted = expected(contents[0], *[ONE] * 3, *[OTHER] * 2)
    assert told_by(decoded(path)) == wanted
    assert wanted[0] != wanted[-1]


def test_two_probes_in_a_log_have_each_their_own_params(tmp_path: Path) -> None:
    left = talk(FakeProbe(), ONE, OTHER)
    right = talk(FakeProbe(probe_id=bytes(range(8))), OTHER, THIRD)
    batches = [records_of("left", left), records_of("right", right)]
    mixed = [each for pair in zip(*batches, strict=True) for each in pair]
    path = write(tmp_path, mixed)
    items = decoded(path)
    by_name = {n: [i for i in items if i["probe"] == n] for n in ("left", "right")}
    of_left = expected(left[0], *[ONE] * 3, *[OTHER] * 2)
    assert told_by(by_name["left"]) == of_left
    of_right = expected(left[0], *[OTHER] * 3, *[THIRD] * 2)
    assert told_by(by_name["right"]) == of_right
    # The JSON that was logged says the same.
    logged = [
        json.loads(each.data)
        for each in read_log(path)
        if isinstance(each, Logged) and (each.probe, each.topic) == ("left", "raw")
    ]
    assert told_by(logged) == of_left
    assert cli.main(["export", str(path), "--to", "csv"]) == 0
    (table,) = tmp_path.glob("*-left-raw.csv")
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["params_digest"]) for row in rows] == [row[0] for row in of_left]
    assert [float(row["acc_y_m_s2"]) for row in rows] == [row[1][1] for row in of_left]


def test_a_log_that_begins_later_knows_the_params_all_the_same(tmp_path: Path) -> None:
    contents = talk(FakeProbe(), ONE, OTHER)
    every = records_of("left", contents)
    begin = next(at for at, each in enumerate(every) if each.topic == "raw") + 1
    path = write(tmp_path, every[begin:])
    with path.open("rb") as file:
        found = [
            each.metadata
            for each in make_reader(file).iter_metadata()
            if each.name == "params"
        ]
    assert [bytes.fromhex(each["content"]) for each in found] == [ONE, OTHER]
    assert [int(each["digest"], 16) for each in found] == [
        *map(digest_of, (ONE, OTHER))
    ]
    wanted = expected(contents[0], *[ONE] * 2, *[OTHER] * 2)
    assert told_by(decoded(path)) == wanted


def test_samples_whose_params_are_not_known_have_counts_alone() -> None:
    probe = FakeProbe(params_digest=digest_of(ONE))
    contents = [probe.content("hello"), probe.content("raw")]
    (raw,) = [each for each in records_of("left", contents) if each.topic == "raw"]
    assert told_by([dict(raw.values)]) == [(None, None, None, None)]
    assert raw.values["acc_counts"] == (0, -16, 2048)
    assert raw.params is None


@pytest.mark.parametrize("records", [b"\x01", b"\x05\x02\x09\x00"])
def test_params_that_this_firmware_would_refuse_calibrate_nothing(
    records: bytes,
) -> None:
    probe = FakeProbe(params_digest=digest_of(records))
    contents = [probe.content("hello"), *parts_of(probe, records, probe.content)]
    contents.append(probe.content("raw"))
    *_, raw = records_of("left", contents)
    assert told_by([dict(raw.values)]) == [(None, None, None, None)]
    assert raw.params == records


def test_a_cards_log_is_calibrated_sample_by_sample(tmp_path: Path) -> None:
    contents = talk(FakeProbe(), ONE, OTHER)
    card = bare(tmp_path, laid([tape(contents)], 0x1234))
    wanted = expected(contents[0], *[ONE] * 3, *[OTHER] * 2)
    assert told_by(decoded(card)) == wanted
    assert run_card("read", card, "--to", tmp_path / "logs") == 0
    (log,) = (tmp_path / "logs").iterdir()
    assert told_by(decoded(log)) == wanted


def test_info_shows_which_params_were_in_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = THIRD[: len(THIRD) // 3]  # whatever it is, it is not in the log
    left = records_of("left", talk(FakeProbe(), ONE, OTHER))
    probe = FakeProbe(params_digest=digest_of(other))
    right = records_of("right", [probe.content("hello"), probe.content("raw")])
    plain = records_of("plain", [FakeProbe().content("hello")])
    path = write(tmp_path, left, right, plain)
    found = {each["probe"]: each["params"] for each in info_of(path)["probes"]}
    assert found["left"] == [
        {
            "digest": f"{digest_of(each):#010x}",
            "bytes": len(each),
            "calibrated": ["acc", "gyr", "mag"],
        }
        for each in (ONE, OTHER)
    ]
    assert cli.main(["info", str(path)]) == 0
    shown = capsys.readouterr().out
    size = len(ONE)
    assert (
        f"params {digest_of(ONE):#010x}: {size} bytes, calibrate acc, gyr, mag" in shown
    )
    assert f"params {digest_of(other):#010x}, not in the log" in shown
    assert "params none: uncalibrated" in shown


def test_records_are_read_as_far_as_they_are_known_and_whole() -> None:
    known = values_of(ONE)
    assert list(known) == ["acc", "gyr", "mag"]
    assert known["acc"]["sigma"] == 0.025
    assert known["mag"]["norm"] == 48.2
    # A shorter record of an older writer, a record of a later one, a torn end.
    acc = bytes((1, 30)) + ONE[2:32]
    later = bytes((77, 2, 9, 9))
    options = bytes((5, 2, 9, 1))  # a number without a name
    found = values_of(acc + later + options + ONE[41:60])
    assert list(found) == ["acc", "options"]
    assert found["acc"]["matrix"] == known["acc"]["matrix"]
    assert found["acc"]["sigma"] is None
    assert found["options"] == {"button_does": None, "reference": "heading"}
