# SPDX-License-Identifier: MIT
"""`imud strokes` prints each stroke as it ends."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from typing import IO, cast

import pytest

from chain import Chain
from imud.cli.stroke_lines import line_of

STROKE = {
    "probe": "stylus",
    "stroke": 3,
    "windows": 14,
    "displacement_m": [0.03, -0.04, 0.0],
    "displacement_sigma_m": [0.0021, 0.0021, 0.0018],
    "end": "button",
}


def test_a_stroke_is_a_line_with_its_length_and_errors() -> None:
    assert line_of(STROKE).split() == [
        *("stylus", "3", "1.4", "s", "5.00", "cm", "3.00", "-4.00", "0.00"),
        *("0.21", "0.21", "0.18", "button"),
    ]


def test_a_stroke_without_length_says_why() -> None:
    lost = STROKE | {"displacement_m": None, "end": "too_long"}
    assert line_of(lost).split() == ["stylus", "3", "1.4", "s", "unknown", "too_long"]


@pytest.mark.parametrize("words", [[], ["--json"]])
def test_strokes_are_printed_as_they_end(chain: Chain, words: list[str]) -> None:
    command = [sys.executable, "-m", "imud", "strokes", *words]
    command += ["--connect", chain.daemon.endpoint]
    ended = threading.Event()

    def speak() -> None:
        """Again and again: nobody knows when the subscription has arrived."""
        while not ended.wait(0.05):
            chain.port.write(chain.probe.say("stroke", end="running"))
            chain.port.write(chain.probe.say("stroke", stroke=7))

    speaker = threading.Thread(target=speak)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        speaker.start()
        out = cast(IO[str], program.stdout)
        lines = [out.readline() for _ in range(2)]
        ended.set()
        speaker.join()
        program.terminate()
    if words:
        assert [json.loads(line)["stroke"] for line in lines] == [7, 7]
    else:
        assert lines[0].startswith("probe")
        assert lines[1].split()[:2] == [chain.probe.name, "7"]
