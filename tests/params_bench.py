# SPDX-License-Identifier: MIT
"""Params to try, and a daemon's part that changes them on a fake probe, without a
process, a port or a network: each step is at hand."""

from __future__ import annotations

import asyncio
import itertools
import struct
from collections.abc import Callable, Coroutine
from typing import Any

from hypothesis import strategies as st

from fakes import FakeProbe
from imud.config.settings import Config
from imud.daemon.commands import Commander
from imud.daemon.hub import Hub
from imud.daemon.intake import Intake
from imud.daemon.params_change import ParamsChange
from imud.journal.output import Journal
from imud.params.parts import KINDS
from imud.params.value import Params, ParamsRecord
from imud.probes.session import Session
from imud.probes.timeline import host_ns

GOOD = (
    Params()
    .replaced(
        "acc",
        {
            "bias_counts": [12.5, -40, 8],
            "matrix": [[1.002, 0.001, 0], [0, 0.998, 0], [0, 0, 1]],
            "sigma_m_s2": 0.012,
            "method": "positions",
        },
    )
    .replaced("options", {"button_does": "tell"})
)

EYE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def learned(
    name: str,
    bias: float = 1,
    *,
    of: Params | None = None,
    method: str = "learned",
    matrix: tuple[tuple[float, ...], ...] = EYE,
) -> Params:
    """With a sensor's calibration from motion, or by another method. A gyroscope's has
    no bias, which is the filter's to find.
    """
    values: dict[str, Any] = {"matrix": matrix, "method": method}
    values["bias_counts"] = [0.0 if name == "gyr" else bias] * 3
    values["residual_rad" if name == "gyr" else "temperature_c"] = bias / 100.0
    return (of or Params()).replaced(name, values)


# Any list of records, of lengths that are usual and that are not.
BODIES = st.one_of(st.binary(max_size=60), st.binary(min_size=39, max_size=39))
RECORDS = st.lists(
    st.tuples(st.sampled_from([*KINDS, 0, 6, 7, 200, 255]), BODIES),
    max_size=5,
    unique_by=lambda each: each[0],
).map(lambda pairs: Params(tuple(ParamsRecord(*pair) for pair in pairs)))

# Calibrations and options that are fine, or just not.
_ROWS = st.tuples(*[st.sampled_from([0, 1, -1, 27851, 27852, -27852, 27853])] * 3)
_BIAS = st.tuples(*[st.sampled_from([0, 2**28, -(2**28), 2**28 + 1])] * 3)
_SENSOR = st.builds(
    lambda bias, rows: struct.pack("<3i9h", *bias, *itertools.chain(*rows)),
    _BIAS,
    st.tuples(_ROWS, _ROWS, _ROWS),
)
_OPTIONS = st.lists(st.integers(0, 3), min_size=1, max_size=3).map(bytes)
SOUND = st.builds(
    lambda tag, body, options: Params(
        (ParamsRecord(tag, body), ParamsRecord(5, options))
    ),
    st.sampled_from([1, 2, 3]),
    _SENSOR,
    _OPTIONS,
)


class Wire:
    """Between the daemon's part and a fake probe. `lose` is asked for each frame, with
    its number and whether the probe says it: True loses it.
    """

    name = "wire"
    baud = 500_000

    def __init__(self, probe: FakeProbe) -> None:
        self.probe = probe
        self.intake = Intake(Config(), Hub(), Journal())
        self.session: Session | None = Session(self.intake.probe, host_ns())
        self.lose: Callable[[int, bool], bool] = lambda *_: False
        self.before: Callable[[int], None] = lambda _: None  # each frame to the probe
        self.copies = 1  # of each answer
        self.frames = 0
        self.commander = Commander(self.intake.registry)
        self.intake.on_reply = self.commander.handle_reply
        self.change = ParamsChange(self.commander)
        self.hear(probe.say("hello"))

    def listen_again(self) -> None:
        """A port's: nothing to do."""

    def write(self, data: bytes) -> None:
        self.frames += 1
        self.before(self.frames)
        if self.session is None or self.lose(self.frames, False):
            return
        reply = self.probe.hear(data)
        if not self.lose(self.frames, True):
            asyncio.get_running_loop().call_soon(self.hear, reply)

    def hear(self, data: bytes) -> None:
        if self.session is None:
            return
        for frame in data.split(b"\0"):
            for _ in range(self.copies if frame else 0):
                events = self.session.receive(b"\0" + frame + b"\0", host_ns())
                for event in events:
                    self.intake.handle(event, self)

    def restart(self) -> None:
        """The probe starts again, and says so."""
        self.probe.restart()
        self.hear(self.probe.say("hello"))

    def command(
        self, records: bytes, **parameters: str
    ) -> Coroutine[Any, Any, dict[str, Any]]:
        """The effect of a query for cmd/params."""
        asked = {"records": records.hex()} | parameters
        return self.change.command(self.probe.name, asked)

    def load(self, params: Params, **parameters: str) -> dict[str, Any]:
        return asyncio.run(self.command(params.encode(), **parameters))
