# SPDX-License-Identifier: MIT
"""Marks on the page: given there, and heard from other programs."""

from __future__ import annotations

from fakes import PATIENCE_S
from imud.client import Client
from web.desk import Desk, Seen


def rows(shown: Seen) -> list[str]:
    """Value and note of each mark that the page lists, the newest first."""
    found = shown.page.locator(".marks tbody tr").all()
    return ["|".join(each.locator("td").all_inner_texts()[1:3]) for each in found]


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
    page.locator(".marks td").get_by_text("second press").wait_for()
    assert rows(shown) == ["0.42|second press"]
    assert page.input_value("[name=mark-value]") == ""
    with Client(desk.daemon.endpoint) as client:
        name = client.wait_for(seconds=PATIENCE_S)
        client.command(name, "mark", value="7")
    shown.until("document.querySelectorAll('.marks tbody tr').length === 2")
    assert rows(shown) == ["7|", "0.42|second press"]
    page.fill("[name=mark-value]", "seven")
    page.get_by_role("button", name="Mark", exact=True).click()
    page.get_by_text("mark needs value=NUMBER").wait_for()
    assert page.input_value("[name=mark-value]") == "seven"  # to be mended
    assert len(rows(shown)) == 2
