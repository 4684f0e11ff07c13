# SPDX-License-Identifier: MIT
"""`imud calibrate --from` captures and logs, good and bad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from chain import Chain
from fakes import FakeProbe
from imud.calibration.poses import TWELVE
from imud.cli import main
from imud.params.value import Params
from params_bench import GOOD
from raw_probe import RATES, Stream, calibrating, capture, lying, raw, used

DRY = ("--dry-run",)


@pytest.fixture
def taken(tmp_path: Path) -> Path:
    return capture(tmp_path / "taken.bin", FakeProbe(**RATES), calibrating())


def run(
    capsys: pytest.CaptureFixture[str], path: Path, *words: str
) -> tuple[int, str, str]:
    code = main(["calibrate", *words, "--from", str(path)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_a_capture_is_calibrated_from_without_a_daemon(
    taken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = run(capsys, taken, *DRY)
    assert (code, err) == (0, "")
    assert "calibrated from 12 stops in 46 s, at 24.5 degC" in out
    assert "heading        +-0." in out
    assert "mag norm_uT" in out
    assert "were not activated" in out


def test_one_sensor_alone(taken: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, taken, "gyro", *DRY)
    assert code == 0
    changed = {line.split()[0] for line in out.splitlines() if " -  " in line}
    assert changed == {"gyr", "noise"}


def test_a_wave_needs_an_accelerometer_that_is_calibrated(
    taken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = run(capsys, taken, "mag", *DRY)
    assert code == 1
    assert err.startswith("imud: refused: the accelerometer is not calibrated")


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("extremes", "uT residual"),
        ("positions", "mg residual at the stops"),
    ],
)
def test_a_papers_method_reports_its_residual(
    taken: Path, capsys: pytest.CaptureFixture[str], method: str, words: str
) -> None:
    code, out, _ = run(capsys, taken, "--method", method, *DRY)
    assert code == 0
    assert words in out
    assert "tilt  " not in out  # it does not know


def test_a_method_that_lacks_something_says_what(
    taken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = run(capsys, taken, "--method", "half-turns", *DRY)
    assert (code, err) == (
        1,
        "imud: turn the probe by 180 degrees on the spot on each of its six sides\n",
    )


def test_few_poses_are_refused_with_the_cure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    upright = [pose.up for pose in TWELVE if pose.sign[2] >= 0]
    probe = FakeProbe(**RATES)
    for ups, words in (
        (upright[:3], "3 poses are too few; lay the probe still"),
        ([pose.up for pose in TWELVE[:1]] * 6, "the tilt error would be +-"),
        (upright[:5], "it was never upside down: turn it over"),
    ):
        path = capture(tmp_path / "few.bin", probe, lying(ups))
        code, _, err = run(capsys, path, *DRY)
        assert code == 1
        assert words in err
        assert err.count("\n") == 1


def test_files_without_raw_samples_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe(**RATES)
    path = tmp_path / "poses.bin"
    path.write_bytes(b"\0" + probe.say("hello") + probe.poses(100))
    code, _, err = run(capsys, path, *DRY)
    assert code == 1
    assert "has no raw samples; set streams" in err
    path.write_bytes(bytes(range(256)) * 50)
    assert "has no raw samples" in run(capsys, path, *DRY)[2]
    assert "can't read" in run(capsys, tmp_path / "none.bin", *DRY)[2]


def test_slow_raw_samples_are_too_few(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = capture(tmp_path / "slow.bin", FakeProbe(**RATES), calibrating()[::5])
    code, _, err = run(capsys, path, *DRY)
    assert code == 1
    assert "20 raw samples per second are too few" in err


def test_damage_in_a_capture_costs_its_own_samples(
    taken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(taken.read_bytes())
    for at in range(5000, len(data), 7000):
        data[at] ^= 0x55
    taken.write_bytes(data)
    code, out, _ = run(capsys, taken, *DRY)
    assert code == 0
    assert "calibrated from 12 stops" in out


def test_the_longest_boot_is_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe(**RATES)
    path = capture(tmp_path / "boots.bin", probe, calibrating())
    probe.restart()
    more = probe.say("hello") + b"".join(
        raw(probe, each) for each in lying([None])[:99]
    )
    path.write_bytes(path.read_bytes() + more)
    code, out, _ = run(capsys, path, *DRY)
    assert code == 0
    assert "calibrated from 12 stops" in out


def test_a_file_of_another_probe_is_refused_by_its_id_unless_forced(
    chain: Chain, taken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Stream(chain, ()):
        where = ("--connect", chain.daemon.endpoint)
        code, out, _ = run(capsys, taken, *where, "--no-housing")
        assert code == 0
        assert "are active" in out
        first = chain.probe.params.records
        assert Params.decode(first).mag is not None
        other = FakeProbe(**RATES, probe_id=bytes(8))
        foreign = capture(taken.parent / "other.bin", other, calibrating())
        code, _, err = run(capsys, foreign, *where)
        assert code == 1
        assert "is from probe 0000000000000000, but 00112233445566aa is" in err
        assert chain.probe.params.records == first
        chain.client.change_params(chain.probe.name, GOOD.encode())
        assert run(capsys, foreign, *where, "--force")[0] == 0
        assert Params.decode(chain.probe.params.records).options == GOOD.options


def test_a_log_of_an_old_calibration_is_verified(
    taken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, taken, "verify")
    assert code == 1
    assert out.count("not calibrated") == 3


def test_the_longest_piece_between_two_pauses_is_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = calibrating()
    later_us = found[-1].t_us + 60_000_000
    after = [replace(each, t_us=each.t_us + later_us) for each in found[:2000]]
    path = capture(tmp_path / "pause.bin", FakeProbe(**RATES), [*found, *after])
    code, out, _ = run(capsys, path, *DRY)
    assert code == 0
    assert "calibrated from 12 stops in 46 s" in out


@pytest.fixture
def moved(tmp_path: Path) -> Path:
    """A capture of a module in use, without a procedure."""
    return capture(tmp_path / "moved.bin", FakeProbe(**RATES), used())


def test_free_motion_in_a_file_tells_a_calibration(
    moved: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = run(capsys, moved, "learned", *DRY)
    assert (code, err) == (0, "")
    assert "calibrated from 38 s of motion, at 24.5 degC" in out
    assert "heading        +-1." in out
    assert "missing" not in out
    changed = {line.split()[0] for line in out.splitlines() if " -  " in line}
    assert changed == {"acc", "gyr", "mag"}
    assert "were not activated" in out


def test_motion_on_a_table_says_what_it_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flat = lying([np.array([0.0, 0.0, 1.0])] * 8)
    path = capture(tmp_path / "flat.bin", FakeProbe(**RATES), flat)
    code, out, _ = run(capsys, path, "learned", *DRY)
    assert code == 0
    assert "missing        a heading better than 2.5 degrees" in out


def test_too_little_motion_is_refused(
    moved: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = capture(moved.with_name("short.bin"), FakeProbe(**RATES), used()[:1000])
    code, _, err = run(capsys, short, "learned", *DRY)
    assert code == 1
    assert "10 s of samples without a pause are too few" in err
    # Its few stops are too few, too, and name the other way.
    few = capture(moved.with_name("few.bin"), FakeProbe(**RATES), used()[:600])
    code, _, err = run(capsys, few, *DRY)
    assert code == 1
    assert f"imud calibrate learned --from {few}" in err
