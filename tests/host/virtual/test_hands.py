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


# How far the tip goes in a stroke, m.
LENGTHS = {
    "stroke": {0.2},
    "button": {0.2},
    "sheet": {0.297, 0.21},
    "circle": {0.0765},  # a chord of an eighth: 0.2 sin(22.5 degrees)
}


@pytest.mark.parametrize("name", measuring.PLANS)
def test_the_button_is_held_while_the_hand_strokes(name: str) -> None:
    presses = list(measuring.presses_us(name, 4, RATE_HZ))
    assert len(presses) == measuring.PLANS[name].strokes
    pieces = measuring.pieces(name, modules.calibrated(), 4, RATE_HZ)
    motion = join(list(itertools.islice(pieces, 9)))
    strokes = strokes_of(motion)
    assert len(strokes) >= 2
    for stroke, (down_us, up_us) in zip(strokes, presses, strict=False):
        assert down_us * 1e-6 == pytest.approx(stroke.start_s - 0.05, abs=0.01)
        assert up_us * 1e-6 == pytest.approx(stroke.end_s + 0.05, abs=0.01)
        length = round(float(np.linalg.norm(stroke.tip_way_m)), 4)
        if measuring.PLANS[name].support == "supported":
            assert length in LENGTHS[name]
        else:  # a hand that sways
            assert length == pytest.approx(0.1, abs=0.005)
    assert presses[0][0] > SETTLES_S * 1e6


@pytest.mark.parametrize("name", measuring.PLANS)
def test_the_emulator_gets_the_presses_of_a_hand_that_measures(name: str) -> None:
    words = ["sim", "f405", "--hand", name, "--stream", "--seed", "4"]
    presses = list(presses_of(build_parser().parse_args(words)))
    strokes = measuring.PLANS[name].strokes
    assert 1 + strokes <= 64  # RUN_LIST_MAX
    assert len(presses) == (1 if name == "stroke" else 1 + strokes)


@pytest.mark.parametrize("name", measuring.PLANS)
def test_a_nano_has_no_strokes_to_measure(name: str) -> None:
    with pytest.raises(SystemExit):
        main(["sim", "nano", "--hand", name])


def test_the_tip_of_a_wobbled_probe_stays_where_it_is() -> None:
    pieces = pieces_of("dimple", modules.calibrated(), 1, RATE_HZ)
    motion = join(list(itertools.islice(pieces, 12)))
    assert motion.tip is not None
    assert motion.position is not None
    assert np.abs(motion.tip).max() == 0.0
    away = np.linalg.norm(motion.position, axis=1)
    assert away == pytest.approx(np.linalg.norm(TIP_M))
