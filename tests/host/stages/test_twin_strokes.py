# SPDX-License-Identifier: MIT
"""The twin follows strokes, tip and button of a probe in every bit."""

from __future__ import annotations

from core.stroke_desk import measured
from imud.stages.twin_outcomes import TwinLost, TwinStarted, TwinState
from imud.virtual.stroking import Plan
from stroke_bench import TIP, feel, stroking
from twin_bench import followed, message_of, named, run_twin, without


def test_a_button_makes_strokes_that_the_twin_computes_again() -> None:
    life, scene = stroking()
    feel(life, scene.samples, scene.held())
    strokes = [message_of(life.contents[at]) for at in named(life.contents, "stroke")]
    ends = [each.fields["end"] for each in strokes if each.fields["end"] != "running"]
    assert ends == ["button", "button"]
    assert len(named(life.contents, "stream_stopped")) == 0
    places = [message_of(life.contents[at]) for at in named(life.contents, "pose")]
    assert places[-1].fields["position"] is not None
    assert places[-1].fields["normal"] is not None
    twin, outcomes = run_twin(life.contents)
    assert [type(each) for each in outcomes] == [TwinStarted]
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)


def test_a_click_still_ends_the_stream() -> None:
    life, scene = stroking()
    held = scene.held() & False
    held[600:630] = True
    feel(life, scene.samples[:800], held[:800])
    assert len(named(life.contents, "stream_stopped")) == 1


def test_a_stroke_that_differs_is_told() -> None:
    life, scene = stroking()
    feel(life, scene.samples, scene.held())
    last = named(life.contents, "stroke")[-1]
    spoilt = bytearray(life.contents[last])
    spoilt[18] ^= 1  # the displacement's first byte
    life.contents[last] = bytes(spoilt)
    twin, _ = run_twin(life.contents)
    assert (twin.state, twin.differed) == (TwinState.DIFFERS, 1)


def test_a_lost_press_is_no_difference() -> None:
    life, scene = stroking()
    feel(life, scene.samples, scene.held())
    press = named(life.contents, "button_pressed")[0]
    twin, outcomes = run_twin(without(life.contents, press))
    assert TwinLost in [type(each) for each in outcomes]
    assert twin.differed == 0


def test_rests_make_strokes_where_the_button_does_not() -> None:
    scene = measured(Plan(strokes=2), 7)
    life = feel(followed().load(TIP), scene.samples, scene.held() & False)
    strokes = [message_of(life.contents[at]) for at in named(life.contents, "stroke")]
    ends = [each.fields["end"] for each in strokes if each.fields["end"] != "running"]
    assert ends == ["rest", "rest"]
    twin, outcomes = run_twin(life.contents)
    assert [type(each) for each in outcomes] == [TwinStarted]
    assert twin.differed == 0
