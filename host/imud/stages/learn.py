# SPDX-License-Identifier: MIT
"""Learns the sensors' calibration from a probe's normal use, without a procedure.

It needs raw samples and motion that turns the probe. A fit takes 0.3 to 2 s, so it is
done in a thread beside; the stage picks the result up with a later message.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import cache
from typing import Any

from imud.calibration.recording import Sample, Scale
from imud.config.settings import Config
from imud.probes.sensors import has_magnetometer
from imud.probes.session import ProbeFound, Received
from imud.refine.learner import Learned, Learner, Proposal, learned_of
from imud.stages import LogLine, Publish, SendCommands, StageResult
from imud.wire.messages import Value
from imud.wire.params import is_mag_off

REPORT_BELOW = 0.7  # of the error that was reported last


@cache
def worker() -> Executor:
    """The thread in which all probes' fits are done."""
    return ThreadPoolExecutor(1, "imud-learn")


class LearnStage:
    """Learns the sensors of one probe, unless the configuration turns it off."""

    name = "learn"
    replaced: frozenset[str] = frozenset()

    def __init__(self, config: Config, executor: Executor | None = None) -> None:
        self._mode = config.calibration.learn
        self._executor = executor
        self._learner: Learner | None = None
        self._probe_id = ""
        self._forget()

    def _forget(self) -> None:
        """Other params are active: learned calibrations are re-evaluated against them.
        The samples are kept, as they are uncalibrated.
        """
        self._digest: int | None = None
        self._fit: Future[Learned] | None = None
        self._proposal: Proposal | None = None
        self._reported_deg: float | None = None

    def configure(self, config: Config) -> None:
        if config.calibration.learn != self._mode:
            self._mode = config.calibration.learn
            if self._learner is not None:
                self._learner = Learner(self._learner.scale)
            self._forget()

    def on_probe_found(self, found: ProbeFound) -> None:
        self._probe_id = found.probe_id
        self._learner = None
        self._meet(found.hello.fields)
        self._forget()

    def _meet(self, hello: Mapping[str, Value]) -> None:
        """Begins once the sensors are there, after the first hello of a boot."""
        if self._learner is None and has_magnetometer(hello):
            scale = Scale(
                _float(hello["acc_lsb"]),
                _float(hello["gyr_lsb"]),
                _float(hello["mag_lsb"]),
                _float(hello["raw_rate"] or hello["sample_rate"]),
            )
            self._learner = Learner(scale)

    def on_message(self, received: Received) -> Iterable[StageResult]:
        if received.message.name == "hello":
            self._meet(received.message.fields)
        is_idle = self._fit is None and received.message.name != "raw"
        if self._mode == "off" or (is_idle and self._digest == received.scales.digest):
            return ()
        return self._learn(received)

    def _learn(self, received: Received) -> Iterator[StageResult]:
        learner = self._learner
        if self._digest != received.scales.digest:
            self._forget()
            self._digest = received.scales.digest
        # With any message: the stream may have stopped while the fit ran.
        if learner is not None and self._fit is not None and self._fit.done():
            learned, self._fit = self._fit.result(), None
            learner.end(learned)
            if learned.proposal is not None:
                yield from self._report(learned.proposal, received)
        if received.message.name != "raw" or learner is None:
            return
        sample = _sample(received.message.fields, received.stamp.t_device_us)
        is_due, params = learner.add(sample), received.params
        is_free = self._fit is None and params is not None and not is_mag_off(params)
        if is_due and is_free and params is not None:
            executor = self._executor or worker()
            self._fit = executor.submit(learned_of, learner.begin(params))

    def _report(self, found: Proposal, received: Received) -> Iterator[StageResult]:
        self._proposal, reported_deg = found, self._reported_deg
        is_news = (
            reported_deg is None or found.heading_deg < REPORT_BELOW * reported_deg
        )
        if not is_news:
            return
        self._reported_deg = found.heading_deg
        place = {
            "seq": received.message.sequence,
            "t_device_us": received.stamp.t_device_us,
            "t_ns": received.stamp.t_ns,
        }
        yield Publish(self.name, place | dict(self.status()))
        words = (
            f"learned its calibration, with errors of +-{found.tilt_deg:.1f} degrees "
            f"in tilt and +-{found.heading_deg:.1f} in heading"
        )
        if self._mode == "propose":
            how = "activate it with imud calibrate learned"
            yield LogLine(Proposal, f"{words}; {how}")
            return
        yield LogLine(Proposal, f"{words}; activating it")
        parameters = {"records": found.params.encode().hex(), "probe": self._probe_id}
        yield SendCommands(
            (("params", parameters),), "the learned calibration can't be activated"
        )

    def status(self) -> Mapping[str, Any]:
        """The state, and the proposed calibration: degrees, uT, and its params."""
        state, found = "off", self._proposal
        if self._mode != "off":
            has_some = self._learner is not None and self._learner.samples
            state = "listening" if has_some else "waiting"
        if found is None:
            keys = ("tilt_deg", "heading_deg", "sigma_uT", "digest", "records")
            return {"state": state, **dict.fromkeys(keys)}
        return {
            "state": "proposes",
            "tilt_deg": round(found.tilt_deg, 2),
            "heading_deg": round(found.heading_deg, 2),
            "sigma_uT": round(found.sigma_ut, 3),
            "digest": f"{found.params.digest:08x}",
            "records": found.params.encode().hex(),
        }

    def closing_line(self) -> str:
        return ""


def _sample(fields: Mapping[str, Value], t_us: int) -> Sample:
    mag, warmth = fields["mag"], fields["temperature"]
    return Sample(
        t_us,
        _counts(fields["acc"]),
        _counts(fields["gyr"]),
        _counts(mag) if mag is not None else None,
        _float(warmth) if warmth is not None else None,
    )


def _counts(value: Value) -> tuple[int, int, int]:
    x, y, z = value  # type: ignore[misc, str-unpack]  # as the schema says
    return int(x), int(y), int(z)


def _float(value: Value) -> float:
    return float(value)  # type: ignore[arg-type]  # as the schema says
