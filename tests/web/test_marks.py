# SPDX-License-Identifier: MIT
"""Marks on the page: made there and elsewhere, corrected, taken back, and led to, live
and in a log.
"""

from __future__ import annotations

from fakes import PATIENCE_S
from imud.client import Client
from web.desk import Desk, Seen


def rows(shown: Seen) -> list[str]:
    """The words of each mark that the page lists, the newest first."""
    return shown.page.locator(".marks li b").all_inner_texts()


def test_a_value_is_marked_from_the_page_and_from_elsewhere(
    shown: Seen, desk: Desk
) -> None:
    page = shown.page
    page.get_by_text("A value measured at the tip").wait_for()
    page.locator("canvas").focus()
    page.keyboard.press("m")
    page.keyboard.type("0,42")
    page.fill("[name=mark-text]", "second press")
    page.keyboard.press("Enter")
    page.locator(".marks b").get_by_text("second press").wait_for()
    assert rows(shown) == ["0.42 second press"]
    assert page.input_value("[name=mark-value]") == ""
    with Client(desk.daemon.endpoint) as client:
        name = client.wait_for(seconds=PATIENCE_S)
        client.command(name, "mark", value="7")
    shown.until("document.querySelectorAll('.marks li').length === 2")
    assert rows(shown) == ["7", "0.42 second press"]
    page.fill("[name=mark-value]", "seven")
    page.get_by_role("button", name="Mark", exact=True).click()
    page.get_by_text("mark needs value=NUMBER").wait_for()
    assert page.input_value("[name=mark-value]") == "seven"  # to be mended
    assert len(rows(shown)) == 2


def test_marks_stay_and_can_be_corrected_and_taken_back(shown: Seen) -> None:
    page = shown.page
    page.reload()
    shown.until("document.querySelectorAll('.marks li').length === 2")
    why = "the position of its tip is unknown; calibrate the tip"
    page.get_by_text(why).first.wait_for()
    row = page.locator(".marks li").nth(1)
    row.get_by_role("button", name="Correct").click()
    assert page.input_value("[name=mark-text]") == "second press"
    page.fill("[name=mark-value]", "0,43")
    page.fill("[name=mark-unit]", "N")
    page.keyboard.press("Enter")
    page.locator(".marks b").get_by_text("0.43 N").wait_for()
    assert rows(shown) == ["7", "0.43 N second press"]
    page.get_by_role("button", name="Take back the mark").first.click()
    shown.until("document.querySelectorAll('.marks li').length === 1")


def test_a_mark_of_before_leads_into_its_log(shown: Seen) -> None:
    page = shown.page
    page.get_by_role("button", name="Show the moment").click()
    flag = page.get_by_role("button", name="Mark 0.43 N second press")
    flag.wait_for()
    shown.until("imud.model.played.t_ms > 0")
    page.get_by_role("button", name="Pause", exact=True).click()
    flag.click()
    shown.until(
        "Math.abs(imud.model.played.t_ms - imud.model.marks.of(imud.model.selected)[0]"
        ".id / 1e6) < 1"
    )
    assert rows(shown) == ["0.43 N second press"]
    assert page.get_by_role("button", name="Correct").count() == 0
    page.get_by_role("button", name="Back to live").click()
    shown.until("!imud.model.page.playing && imud.model.probe?.pose")


def test_a_mark_of_now_leads_into_signals(shown: Seen) -> None:
    page = shown.page
    page.fill("[name=mark-text]", "one more")
    page.get_by_role("button", name="Mark", exact=True).click()
    page.locator(".marks b").get_by_text("one more").wait_for()
    page.get_by_role("button", name="Show the moment").first.click()
    shown.until("imud.viewName === 'signals' && imud.view && !imud.view._isLive")
    moment, window = page.evaluate(
        "[imud.model.marks.of(imud.model.selected)[1].t_pose_ns / 1e9,"
        " imud.view.window]"
    )
    assert abs((window["from"] + window["to"]) / 2 - moment) < 1e-3
