# SPDX-License-Identifier: MIT
"""Strokes of the module imuprobe: those of the core."""

from __future__ import annotations

from pathlib import Path

import pytest

from core.stroke_desk import measured
from imud.virtual.stroking import Plan
from imud.wire import schema
from micropython_tape import ABOUT, RATE_HZ, Command, fed, taped
from stroke_bench import feel
from twin_bench import followed, message_of, named

STROKE = 0x14


@pytest.mark.long
def test_its_strokes_are_those_of_the_native_core(
    with_module: Command, tmp_path: Path
) -> None:
    scene = measured(Plan(strokes=2), 7)
    life = feel(followed(), scene.samples, scene.held() & False)
    about = message_of(life.contents[named(life.contents, "hello")[-1]]).fields
    scales = [round(about["acc_lsb"] * 1e9), round(about["gyr_lsb"] * 1e9)]
    scales += [round(about["mag_lsb"] * 1e6), ABOUT[-1]]
    raws = [message_of(life.contents[at]) for at in named(life.contents, "raw")]
    kind = int(schema.Sensor[str(about["sensor"]).upper()])
    contents = fed(with_module, taped(raws, (kind, RATE_HZ, *scales)), tmp_path)
    theirs, ours = (
        [content[5:] for content in each if content[0] == STROKE]
        for each in (life.contents, contents)
    )
    assert len(theirs) > 10
    assert ours == theirs
