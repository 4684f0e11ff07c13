# SPDX-License-Identifier: MIT
"""Gestures are told from presses and releases by the device's times, and where one of
those may be lost there is none.
"""

from __future__ import annotations

import pytest

from imud.probes.gestures import EVENTS, Gestures


# Presses and releases by turns, at times in ms; negative: messages before are lost.
@pytest.mark.parametrize(
    ("times_ms", "words"),
    [
        ([0, 200], "click"),
        ([0, 500], "click"),
        ([0, 501], ""),
        ([0, 100, 500, 600], "double"),
        ([0, 100, 551, 651], "click click"),
        ([0, 100, 200, 2000], "double"),
        ([0, 100, 200, 300, 400, 2000], "double hold"),
        ([0, 999], ""),
        ([0, 1000], "hold"),
        ([0, 2999], "hold"),
        ([0, 3000], "long"),
        ([0, 9999], "long"),
        ([0, 10_000], ""),
        ([0, 200, 1000, 2500], "click hold"),
        ([0, -1500], ""),  # a release and another press may be missing
        ([0, 100, -400, 500], "click"),
    ],
)
def test_each_gesture_is_told_from_the_others(times_ms: list[int], words: str) -> None:
    gestures = Gestures()
    found = []
    for count, t_ms in enumerate(times_ms):
        t_us, name = 1000 * abs(t_ms), EVENTS[count % 2]
        found.append(gestures.look(t_us))
        found.append(gestures.on_event(name, t_us, is_after_gap=t_ms < 0))
    found.append(gestures.look(1000 * times_ms[-1] + 550_001))
    assert [each for each in found if each] == words.split()


def test_a_press_that_made_a_stroke_is_no_click() -> None:
    gestures = Gestures()
    for name, t_us in zip(EVENTS, (0, 100_000), strict=True):
        gestures.on_event(name, t_us, is_after_gap=False)
    gestures.forget_click()
    assert gestures.on_event(EVENTS[0], 200_000, is_after_gap=False) is None
    assert gestures.look(10**9) is None
