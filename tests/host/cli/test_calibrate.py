# SPDX-License-Identifier: MIT
"""`imud calibrate` with a daemon and a fake probe that sends raw samples."""

from __future__ import annotations

import threading
from typing import Any

import pytest
from msgspec.structs import replace

from benchmarks.calibration.simulated import errors, recorded
from chain import Chain
from imud.calibration.affine import affine_of
from imud.calibration.guided import whole
from imud.calibration.guided.result import result_of_fit
from imud.calibration.poses import TWELVE
from imud.calibration.recording import Sample
from imud.cli import calibrate_source, main
from imud.params.value import Params
from imud.virtual.calibrating import SCALE
from params_bench import GOOD
from raw_probe import Desk, Stream, calibrating, lying, module, used


@pytest.fixture
def desk(
    bench: Chain,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Desk:
    # The probe sends no raw samples until it is told to: no need to wait for them.
    monkeypatch.setattr(calibrate_source, "HEARD_S", 0.3)
    if bench.probe.params.records:
        with Stream(bench, ()):
            bench.client.change_params(bench.probe.name, b"")
    bench.probe.commands.clear()
    return Desk(bench, capsys, "calibrate")


def test_there_is_nothing_to_undo_on_a_probe_without_params(desk: Desk) -> None:
    with Stream(desk.chain, ()):
        line = desk.refused("undo")
    assert "has no params, and had none before" in line


def test_a_probe_is_calibrated_and_the_calibration_undone(desk: Desk) -> None:
    with Stream(desk.chain, calibrating()):
        code, out, err = desk.run(desk.probe, "--no-housing")
        assert (code, err) == (0, "")
        lines = out.splitlines()
        assert lines[0] == "Lay it base down and let go."
        assert any(line.startswith("Good (1 of 12). Now lay it ") for line in lines)
        assert f"{desk.probe}: calibrated from 12 stops" in out
        assert ", at 24.5 degC" in out
        assert "tilt           +-0.0" in out
        assert "uT residual; field 4" in out
        params = desk.in_force
        assert f"params {params.digest:08x} are active" in out
        left = errors(
            module(),
            affine_of(params.acc, SCALE.acc_m_s2),
            affine_of(params.mag, SCALE.mag_ut),
        )
        assert left["tilt"] < 0.1
        assert left["heading"] < 0.4
        assert params.gyr is not None
        assert desk.run("undo")[0] == 0
        assert desk.in_force == Params()
        # Undone once more, it is back.
        assert desk.run("undo", "--dry-run")[0] == 0
        assert desk.in_force == Params()
        assert desk.run("undo", desk.probe)[0] == 0
        assert desk.in_force == params


def test_a_dry_run_changes_nothing_and_keeps_other_records(desk: Desk) -> None:
    with Stream(desk.chain, calibrating()):
        desk.chain.client.change_params(desk.probe, GOOD.encode())
        code, out, err = desk.run("--no-housing", "--dry-run")
    assert (code, err) == (0, "")
    assert "were not activated" in out
    assert "options" not in out  # they stay as they are
    assert desk.in_force == GOOD


def test_raw_samples_are_switched_on_and_off_again(desk: Desk) -> None:
    desk.chain.probe.hello_fields |= {"raw_rate": 0}
    ups = [pose.up for pose in TWELVE[:4]]
    with Stream(desk.chain, lying(ups, 3), asks="start"):
        code, out, _ = desk.run("verify")
    assert code == 1
    assert out.count("not calibrated: imud calibrate PROBE") == 3
    asked = [
        (each["command"], each["arguments"])
        for each in desk.chain.probe.commands
        if each["command"] != "rate"  # as the last hello that was heard
    ]
    assert asked == [
        *(("fields", (3, 0)), ("start", (0, 0))),
        *(("stop", (0, 0)), ("fields", (1, 0))),
    ]


def test_a_restart_ends_it_with_one_line(desk: Desk) -> None:
    # Its time restarts, by more than that of all earlier tests.
    back = -desk.chain.probe.time_us
    boot = [replace(each, t_us=each.t_us + back) for each in calibrating()[:900]]
    again = [*calibrating()[:900], *boot]
    with Stream(desk.chain, again):
        line = desk.refused(desk.probe)
    assert "restarted: its calibration is unchanged; start again" in line


def test_a_probe_that_falls_silent_is_told(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibrate_source, "SILENT_S", 0.5)
    with Stream(desk.chain, calibrating()[:900]):
        line = desk.refused(desk.probe)
    assert "is it unplugged? Its calibration is unchanged" in line


def test_params_changed_by_another_client_end_it(desk: Desk) -> None:
    stream = Stream(desk.chain, calibrating())

    def change() -> None:
        while stream.sent < 1500:
            threading.Event().wait(0.01)
        desk.chain.client.change_params(desk.probe, GOOD.encode())

    other = threading.Thread(target=change, daemon=True)
    with stream:
        other.start()
        code, _, err = desk.run(desk.probe)
    assert (code, "another client changed the params" in err) == (1, True), err
    other.join()
    assert desk.in_force == GOOD


def test_a_dead_axis_is_refused_and_nothing_changes(desk: Desk) -> None:
    def dead(counts: tuple[int, int, int]) -> tuple[int, int, int]:
        return counts[0], 0, counts[2]

    broken = [Sample(s.t_us, dead(s.acc), s.gyr, s.mag) for s in calibrating()]
    with Stream(desk.chain, broken):
        line = desk.refused(desk.probe)
    assert "refused: the accelerometer's y axis does not respond" in line
    assert "the previous calibration stays active" in line


def test_what_the_daemon_has_learned_is_put_in_force(
    chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    desk = Desk(
        chain, capsys, "calibrate"
    )  # of its own, for it learns from all samples

    def is_learned(status: dict[str, Any]) -> bool:
        return bool(status["learn"]["records"])

    with Stream(desk.chain, used(), asks="start"):
        line = desk.refused("learned")
        assert f"no learned calibration yet for probe {desk.probe} (state: " in line
        desk.chain.client.command(desk.probe, "start")
        learned = desk.chain.status_when(is_learned)
        assert learned["learn"]["state"] == "proposes"
        assert desk.run("learned", "--dry-run")[0] == 0
        assert desk.in_force == Params()
        code, out, _ = desk.run("learned")
    assert code == 0
    assert "mag method         -       learned" in out
    assert "acc method         -       learned" in out
    assert "  tilt           +-0." in out
    assert desk.in_force.mag is not None
    desk.chain.daemon.expect("activate it with imud calibrate learned")


def test_an_old_calibration_is_verified(desk: Desk) -> None:
    fit = whole.fit(recorded(calibrating()))
    assert fit is not None
    params = result_of_fit(fit, SCALE, Params()).params
    with Stream(desk.chain, lying([pose.up for pose in TWELVE[:4]])):
        desk.chain.client.change_params(desk.probe, params.encode())
        code, out, _ = desk.run("verify")
    assert code == 0
    assert "the calibration is good" in out
    assert "Lay it still." in out


@pytest.mark.parametrize(
    "words",
    [
        ("stylus", "other"),
        ("mag", "stylus", "--method", "positions"),
        ("stylus", "--force"),
        ("undo", "stylus", "--from", "a.mcap"),
        ("stylus", "--method", "best"),
    ],
)
def test_arguments_that_make_no_sense_are_usage_errors(words: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["calibrate", *words])
    assert end.value.code == 2
