# SPDX-License-Identifier: MIT
"""The hands of `imud sim --hand` that wobble and measure."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from imud.cli import build_parser, main
from imud.cli.sim import HANDS
from imud.virtual import measuring, modules
from imud.virtual.dimpling import TIP_M
from imud.virtual.hands import pieces_of
from imud.virtual.motion import join
from imud.virtual.sim import presses_of
from imud.virtual.stroking import SETTLES_S, strokes_of

RATE_HZ = 500.0


@pytest.mark.parametrize("name", HANDS)
def test_each_hand_moves_the_probe_without_end(name: str) -> None:
    pieces = pieces_of(name, modules.calibrated(), 1, RATE_HZ)
    motion = join(list(itertools.islice(pieces, 3)))
    assert np.isfinite(motion.acc).all()
    assert len(motion) > RATE_HZ


def test_the_button_is_held_while_the_hand_strokes() -> None:
    presses = list(measuring.presses_us(4, RATE_HZ))
    assert len(presses) == measuring.PLAN.strokes
    pieces = measuring.pieces(modules.calibrated(), 4, RATE_HZ)
    motion = join(list(itertools.islice(pieces, 9)))
    strokes = strokes_of(motion)
    assert len(strokes) >= 2
    for stroke, (down_us, up_us) in zip(strokes, presses, strict=False):
        assert down_us * 1e-6 == pytest.approx(stroke.start_s - 0.05, abs=0.01)
        assert up_us * 1e-6 == pytest.approx(stroke.end_s + 0.05, abs=0.01)
        assert np.linalg.norm(stroke.tip_way_m) == pytest.approx(0.2)
    assert presses[0][0] > SETTLES_S * 1e6


def test_the_emulator_gets_the_presses_of_the_hand_that_measures() -> None:
    words = ["sim", "f405", "--hand", "button", "--stream", "--seed", "4"]
    presses = list(presses_of(build_parser().parse_args(words)))
    assert len(presses) <= 64  # RUN_LIST_MAX
    assert len(presses) == 1 + measuring.PLAN.strokes
    words[3] = "stroke"
    assert len(list(presses_of(build_parser().parse_args(words)))) == 1


def test_a_nano_has_no_strokes_to_measure() -> None:
    with pytest.raises(SystemExit):
        main(["sim", "nano", "--hand", "stroke"])


def test_the_tip_of_a_wobbled_probe_stays_where_it_is() -> None:
    pieces = pieces_of("dimple", modules.calibrated(), 1, RATE_HZ)
    motion = join(list(itertools.islice(pieces, 12)))
    assert motion.tip is not None
    assert motion.position is not None
    assert np.abs(motion.tip).max() == 0.0
    away = np.linalg.norm(motion.position, axis=1)
    assert away == pytest.approx(np.linalg.norm(TIP_M))
