# SPDX-License-Identifier: MIT
"""Strokes on the page, in Chromium: drawn as they end, and closed."""

from __future__ import annotations

import pytest

from streaming import until
from web.desk import Desk, Seen
from web.turns import PATH

CLOSED = "globalThis.imud.model.strokes.closing.closed_m"
FORWARD = (0.5, 0.5, -0.5, 0.5)


def draw_two(shown: Seen, desk: Desk) -> None:
    desk.hand.turn(FORWARD, position=(0.03, 0.0, 0.04))
    shown.until("globalThis.imud.model.probe.pose.position_m?.[2] === 0.04")
    for number, x in ((1, 0.03), (2, 0.06)):
        stroke = {"stroke": number, "end": "rest", "displacement": (0.03, 0.0, 0.0)}
        errors = {"displacement_sigma": (0.002, 0.001), "path_sigma": (0.004, 0.002)}
        desk.hand.say("stroke", **stroke, **errors, path=(x, 0.0, 0.0))
    shown.until("globalThis.imud.model.strokes.stops.length === 3")


def test_a_path_is_closed_by_a_click_on_the_page_or_two_of_the_probe(
    shown: Seen, desk: Desk
) -> None:
    page = shown.page
    draw_two(shown, desk)
    page.get_by_role("button", name="Close path").click()
    page.get_by_text("Close path: done").wait_for()
    shown.until("globalThis.imud.model.strokes.closing !== null")
    page.get_by_text(
        "95 %: ±12.2 mm; it did not return, or a stroke is wrong"
    ).wait_for()
    assert shown.number("closure") == 50.0
    page.locator('[data-kind="warn"]', has_text="Closure").wait_for()
    assert page.evaluate(CLOSED) is None
    for event in 2 * ("button_pressed", "button_released"):
        desk.hand.say("event", event=event, cause="button")
    shown.until("globalThis.imud.model.strokes.closing.by === 'button'")
    page.get_by_text("Closure").wait_for()
    desk.hand.say("stroke", stroke=3, end="running")
    page.get_by_text("Closure").wait_for(state="hidden")


def test_the_tip_is_drawn_where_it_is_with_its_strokes_and_their_errors(
    shown: Seen, desk: Desk
) -> None:
    page = shown.page
    draw_two(shown, desk)
    scale = 1.32 / 0.05  # the ring's radius is the least length that fits
    page.get_by_text("the ring's radius is 5 cm").wait_for()
    until(lambda: len(page.evaluate(PATH)["sizes"]) == 3)
    drawn = page.evaluate(PATH)
    assert drawn["tip"] == pytest.approx([0.03 * scale, 0.0, 0.04 * scale], abs=1e-5)
    assert drawn["sizes"][2] == pytest.approx(
        [2 * 0.004 * scale, 2 * 0.004 * scale, 2 * 0.002 * scale], rel=1e-3
    )
    until(lambda: shown.number("stroke") == 30.0)  # numbers follow the drawing
    assert shown.text('[data-sigma="stroke"]') == "±2.0 mm"
    page.get_by_role("button", name="There and back").click()
    page.get_by_text("Press, and move to the other point").wait_for()
    stroke = {"stroke": 3, "end": "too_long", "displacement": None}
    lost = {"displacement_sigma": None, "path": None, "path_sigma": None}
    desk.hand.say("stroke", **stroke, **lost)
    page.get_by_text("end it within 5 s; begin again").wait_for()
    page.get_by_text("Press, and move to").wait_for(state="hidden")
    desk.hand.turn(FORWARD, pose_flags=("starting",))
    page.get_by_role("button", name="There and back").click()
    page.get_by_text("Set origin: wait until the probe has found").wait_for()
    page.get_by_text("Press, and move to").wait_for(state="hidden")
    desk.hand.turn(FORWARD, position=None)
    page.get_by_text("sector and cone").wait_for()


def test_there_and_back_is_guided_with_a_count_down_and_closed(
    shown: Seen, desk: Desk
) -> None:
    page = shown.page
    page.get_by_role("button", name="There and back").click()
    page.get_by_text("Put the tip on the mark and hold it still: 1 s").wait_for()
    errors = {"displacement_sigma": (0.002, 0.001), "path_sigma": (0.004, 0.002)}
    ways = (
        (1, "Press, and move to the other point", 0.03, 0.03, 0.0),
        (2, "Press, and move back to the mark", 0.002, -0.028, 0.001),
    )
    for number, words, x, way, z in ways:
        page.get_by_text(words).wait_for()
        shown.until("imud.model.probe.event.event === 'tared'")
        desk.hand.say("stroke", stroke=number, end="running")
        page.get_by_text("and release: 2 s").wait_for()
        desk.hand.turn(FORWARD, position=(x, 0.0, z))
        shown.until(f"globalThis.imud.model.probe.pose.position_m?.[0] === {x}")
        stroke = {"stroke": number, "end": "rest", "displacement": (way, 0.0, 0.0)}
        desk.hand.say("stroke", **stroke, **errors, path=(x, 0.0, 0.0))
        page.get_by_text("Hold it still: 1 s").wait_for()
    page.get_by_text("; there 29.0 ±1.6 mm").wait_for()
    assert page.evaluate(CLOSED)[-1] == [0, 0, 0]
    page.get_by_text("Hold it still").wait_for(state="hidden")
