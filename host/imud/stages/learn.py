# SPDX-License-Identifier: MIT
"""Learns the magnetometer's calibration from what a probe does anyway: no procedure.

It needs raw samples and motion that turns the probe. A fit takes up to 0.3 s, so it is
done in a thread beside; the stage picks the result up with a later message.
"""

from __future__ import annotations

import datetime
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import cache
from typing import Any

import msgspec

from imud.calibration import wave
from imud.calibration.affine import affine_of
from imud.calibration.faults import of_magnets
from imud.calibration.outcome import of_wave
from imud.calibration.recording import NO_MAG, Gatherer, Sample, Scale
from imud.calibration.wave import Wave
from imud.config.settings import Config
from imud.errors import ParamsError
from imud.params.value import Params
from imud.probes.session import ProbeFound, Received
from imud.stages import Outcome, Says, Tells, Wants
from imud.wire.messages import Value

WINDOW_S = 60.0  # of the latest samples
LEAST_S = 20.0
EVERY_S = 10.0  # between two fits, device time
AGAIN_S = 60.0  # after a proposal

# What the magnetometer's own part of the heading's error may be, and how much smaller
# than that of the calibration in force.
FIELD_MAX_DEG = 3.0
BETTER = 0.7


class Proposal(msgspec.Struct, frozen=True):
    """What would be put in force."""

    params: Params
    heading_deg: float
    sigma_ut: float

    def values(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "heading_deg": round(self.heading_deg, 2),
            "sigma_uT": round(self.sigma_ut, 3),
            "digest": f"{self.params.digest:08x}",
            "records": self.params.encode().hex(),
        }


@cache
def worker() -> Executor:
    """The thread in which all probes' fits are done."""
    return ThreadPoolExecutor(1, "imud-learn")


class LearnStage:
    """Learns the magnetometer of one probe, or not where the configuration says so."""

    name = "learn"

    def __init__(self, config: Config, executor: Executor | None = None) -> None:
        self._mode = config.calibration.learn
        self._executor = executor
        self._scale: Scale | None = None
        self._probe_id = ""
        self._forget()

    def _forget(self) -> None:
        """Begins anew: another boot, or other params."""
        self._samples: deque[Sample] = deque()
        self._due_us = 0
        self._digest: int | None = None
        self._fit: Future[Proposal | None] | None = None
        self._proposal: Proposal | None = None

    def configure(self, config: Config) -> None:
        if config.calibration.learn != self._mode:
            self._mode = config.calibration.learn
            self._forget()

    def appear(self, found: ProbeFound) -> None:
        hello = found.hello.fields
        self._probe_id = found.probe_id
        self._scale = None
        if hello["sensor"] not in NO_MAG:
            self._scale = Scale(
                _float(hello["acc_lsb"]),
                _float(hello["gyr_lsb"]),
                _float(hello["mag_lsb"]),
                _float(hello["raw_rate"] or hello["sample_rate"]),
            )
        self._forget()

    def take(self, received: Received) -> Iterable[Outcome]:
        is_idle = self._fit is None and received.message.name != "raw"
        if self._mode == "off" or (is_idle and self._digest == received.scales.digest):
            return ()
        return self._learn(received)

    def _learn(self, received: Received) -> Iterator[Outcome]:
        if self._digest != received.scales.digest:
            self._forget()
            self._digest = received.scales.digest
        # With any message: the stream may have stopped while the fit ran.
        if self._fit is not None and self._fit.done():
            yield from self._picked_up(self._fit.result(), received)
        scale, params = self._scale, received.params
        if received.message.name == "raw" and scale is not None and params is not None:
            self._note(received, scale, params)

    def _note(self, received: Received, scale: Scale, params: bytes) -> None:
        samples, t_us = self._samples, received.stamp.t_device_us
        if samples and t_us < samples[-1].t_us:
            samples.clear()
        samples.append(_sample(received.message.fields, t_us))
        while t_us - samples[0].t_us > WINDOW_S * 1e6:
            samples.popleft()
        is_enough = t_us - samples[0].t_us > LEAST_S * 1e6
        if is_enough and t_us >= self._due_us and self._fit is None:
            self._due_us = t_us + round(EVERY_S * 1e6)
            work = (tuple(samples), scale, params)
            self._fit = (self._executor or worker()).submit(proposal, *work)

    def _picked_up(
        self, found: Proposal | None, received: Received
    ) -> Iterator[Outcome]:
        self._fit = None
        if found is None:
            return
        last, self._proposal = self._proposal, found
        self._due_us += round((AGAIN_S - EVERY_S) * 1e6)
        if last is not None and found.sigma_ut > BETTER * last.sigma_ut:
            return
        place = {
            "seq": received.message.sequence,
            "t_device_us": received.stamp.t_device_us,
            "t_ns": received.stamp.t_ns,
        }
        yield Says(self.name, place | dict(self.status()))
        words = f"its magnetometer is known to +-{found.heading_deg:.1f} degrees"
        if self._mode == "propose":
            how = "imud calibrate learned puts that in force"
            yield Tells(Proposal, f"{words} of heading; {how}")
            return
        yield Tells(Proposal, f"{words} of heading and is calibrated so")
        parameters = {"records": found.params.encode().hex(), "probe": self._probe_id}
        yield Wants((("params", parameters),), "what was learned can't be put in force")

    def status(self) -> Mapping[str, Any]:
        state = "off"
        if self._mode != "off":
            state = "listening" if self._samples else "waiting"
        if self._proposal is None:
            nothing = dict.fromkeys(("heading_deg", "sigma_uT", "digest", "records"))
            return {"state": state, **nothing}
        return {"state": "proposes", **self._proposal.values()}

    def farewell(self) -> str:
        return ""


def proposal(
    samples: tuple[Sample, ...], scale: Scale, records: bytes
) -> Proposal | None:
    """What samples say of the magnetometer, if it is good and better than what is in
    force.
    """
    try:
        before = Params.decode(records)
        before.check()
    except ParamsError:
        return None
    recording = Gatherer.of(scale, samples).recording()
    found = wave.fit(
        recording,
        affine_of(before.acc, scale.acc_m_s2),
        affine_of(before.gyr, scale.gyr_rad_s),
        wave.tilt_deg(before.acc),
    )
    if found is None or found.field_deg > FIELD_MAX_DEG or of_magnets(found.mag):
        return None
    return _better(found, before, scale, recording.temperature_c)


def _better(
    found: Wave, before: Params, scale: Scale, temperature_c: float | None
) -> Proposal | None:
    today = datetime.datetime.now(datetime.UTC).date()
    params = of_wave(found, scale, before, temperature_c, today, "learned").params
    old, new = before.mag, params.mag
    if new is None or new.sigma is None:
        return None
    is_better = old is None or old.sigma is None or new.sigma < BETTER * old.sigma
    return Proposal(params, found.heading_deg, new.sigma) if is_better else None


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
