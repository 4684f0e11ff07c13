# SPDX-License-Identifier: MIT
"""One bit in a hundred wrong for a minute: what is passed on is what was sent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fakes import FakeProbe
from imud.probes.session import Probe, Received, Session
from imud.wire.frame import FrameDecoder
from length import choose

SECONDS, RATE_HZ = 60, 200
ERRORS = 0.01

# A frame whose every byte is random passes a 16-bit CRC so often.
PASSES = 2.0**-16


def hurt(data: bytes, seed: int) -> bytes:
    """Each bit is wrong with that probability, independently."""
    wire = np.frombuffer(data, np.uint8)
    flips = np.random.default_rng(seed).random((len(wire), 8)) < ERRORS
    return (wire ^ np.packbits(flips, axis=1)[:, 0]).tobytes()


@pytest.mark.long
@pytest.mark.parametrize("seed", range(choose(everyday=1, long=4)))
def test_a_minute_of_bit_errors_publishes_no_wrong_pose(
    seed: int, record_property: Callable[[str, object], None]
) -> None:
    probe = FakeProbe()
    known = Probe(probe.name)
    hello = b"\0" + probe.say("hello")
    session = Session(lambda _: known, 0)
    events = session.receive(hello, 0)
    contents = {}
    crc_passed = 0
    crc = FrameDecoder()
    for turn in range(SECONDS * RATE_HZ):
        name = "pose" if turn % RATE_HZ else "hello"
        sequence = probe.sequence
        clean = probe.say(name)
        (contents[sequence],) = FrameDecoder().feed(clean)
        data = hurt(clean, seed * 1_000_000 + turn)
        for content in crc.feed(data):
            crc_passed += content not in contents.values() if data != clean else 0
        events += session.receive(data, (turn + 1) * 1_000_000_000 // RATE_HZ)
    bad = crc.stats.bad
    wrong = [
        event
        for event in events
        if isinstance(event, Received)
        and event.message.sequence != 0
        and event.content != contents.get(event.message.sequence)
    ]
    through = sum(isinstance(event, Received) for event in events)
    expected = sum(bad.values()) * PASSES
    record_property("passed on", through)
    record_property("passed the CRC and wrong", crc_passed)
    record_property("expected of these", expected)
    assert wrong == []
    assert 0 < through < SECONDS * RATE_HZ * 0.05
    # Poisson: more than six where a quarter of one is expected is once in 10^8.
    assert crc_passed <= 6
    counts = known.account.counts()
    assert counts["received"] == through
