# SPDX-License-Identifier: MIT
"""The times of samples that a board without a data-ready wire has polled."""

from __future__ import annotations

import pytest

from fakes import FakeProbe
from imud.probes.clock import ProbeClock
from imud.probes.probe import POLL_NS, Probe
from imud.probes.session import Received, Session

BOUND_NS = 400_000


@pytest.mark.parametrize(
    ("board", "more_ns"), [("nano", 0), ("f405", 0), ("pico", POLL_NS)]
)
def test_a_poll_is_in_the_bound_of_samples(
    board: str, more_ns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        ProbeClock, "date", lambda _, device_us, __: (device_us * 1000, BOUND_NS)
    )
    fake = FakeProbe(board=board)
    session = Session(Probe, t_ns=0)
    data = b"\0" + b"".join(fake.say(name) for name in ("hello", "status", "pose"))
    bounds = {
        event.message.name: event.stamp.t_bound_ns
        for event in session.receive(data, 1_000_000_000)
        if isinstance(event, Received)
    }
    assert bounds["pose"] - bounds["status"] == more_ns
