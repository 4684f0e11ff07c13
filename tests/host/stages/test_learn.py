# SPDX-License-Identifier: MIT
"""The stage that learns the sensors from free motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from typing import Any

from benchmarks.calibration.simulated import errors, recorded
from fakes import FakeProbe
from imud.calibration.affine import affine_of
from imud.calibration.guided import whole
from imud.calibration.guided.result import result_of_fit
from imud.calibration.recording import Sample
from imud.config.settings import CalibrationSettings, Config
from imud.params.value import Params
from imud.probes.probe import Probe
from imud.probes.session import ProbeFound, Received, Session
from imud.stages import LogLine, Publish, SendCommands, StageResult
from imud.stages.learn import LearnStage, worker
from imud.virtual.calibrating import SCALE
from raw_probe import RATES, calibrating, module, raw, used


class AtOnce(Executor):
    """Does its work when it is given it."""

    def submit(
        self, work: Callable[..., Any], /, *arguments: Any, **_: Any
    ) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(work(*arguments))
        return done


def config(mode: Any) -> Config:
    return Config(calibration=CalibrationSettings(learn=mode))


class Bench:
    """A stage and the messages of a probe."""

    def __init__(self, mode: str = "propose", params: Params | None = None) -> None:
        self.stage = LearnStage(config(mode), AtOnce())
        self.probe = FakeProbe(**RATES)
        heard = Probe(self.probe.name)
        self.session = Session(lambda _: heard)
        self.outcomes: list[StageResult] = []
        params = params or Params()
        heard.add_params(params.encode())
        self.probe.hello_fields |= {"params_digest": params.digest}
        self.hear(self.probe.say("hello"))

    def hear(self, data: bytes) -> None:
        for event in self.session.receive(b"\0" + data, None):
            if isinstance(event, ProbeFound):
                self.stage.on_probe_found(event)
            elif isinstance(event, Received):
                self.outcomes += self.stage.on_message(event)

    def play(self, found: Sequence[Sample]) -> None:
        for each in found:
            self.hear(raw(self.probe, each))

    def of(self, kind: type[Any]) -> list[Any]:
        return [each for each in self.outcomes if isinstance(each, kind)]


def levelled() -> Params:
    """The module with its accelerometer and gyroscope calibrated."""
    fit = whole.fit(recorded(calibrating()))
    assert fit is not None
    return result_of_fit(fit, SCALE, Params(), sensors=("acc", "gyr")).params


def test_free_motion_gives_a_proposal_and_one_command_to_take_it() -> None:
    before = levelled()
    bench = Bench(params=before)
    assert bench.stage.status()["state"] == "waiting"
    bench.play(used())
    # As it continues, it may find a better one.
    assert 1 <= len(bench.of(Publish)) == len(bench.of(LogLine)) <= 3
    assert bench.of(SendCommands) == []
    for told in bench.of(LogLine):
        assert "activate it with imud calibrate learned" in told.text
    assert {each.topic for each in bench.of(Publish)} == {"learn"}
    status = bench.stage.status()
    assert status["state"] == "proposes"
    assert 0.05 < status["heading_deg"] < 3.0
    assert 0.02 < status["tilt_deg"] < 0.2
    params = Params.decode(bytes.fromhex(status["records"]))
    assert params.acc == before.acc
    assert params.mag.method == "learned"
    left = errors(
        module(),
        affine_of(params.acc, SCALE.acc_m_s2),
        affine_of(params.mag, SCALE.mag_ut),
    )
    assert left["heading"] < 1.0


def test_a_probe_whose_sensor_is_found_after_its_first_hello_is_learned() -> None:
    bench = Bench(params=levelled())
    sensor = bench.probe.hello_fields["sensor"]
    bench.probe.hello_fields |= {"sensor": "none", "who_am_i": (0, 0)}
    bench.probe.restart()
    bench.hear(bench.probe.say("hello"))
    bench.probe.hello_fields |= {"sensor": sensor, "who_am_i": (0x71, 0x48)}
    bench.hear(bench.probe.say("hello"))
    bench.play(used())
    assert bench.stage.status()["state"] == "proposes"


def test_a_fit_that_ends_after_the_stream_is_told_with_the_next_message() -> None:
    bench = Bench(params=levelled())
    later: list[Callable[[], None]] = []

    class Later(Executor):
        def submit(
            self, work: Callable[..., Any], /, *arguments: Any, **_: Any
        ) -> Future[Any]:
            done: Future[Any] = Future()
            later.append(lambda: done.set_result(work(*arguments)))
            return done

    bench.stage = LearnStage(config("propose"), Later())
    bench.hear(bench.probe.say("hello"))
    bench.probe.restart()
    bench.hear(bench.probe.say("hello"))
    bench.play(used())
    (finish,) = later
    finish()
    assert not bench.of(Publish)
    bench.hear(bench.probe.say("status"))
    assert len(bench.of(Publish)) == 1


def test_applying_it_is_one_change_of_the_params_of_that_probe() -> None:
    bench = Bench("apply", levelled())
    bench.play(used())
    wants = bench.of(SendCommands)
    assert 1 <= len(wants) <= 3
    ((command, parameters),) = wants[-1].commands
    assert command == "params"
    assert parameters["probe"] == bench.probe.name
    records = bytes.fromhex(parameters["records"])
    assert Params.decode(records).mag is not None


def test_a_better_calibration_stays() -> None:
    fit = whole.fit(recorded(calibrating()))
    assert fit is not None
    bench = Bench("apply", result_of_fit(fit, SCALE, Params()).params)
    bench.play(used())
    assert bench.outcomes == []
    assert bench.stage.status()["state"] == "listening"


def test_off_is_off_and_a_reload_switches_it() -> None:
    bench = Bench("off")
    bench.play(used(4.0))
    assert bench.stage.status()["state"] == "off"
    bench.stage.configure(config("propose"))
    assert bench.stage.status()["state"] == "waiting"


def test_other_params_and_another_boot_begin_anew() -> None:
    bench = Bench(params=levelled())
    bench.play(used())
    assert bench.stage.status()["state"] == "proposes"
    bench.probe.restart()
    bench.hear(bench.probe.say("hello"))
    assert bench.stage.status()["state"] == "waiting"


def test_a_probe_without_magnetometer_is_left_alone() -> None:
    bench = Bench()
    bench.probe.hello_fields |= {"sensor": "mpu6500", "boot_count": 8}
    bench.probe.restart()
    bench.hear(bench.probe.say("hello"))
    bench.play(used(3.0))
    assert bench.stage.status()["state"] == "waiting"


def test_fits_have_one_thread_for_all_probes() -> None:
    assert worker() is worker()
    assert worker().submit(lambda: 5).result(10.0) == 5
    assert LearnStage(Config()).closing_line() == ""
