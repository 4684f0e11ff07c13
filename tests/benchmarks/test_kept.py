# SPDX-License-Identifier: MIT
"""What stays of a benchmark's results, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import kept
from benchmarks.calibration import parts
from benchmarks.limb import parts as limb


def test_each_results_file_is_written_by_a_benchmark() -> None:
    for path in kept.FOLDER.glob("*.json"):
        command = json.loads(path.read_text("utf-8"))["command"]
        if path.stem == "proof":
            assert command == "python tools/prove.py --force"
        else:
            assert command == f"make bench WHAT={kept.KEPT[path.stem].what}"


@pytest.mark.parametrize(
    ("part", "found"),
    [
        (kept.recordings, {"trials": [], "body_bias_ut": 0.0}),
        (kept.motions, {"sets": {"judging": {}}}),
        (kept.desk, {"judging": {}}),
        (kept.grounds, {"sets": {"judging": {"groups": {}}, "tuning": {}}}),
        (kept.cycles, {"seconds": 30.0}),
        (kept.micropython, {"seconds": 3.0}),
        (kept.pico, {"seconds": 9.0}),
        (kept.motions_further, {"29 to 55": {"nano": {"recordings": 140}}}),
        (kept.aims, {"seeds": 2}),
        (kept.faults, {"failed": 1}),
        (
            kept.since_origin,
            {"set": "judging", "every": 1, "runs": 6, "lines": [{"motion": "aim"}]},
        ),
        (kept.positions, {"runs": 3, "rows": {}}),
        (parts.cases, {"tuning": {}}),
        (parts.cases, {"judging": {"modules": 4}}),
        (parts.crowd, {"judging": {"recordings": 999}}),
        (parts.shops, {"judging": {"modules": 1}}),
        (parts.rough, {"judging": {"modules": 5}}),
        (parts.warm, {"set": "judging", "modules": 2}),
        (parts.turns, {"tuning": []}),
        (limb.legs, {"walk_s": 9.0}),
        (limb.legs, {"walk_s": 60.0, "sets": {"judging": {"legs": 10}}}),
        (limb.chains, {"seconds": 60.0, "sets": {"tuning": {}}}),
        (limb.feet, {"judging": {"stroll": {"feet": 3}}}),
    ],
)
def test_partial_results_are_refused(part, found) -> None:
    with pytest.raises(kept.NotWholeError):
        part(found)


def test_right_verdicts_are_counted_by_fault_hand_and_angle() -> None:
    faults = ("nothing wrong", "iron", "another", "scale", "bias")
    found = [
        {"fault": fault, "hand": hand, "turn_deg": degrees, "verdict": verdict}
        for fault in faults
        for hand in ("turn", "wedge")
        for degrees in (30.0, 90.0)
        for verdict in ["good"] * 5 + ["fault"] * 20
    ]
    part = parts.turns({"judging": found})
    assert part["turns"] == 25
    assert part["right"]["nothing wrong"]["turn"] == {"30": 20.0, "90": 20.0}
    assert part["right"]["iron"]["wedge"]["90"] == 80.0
    with pytest.raises(kept.NotWholeError):
        parts.turns({"judging": found[:-1]})


def test_floats_are_rounded_and_counts_are_not() -> None:
    found = {"a": [0.123456789, 12345678, None, "x"], "b": {"c": 1234567.8}}
    assert kept.rounded(found) == {
        "a": [0.123457, 12345678, None, "x"],
        "b": {"c": 1234570.0},
    }


def test_only_results_of_this_run_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(kept, "RESULTS", tmp_path)
    monkeypatch.setattr(kept, "FOLDER", kept.PROJECT / "build" / "kept-by-a-test")
    source = tmp_path / "cycles.json"
    source.write_text(
        json.dumps({"seconds": 120.0, "figures": {}, "summary": {}, "commanded": []})
    )
    written = source.stat().st_mtime
    kept.keep_all("nano", written + 1.0)
    kept.keep_all("accuracy", written)
    assert capsys.readouterr().out == ""
    kept.keep_all("nano", written)
    assert capsys.readouterr().out == "kept: build/kept-by-a-test/nano.json\n"
    # Partial ones are left as they were, and say so.
    source.write_text('{"seconds": 1.0}')
    kept.keep_all("nano", written)
    assert capsys.readouterr().out.startswith("not kept: cycles.json is partial")
    (file,) = kept.FOLDER.iterdir()
    assert json.loads(file.read_text())["command"] == "make bench WHAT=nano"
    file.unlink()
    kept.FOLDER.rmdir()
