# SPDX-License-Identifier: MIT
"""A fake probe that sends the raw samples of a simulated module."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Self

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks.calibration.simulated import UPS, samples
from chain import Chain
from fakes import FakeProbe
from imud.calibration.algebra import units
from imud.calibration.recording import Sample
from imud.cli import main
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.virtual.calibrating import SCALE, Manners
from imud.virtual.modules import shop
from imud.virtual.motions.module import Module

# As of the samples that imud.virtual.calibrating makes.
RATES = {"sample_rate": 100, "raw_rate": 100}
BURST = 20  # samples written together
PAUSE_S = 0.004  # between bursts: 50 times as fast as a probe


@cache
def module() -> Module:
    return shop(np.random.default_rng([1, 80]), warm_degc=0.0)


@cache
def calibrating(poses: int = 12) -> tuple[Sample, ...]:
    """The guided poses of the module."""
    return tuple(samples(module(), 1, UPS[:poses]))


def lying(ups: Sequence[FloatArray | None], seed: int = 2) -> tuple[Sample, ...]:
    """The module, laid with each of these directions up."""
    return tuple(samples(module(), seed, ups))


@cache
def waved(seconds: float = 32.0) -> tuple[Sample, ...]:
    """The module turned about in the air."""
    ups = list(units(np.random.default_rng(6).standard_normal((40, 3))))
    manners = Manners(stop_s=0.02, move_s=1.5, is_held=True, swerve_rad=0.6)
    return tuple(samples(module(), 6, ups[: int(seconds / 1.52)], manners))


def in_si(rows: Sequence[Sample]) -> tuple[FloatArray, ...]:
    """Time in s, m/s2, rad/s and uT of samples that imud.virtual.calibrating made."""
    return (
        np.array([each.t_us for each in rows]) * 1e-6,
        np.array([each.acc for each in rows]) * SCALE.acc_m_s2,
        np.array([each.gyr for each in rows]) * SCALE.gyr_rad_s,
        np.array([each.mag for each in rows]) * SCALE.mag_ut,
    )


@cache
def used(seconds: float = 40.0, seed: int = 6) -> tuple[Sample, ...]:
    """The module in use: turned about, with short rests."""
    ups = list(units(np.random.default_rng(seed).standard_normal((40, 3))))
    manners = Manners(stop_s=1.0, move_s=1.5, swerve_rad=0.6)
    return tuple(samples(module(), seed, ups[: int(seconds / 2.5)], manners))


def raw(probe: FakeProbe, sample: Sample) -> bytes:
    """The message of a sample at its time."""
    probe.time_us = sample.t_us
    own = {"acc": sample.acc, "gyr": sample.gyr, "mag": sample.mag}
    return probe.say("raw", **own, temperature=24.5)


def capture(path: Path, probe: FakeProbe, found: Sequence[Sample]) -> Path:
    """A file of the bytes that the probe sends: a hello, and the samples."""
    probe.time_us = found[0].t_us if found else 0
    data = [probe.say("hello"), *(raw(probe, each) for each in found)]
    path.write_bytes(b"\0" + b"".join(data))
    return path


class Stream:
    """Sends samples on the port of a chain and answers commands, until it is closed. It
    begins when it is told to by the command `asks`; after the last sample it is silent.
    """

    def __init__(
        self, chain: Chain, found: Sequence[Sample], asks: str = "fields"
    ) -> None:
        self.chain = chain
        self._samples = found
        self._asks = asks
        self._begin_us = chain.probe.time_us  # its time continues
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.sent = 0

    def goes_on(self, found: Sequence[Sample]) -> None:
        """More samples: `found` begins with those that it has."""
        self._samples = found

    def __enter__(self) -> Self:
        probe = self.chain.probe
        before, probe.hello_fields = probe.hello_fields, probe.hello_fields | RATES
        self.chain.port.write(probe.say("hello"))
        if probe.hello_fields != before:
            # What a status says of the probe is a second old at most.
            self.chain.status_when(
                lambda status: status["hello"]["sample_rate"] == RATES["sample_rate"]
            )
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        probe, port = self.chain.probe, self.chain.port
        before = len(probe.commands)
        while not self._stop.wait(PAUSE_S):
            port.write(port.answers(probe))
            commands = {each["command"] for each in probe.commands[before:]}
            if self._asks not in commands:
                continue
            burst = self._samples[self.sent : self.sent + BURST]
            self.sent += len(burst)
            later = [replace(each, t_us=each.t_us + self._begin_us) for each in burst]
            port.write(b"".join(raw(probe, each) for each in later))


class Desk:
    """A user who calibrates, by commands that begin with these words."""

    def __init__(
        self, chain: Chain, capsys: pytest.CaptureFixture[str], *own: str
    ) -> None:
        self.chain, self._capsys, self._own = chain, capsys, own
        self.probe = chain.probe.name

    @property
    def in_force(self) -> Params:
        return Params.decode(self.chain.probe.params.records)

    def run(self, *words: str | Path) -> tuple[int, str, str]:
        """The exit code, and what it prints to stdout and stderr."""
        where = ("--connect", self.chain.daemon.endpoint)
        code = main([*self._own, *map(str, words), *where])
        captured = self._capsys.readouterr()
        return code, captured.out, captured.err

    def refused(self, *words: str) -> str:
        """Its one line on stderr; nothing has changed."""
        before = self.chain.probe.params.records
        code, _, err = self.run(*words)
        assert code == 1
        assert err.startswith("imud: ")
        assert err.count("\n") == 1
        assert self.chain.probe.params.records == before
        return err
