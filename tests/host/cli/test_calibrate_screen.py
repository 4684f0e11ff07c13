# SPDX-License-Identifier: MIT
"""What `imud calibrate` draws on a terminal."""

from __future__ import annotations

import os
import pty
import select
import sys
import threading

import pytest

from imud.calibration.guided.procedure import Procedure
from imud.cli import calibrate_screen
from imud.cli.calibrate_screen import CalibrationScreen, lines
from imud.cli.keyboard import Quit
from imud.virtual.calibrating import SCALE
from raw_probe import calibrating


def test_the_screen_says_what_to_do_and_how_good_it_is() -> None:
    procedure = Procedure(SCALE)
    first = "\n".join(line.plain for line in lines("stylus", procedure.status()))
    assert "stylus  pose 0 of 12" in first
    assert "Lay it base down and let go." in first
    assert first.count("not yet") == 2
    for each in calibrating()[:2650]:
        procedure.feed(each)
    shown = lines("stylus", procedure.status())
    later = "\n".join(line.plain for line in shown)
    assert "pose 7 of 12" in later
    assert "Good (7 of 12). Now lay it " in later
    assert "tilt     +-0." in later
    assert "moves" in later
    assert "Enter evaluates now; q stops without changes" in later
    assert max(len(line.plain) for line in shown) <= 100


@pytest.mark.parametrize(("key", "is_end"), [(b"\n", True), (b"x", False)])
def test_keys_end_or_give_up(
    monkeypatch: pytest.MonkeyPatch, key: bytes, is_end: bool
) -> None:
    master, slave = pty.openpty()
    drained = threading.Thread(target=_drain, args=(master,), daemon=True)
    with open(slave, "r+b", buffering=0) as terminal:  # noqa: PTH123 - a descriptor
        text = os.fdopen(os.dup(slave), "w")
        monkeypatch.setattr(sys, "stdin", terminal)
        monkeypatch.setattr(sys, "stdout", text)
        monkeypatch.setenv("TERM", "xterm")
        screen = CalibrationScreen("stylus")
        drained.start()
        with screen.opened():
            screen.show(Procedure(SCALE).status())
            assert not screen.is_ended()
            os.write(master, key)
            select.select([slave], [], [], 5.0)
            assert screen.is_ended() == is_end
            os.write(master, b"q")
            select.select([slave], [], [], 5.0)
            with pytest.raises(Quit):
                screen.is_ended()
        text.close()
    # It ends with the terminal. Otherwise it would read from the next file with that
    # number.
    drained.join()
    assert not drained.is_alive()
    os.close(master)


def _drain(master: int) -> None:
    try:
        while os.read(master, 4096):
            pass
    except OSError:
        pass


def test_a_pipe_gets_each_sentence_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(calibrate_screen, "DRAW_S", 0.0)
    screen = CalibrationScreen("stylus")
    with screen.opened():
        for words in ("one", "one", "two", "two", "one"):
            screen.show_text(words)
        screen.show_text("one", "it moved")
        screen.show_text("one", "it moved")
    assert capsys.readouterr().out == "one\ntwo\none\nit moved\n"
