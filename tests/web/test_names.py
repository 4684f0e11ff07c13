# SPDX-License-Identifier: MIT
"""The page where probes get names, go, and come back."""

from __future__ import annotations

from playwright.sync_api import Browser

from web.desk import Desk, Seen, seen

STATE = "imud.model.link.state"


def hash_of(shown: Seen) -> str:
    return str(shown.page.evaluate("location.hash"))


def test_a_probe_is_followed_to_its_new_name_on_every_page(
    browser: Browser, shown: Seen, desk: Desk
) -> None:
    # Nobody has named it yet: its board, and the end of its id.
    choice = shown.page.locator("[aria-label=Probe] option")
    shown.until("imud.model.probe.status !== null")
    assert choice.all_inner_texts() == ["nano-66aa"]
    with seen(browser, desk, "aim") as other:
        other.page.evaluate("imud.states = []")
        other.page.evaluate(
            "imud.link.addEventListener('state', () => imud.states.push(0))"
        )
        page = shown.page
        page.get_by_text("Name, log, sound, rates, reset").click()
        page.fill("[name=probe-name]", "stylus")
        page.get_by_role("button", name="Rename").click()
        page.get_by_text("Rename: done").wait_for()
        for each in (shown, other):
            each.page.get_by_text("nano-66aa is now called stylus").wait_for()
            each.until("imud.model.selected === 'stylus' && imud.model.probe?.pose")
            assert each.page.evaluate("imud.model.names") == ["stylus"]
            assert each.page.locator("[aria-label=Probe]").input_value() == "stylus"
        assert hash_of(shown) == "#/probe/stylus"
        assert hash_of(other) == "#/aim/stylus"
        assert other.page.evaluate("imud.states") == []  # never disconnected
        page.fill("[name=probe-name]", "a/b")
        page.get_by_role("button", name="Rename").click()
        page.get_by_text("can't be part of a key").wait_for()


def test_a_bookmark_of_a_probe_that_is_not_there_shows_nobody_elses(
    browser: Browser, desk: Desk
) -> None:
    with seen(browser, desk) as shown:
        page = shown.page
        name = page.evaluate("imud.model.selected")
        for view in ("probe", "calibrate"):
            page.evaluate("view => { location.hash = `#/${view}/GONE`; }", view)
            page.get_by_text("No probe is called GONE").wait_for()
            assert not page.evaluate("imud.view.scene.body.visible")
        page.evaluate("location.hash = '#/probe/GONE'")
        shown.until("imud.viewName === 'probe'")
        assert shown.text('[data-value="yaw"]') == "\u2013"
        assert shown.text("[data-part=state]") == ""
        page.select_option("[aria-label=Probe]", name)
        shown.until("imud.view.scene.body.visible")
        assert not page.get_by_text("No probe is called").is_visible()
