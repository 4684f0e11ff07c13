# SPDX-License-Identifier: MIT
"""A stroke through the STM32F405's image: measured, and computed again bit by bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.common.boards import F405
from benchmarks.common.capture import Capture
from benchmarks.common.images import RunFailed
from benchmarks.strokes.runs import Case, Run, run_of
from imud.virtual.stroking import Plan
from system import stroked


@pytest.fixture(scope="module")
def run() -> Run:
    return run_of(Case("one", Plan(seconds=0.75, strokes=1)), seed=3)


@pytest.fixture(scope="module")
def capture(f405: Path, f405_image: Path, run: Run) -> Capture:
    assert f405.is_file()
    return stroked.sent(F405, f405_image, run)


@pytest.mark.nightly
def test_the_image_measures_a_stroke_by_its_button(capture: Capture, run: Run) -> None:
    found = stroked.found_by(capture, run)
    assert len(found.errors) == 1
    assert np.linalg.norm(found.errors) < 0.005
    assert capture.twin().differed == 0


def test_a_capture_that_cannot_be_followed_is_no_proof(capture: Capture) -> None:
    with pytest.raises(RunFailed, match="the twin is"):
        replace(capture, received=capture.received[:5]).twin()
