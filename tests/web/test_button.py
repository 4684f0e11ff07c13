# SPDX-License-Identifier: MIT
"""The gestures of a probe's button: chosen on the page, carried out by the daemon,
counted down and told by sounds; an origin set so can be undone.
"""

from __future__ import annotations

import json

from imud.log.seekable import SeekableLog
from web.desk import Desk, Seen
from web.test_alarm import COUNT_NOTES

CHOICES = {
    "Click": "mark",
    "Double click": "undo origin",
    "Hold 1 s": "set origin",
    "Hold 3 s": "start or stop",
}


def press(desk: Desk, held_us: int) -> None:
    """A press of the button, and its release so much later by the probe's clock."""
    desk.hand.say("event", event="button_pressed", cause="button")
    desk.probe.time_us += held_us
    desk.hand.say("event", event="button_released", cause="button")


def given(desk: Desk) -> list[tuple[str, int]]:
    all_of = [(str(e["command"]), e["arguments"][0]) for e in desk.probe.commands]
    return [each for each in all_of if each[0] in ("start", "stop", "tare")]


def test_gestures_are_chosen_and_a_held_button_counts_down(
    shown: Seen, desk: Desk
) -> None:
    page = shown.page
    page.evaluate(COUNT_NOTES)
    press(desk, 1_500_000)
    page.get_by_text("Button", exact=True).click()
    page.get_by_text("The probe acts on its button by itself").wait_for()
    for gesture, action in CHOICES.items():
        page.get_by_label(gesture, exact=True).select_option(label=action)
    page.get_by_role("button", name="Apply").click()
    page.get_by_text("imud acts on its button").wait_for()
    assert given(desk) == []
    kept = desk.daemon.logs.parent / "state" / "imud" / "buttons.json"
    assert json.loads(kept.read_text()) == {desk.probe.name: "mark,undo,origin,stream"}
    desk.hand.say("event", event="button_pressed", cause="button")
    page.get_by_text("In 1 s: set origin.").wait_for()
    page.get_by_text("Release: set origin. In 2 s: start or stop.").wait_for()
    desk.probe.time_us += 1_500_000
    desk.hand.say("event", event="button_released", cause="button")
    page.get_by_text("Its button has set the origin").wait_for()
    shown.until("notes.slice(-4).join() === '880,523,659,784'")
    page.locator(".lines .held").get_by_role("button", name="Undo").click()
    page.locator(".lines .held").wait_for(state="hidden")
    assert given(desk) == [("tare", 0), ("tare", 2)]


def test_each_does_its_part_or_says_why_not_and_is_logged(
    shown: Seen, desk: Desk
) -> None:
    page = shown.page
    press(desk, 100_000)
    page.locator(".marks b").get_by_text("by its button").wait_for()
    press(desk, 100_000)
    press(desk, 100_000)
    shown.until("imud.model.probe.event.event === 'tared'")
    press(desk, 4_000_000)
    page.get_by_text("stopped, by its button").wait_for()
    desk.hand.turn((1.0, 0.0, 0.0, 0.0), pose_flags=("starting",))
    shown.until("imud.model.probe.pose.flags.includes('starting')")
    press(desk, 1_500_000)
    page.get_by_text("tare was refused: wait until it has found level").wait_for()
    assert given(desk)[2:] == [("tare", 2), ("stop", 0)]
    assert page.locator(".marks b").get_by_text("by its button").count() == 1
    page.get_by_role("button", name="Leave it to the probe").click()
    page.get_by_text("The probe acts on its button by itself").wait_for()
    desk.end_daemon()
    log = SeekableLog(max(desk.daemon.logs.glob("*.mcap")))
    told = [json.loads(each.data) for each in log.of("command")]
    by_button = [each["command"] for each in told if each["by"] == "button"]
    assert by_button == ["tare", "mark", "tare", "stop", "tare"]
