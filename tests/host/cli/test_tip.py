# SPDX-License-Identifier: MIT
"""`imud calibrate tip`: with a daemon and a fake probe, from captures, from a rule."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from chain import Chain
from fakes import FakeProbe
from imud import rotation
from imud.calibration.algebra import turn
from imud.calibration.tip import guide as tip_guide
from imud.calibration.tip.guide import Dimpling
from imud.calibration.tip.result import result_of_tip
from imud.calibration.tip_found import TipFound
from imud.cli import calibrate_source, main
from imud.cli.calibrate_tip import read
from imud.cli.calibrate_tip_screen import tip_lines
from imud.errors import FileError
from imud.virtual.calibrating import SCALE
from imud.virtual.dimpling import Wobble
from raw_probe import RATES, Desk, Stream, capture
from wobbled import CALIBRATED, TIP, wobbled


@pytest.fixture(autouse=True)
def _seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tip_guide, "FIT_S", 2.5)
    monkeypatch.setattr(calibrate_source, "HEARD_S", 0.3)


@pytest.fixture
def desk(bench: Chain, capsys: pytest.CaptureFixture[str]) -> Desk:
    if bench.probe.params.records != CALIBRATED.encode():
        with Stream(bench, ()):
            bench.client.change_params(bench.probe.name, CALIBRATED.encode())
    return Desk(bench, capsys, "calibrate", "tip")


def test_a_tip_is_found_put_in_force_and_undone(desk: Desk) -> None:
    with Stream(desk.chain, wobbled(Wobble(), 32.0)):
        code, out, err = desk.run(desk.probe, "--axis", "-2", "0", "0")
        assert (code, err) == (0, "")
        lines = out.splitlines()
        assert lines[0] == "Stand the tip in a dimple and hold the probe still."
        assert lines[1].startswith("Wobble it about the tip: 20 degrees")
        assert f"{desk.probe}: calibrated from 15 s of wobbling" in out
        assert "tip            118." in out
        assert "mm (95 %)" in out
        tip = desk.in_force.tip
        assert tip.offset_m == pytest.approx(TIP, abs=0.0015)
        assert tip.axis == (-1.0, 0.0, 0.0)
        assert tip.method == "dimple"
        assert 0.0001 < tip.sigma_m < 0.001
        assert desk.in_force.acc == CALIBRATED.acc
        assert main(["calibrate", "undo", "--connect", desk.chain.daemon.endpoint]) == 0
        assert desk.in_force == CALIBRATED


def test_a_rule_is_enough(desk: Desk) -> None:
    offset = ("--method", "tape", "--offset-mm", "120", "0", "-15")
    with Stream(desk.chain, ()):
        assert desk.run(*offset, "--dry-run")[0] == 0
        assert desk.in_force == CALIBRATED
        code, out, _ = desk.run(desk.probe, *offset, "--error-mm", "3")
    assert code == 0
    assert "tip            120.0 0.0 -15.0 mm from the sensor, +-8.4 mm (95 %)" in out
    tip = desk.in_force.tip
    assert tip.offset_m == pytest.approx((0.12, 0.0, -0.015), abs=1e-6)
    assert (tip.sigma_m, tip.method) == (pytest.approx(0.003), "measured")


def poses(path: Path, count: int, *, has_attitudes: bool = True) -> Path:
    """A table of exact positions about a tip."""
    random = np.random.default_rng(count)
    attitudes = turn(random.normal(0.0, 0.3, (count, 3)))
    places = [0.1, 0.2, 0.3] - attitudes @ TIP
    rows = np.hstack([places, rotation.from_matrix(attitudes)])
    head = "x_m,y_m,z_m,qw,qx,qy,qz"
    if not has_attitudes:
        rows, head = rows[:, :3], "x_m,y_m,z_m"
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.12g")
    return path


def test_positions_and_attitudes_give_the_tip(desk: Desk, tmp_path: Path) -> None:
    table = poses(tmp_path / "poses.csv", 20)
    with Stream(desk.chain, ()):
        code, out, _ = desk.run("--method", "sphere", "--positions", table)
    assert code == 0
    assert "0.00 mm residual at 20 positions" in out
    tip = desk.in_force.tip
    assert tip.offset_m == pytest.approx(TIP, abs=2e-6)
    assert tip.method == "sphere"


@pytest.mark.parametrize(("method", "count"), [("sphere", 20), ("points", 4)])
def test_positions_alone_give_the_distance_and_no_direction(
    desk: Desk, tmp_path: Path, method: str, count: int
) -> None:
    table = poses(tmp_path / "poses.csv", count, has_attitudes=False)
    ask = ("--method", method, "--positions", table, "--error-mm", "0.001")
    code, _, err = desk.run(*ask)
    assert code == 1
    assert "the tip is 119.0 +-" in err
    assert "but a sphere does not give its direction" in err
    assert "--method circle --distance-mm 119.0" in err


def test_a_circle_gives_the_axis_and_with_a_distance_the_tip(
    desk: Desk, tmp_path: Path
) -> None:
    turns = turn(np.linspace(0.0, 6.0, 12)[:, None] * np.array([0.0, 0.0, 1.0]))
    places = turns @ np.array([0.02, 0.0, 0.1])
    table = tmp_path / "ring.csv"
    rows = np.hstack([places, rotation.from_matrix(turns)])
    head = "x_m,y_m,z_m,qw,qx,qy,qz"
    np.savetxt(table, rows, delimiter=",", header=head, comments="", fmt="%.12g")
    ask = ("--method", "circle", "--positions", table)
    with Stream(desk.chain, ()):
        assert desk.run(*ask)[0] == 0
        tip = desk.in_force.tip
        assert tip.axis == pytest.approx((0.0, 0.0, 1.0), abs=1e-4)
        assert tip.offset_m is None
        far = 1000.0 * float(np.hypot(0.02, 0.1))
        assert desk.run(*ask, "--distance-mm", str(far))[0] == 0
        tip = desk.in_force.tip
        assert tip.offset_m == pytest.approx((-0.02, 0.0, -0.1), abs=1e-5)
        two = poses(tmp_path / "two.csv", 2)
        assert "takes 3 or 4" in desk.run("--method", "points", "--positions", two)[2]
        bare = poses(tmp_path / "bare.csv", 3, has_attitudes=False)
        errors = desk.run("--method", "points", "--positions", bare)[2]
        assert "needs the attitude at each position" in errors


def test_a_capture_without_a_good_wobble_is_refused_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe(**RATES)
    for samples, words in (
        (wobbled(Wobble(), 26.0), "this probe's sensors are not calibrated"),
        (wobbled(Wobble(), 26.0)[:900], "of wobbling is too short"),
    ):
        path = capture(tmp_path / "wobble.bin", probe, samples)
        code = main(["calibrate", "tip", "--from", str(path), "--dry-run"])
        err = capsys.readouterr().err
        assert (code, err.count("\n")) == (1, 1)
        assert words in err


def test_a_capture_is_used_with_the_params_of_its_probe(
    desk: Desk, tmp_path: Path
) -> None:
    path = capture(tmp_path / "w.bin", FakeProbe(**RATES), wobbled(Wobble(), 26.0))
    with Stream(desk.chain, ()):
        code, out, _ = desk.run(desk.probe, "--from", path)
    assert code == 0
    assert "calibrated from 15 s of wobbling" in out
    tip = desk.in_force.tip
    assert tip.offset_m == pytest.approx(TIP, abs=0.0015)


@pytest.mark.parametrize(
    "words",
    [
        ("tip", "--method", "positions"),
        ("tip", "--method", "tape"),
        ("tip", "--method", "sphere"),
        ("tip", "--positions", "a.csv"),
        ("tip", "--distance-mm", "100"),
        ("tip", "--axis", "0", "0", "0"),
        ("stylus", "--axis", "0", "0", "1"),
        ("stylus", "--method", "dimple"),
    ],
)
def test_arguments_that_make_no_sense_are_usage_errors(words: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["calibrate", *words])
    assert end.value.code == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "needs a first line x_m,y_m,z_m"),
        ("x_m,y_m,z_m\n", "needs a first line"),
        ("x_m,y_m,z_m\n1,2,three\n", "must be numbers in every line"),
        ("x_m,y_m,z_m\n1,2\n", "must be numbers in every line"),
        ("x_m,y_m,z_m,qw,qx,qy,qz\n1,2,3,1,1,0,0\n", "of length 1, w first"),
    ],
)
def test_a_table_that_is_none_is_one_line(
    tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(FileError, match=words):
        read(path)
    with pytest.raises(FileError, match="can't read"):
        read(tmp_path / "none.csv")


def test_what_a_method_does_not_tell_stays_as_it_is() -> None:
    before = result_of_tip(TipFound("measured", TIP, 0.002), CALIBRATED).params
    after = result_of_tip(
        TipFound("sphere", axis=np.array([0.0, 1.0, 0.0])), before
    ).params
    assert after.tip.offset_m == before.tip.offset_m
    assert after.tip.sigma_m == before.tip.sigma_m
    assert after.tip.axis == (0.0, 1.0, 0.0)


def test_the_screen_shows_how_it_was_wobbled_and_how_good_it_is() -> None:
    guide = Dimpling(SCALE, CALIBRATED)
    first = "\n".join(each.plain for each in tip_lines("stylus", guide.status()))
    assert "Stand the tip in a dimple" in first
    assert first.count("○") == 8
    assert "tip     not yet" in first
    for sample in wobbled(Wobble(), 26.0)[:2100]:
        guide.feed(sample)
    shown = tip_lines("stylus", guide.status())
    later = "\n".join(each.plain for each in shown)
    assert later.count("●") == 8
    assert "tip     +-" in later
    assert "degrees to each side, at 0." in later
    assert max(len(each.plain) for each in shown) <= 120
