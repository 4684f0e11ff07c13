# SPDX-License-Identifier: MIT
"""How `imud check` asks: poses, the button and the LED, on a terminal and in a pipe."""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Iterator
from typing import Any

import pytest

from check_bench import HELLO, STATUS, raws
from imud.check.axes import ASKED
from imud.check.evidence import Evidence
from imud.check.judge import judged
from imud.check.rows import RowVerdict
from imud.cli import check_run
from imud.cli.check_screen import CheckScreen
from imud.cli.check_source import LiveMessages
from imud.cli.keyboard import Quit


class Script(LiveMessages):
    """A source of scripted messages; then nothing comes."""

    def __init__(self, items: Iterable[dict[str, Any]]) -> None:
        self._items = list(items)

    def items(self) -> Iterator[dict[str, Any] | None]:
        while self._items:
            yield self._items.pop(0)
        while True:
            yield None


class Keys(CheckScreen):
    """A terminal on which these keys are pressed, one at each look."""

    def __init__(self, pressed: str = "", *, is_terminal: bool = False) -> None:
        self.out = io.StringIO()
        super().__init__(self.out, "board")
        self._pressed = list(pressed)
        self._is_terminal = is_terminal

    @property
    def is_terminal(self) -> bool:
        return self._is_terminal

    def key(self) -> str:
        return self._pressed.pop(0) if self._pressed else ""


def at_rest() -> Evidence:
    """A board that was measured at rest."""
    found = Evidence(is_live=True)
    for item in (HELLO, STATUS, *raws(6.0)):
        found.add_message(item)
    return found


def lying(*ups: tuple[float, float, float]) -> list[dict[str, Any]]:
    """Samples of a board that is laid with each of these up."""
    found = [item for up in ups for item in raws(3.0, acc=up)]
    for number, item in enumerate(found):
        item["t_device_us"] = 10_000_000 + 5_000 * number
    return found


@pytest.mark.parametrize(
    ("turns", "verdict"),
    [
        (((0, 0, 1), (0, -1, 0), (1, 0, 0)), RowVerdict.GOOD),
        (((0, 0, 1), (0, 1, 0), (1, 0, 0)), RowVerdict.FAULT),
    ],
)
def test_the_poses_are_asked_for_one_by_one(
    turns: tuple[tuple[float, float, float], ...], verdict: RowVerdict
) -> None:
    found, screen = at_rest(), Keys()
    check_run._lay(Script(lying(*turns)), found, screen)
    assert [each.pose for each in found.poses] == list(ASKED)
    (row,) = (row for row in judged(found) if row.name == "axes")
    assert row.verdict is verdict
    told = screen.out.getvalue().splitlines()
    assert told == [
        "Lay it on its left side, right up, and let go (40 s; Enter skips it).",
        "Lay it on its back, front up, and let go (40 s; Enter skips it).",
    ]
    # Noise and offsets are those of the first pose.
    names = {row.name: row.verdict for row in judged(found)}
    assert names["accelerometer offset"] is RowVerdict.GOOD


def test_enter_leaves_a_pose_out_and_so_does_the_end_of_the_samples(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = at_rest()
    check_run._lay(Script([]), found, Keys("\n\n"))
    assert [each.acc_m_s2 is None for each in found.poses] == [False, True, True]
    monkeypatch.setattr(check_run, "LATE_S", -check_run.TIMEOUT_S)
    check_run._lay(Script([]), found, Keys())
    assert [each.acc_m_s2 is None for each in found.poses] == [False, True, True]


PRESS = {
    "type": "event",
    "event": "button_pressed",
    "cause": "button",
    "detail": 0,
}


def test_a_press_ends_the_wait_for_the_button() -> None:
    found, screen = at_rest(), Keys()
    check_run._touch(Script([PRESS]), found, screen)
    assert (found.button, found.led) == (True, None)
    assert "Press its button once" in screen.out.getvalue()


@pytest.mark.parametrize(
    ("keys", "button", "led"),
    [("\ny", None, True), ("\nn", None, False), ("\n\n", None, None)],
)
def test_a_terminal_is_asked_for_the_led(
    monkeypatch: pytest.MonkeyPatch, keys: str, button: bool | None, led: bool | None
) -> None:
    monkeypatch.setattr(check_run, "STATUS_S", -1.0)
    found = at_rest()
    check_run._touch(Script([]), found, Keys(keys, is_terminal=True))
    assert (found.button, found.led) == (button, led)


def test_no_press_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_run, "BUTTON_S", 0.0)
    found = at_rest()
    check_run._touch(Script([]), found, Keys())
    assert found.button is False


def test_a_terminal_shows_how_far_it_is_and_takes_keys(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours, theirs = os.openpty()
    with (
        open(theirs, closefd=False) as keyboard,
        open(theirs, "w", closefd=False) as terminal,
    ):
        monkeypatch.setattr("sys.stdin", keyboard)
        screen = CheckScreen(terminal, "board")
        with screen.opened():
            assert screen.is_terminal
            screen.line("not here")
            screen.show("Lay it down", 0.5)
            assert screen.key() == ""
            os.write(ours, b"N")
            assert screen.key() == "n"
            os.write(ours, b"q")
            with pytest.raises(Quit):
                screen.key()
    shown = os.read(ours, 65536).decode()
    os.close(ours)
    os.close(theirs)
    assert "Lay it down" in shown
    assert "█" in shown
    assert "not here" not in shown
