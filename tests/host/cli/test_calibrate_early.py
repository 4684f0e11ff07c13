# SPDX-License-Identifier: MIT
"""Who ends `imud calibrate` too early on a terminal: Enter asks for the poses that are
missing, once, and goes on; a second Enter takes it at that.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from chain import Chain
from imud.calibration.mounting import ASKED
from raw_probe import Stream, calibrating
from terminal import Terminal

FIVE = len(ASKED)
MISSING = "the tilt error would be +-0.54 degrees"  # the line wraps after it


@pytest.fixture
def stream(bench: Chain) -> Iterator[Stream]:
    """A hand that has laid the probe five times."""
    if bench.probe.params.records:
        with Stream(bench, ()):
            bench.client.change_params(bench.probe.name, b"")
    bench.probe.commands.clear()
    with Stream(bench, calibrating(FIVE)) as made:
        yield made


@pytest.fixture
def terminal(stream: Stream) -> Iterator[Terminal]:
    endpoint = stream.chain.daemon.endpoint
    made = Terminal("calibrate", "--no-housing", "--connect", endpoint)
    yield made
    made.close()


def test_continuing_after_an_early_end_calibrates(
    bench: Chain, stream: Stream, terminal: Terminal
) -> None:
    terminal.until(lambda text: "Good (5 of 12)" in text)
    terminal.press(b"\n")
    terminal.until(lambda text: MISSING in text)
    stream.goes_on(calibrating())
    assert terminal.end() == 0
    assert "are active" in terminal.text
    assert bench.probe.params.records


def test_who_has_had_enough_is_refused_with_the_poses(
    bench: Chain, terminal: Terminal
) -> None:
    terminal.until(lambda text: "Good (5 of 12)" in text)
    terminal.press(b"\n")
    terminal.until(lambda text: MISSING in text)
    assert terminal.process.poll() is None
    terminal.press(b"\n")
    assert terminal.end() == 1
    assert f"imud: refused: {MISSING}" in terminal.text
    assert not bench.probe.params.records
