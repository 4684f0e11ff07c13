# SPDX-License-Identifier: MIT
"""Each view can be read by a screen reader and worked by keys, as far as axe-core can
tell: WCAG 2.1, levels A and AA, in both themes, on a screen and on a phone.
"""

from __future__ import annotations

import json
from typing import Any

import pytest
from playwright.sync_api import Browser, Page

from demanded import leave_out
from imud.checkout import ROOT
from length import IS_LONG
from web.desk import Desk, seen
from web.limbs import leg
from web.served import Served

AXE = ROOT / "build" / "web" / "node_modules" / "axe-core" / "axe.min.js"
VIEWS = ("probe", "signals", "calibrate", "aim", "probes", "limb")
SIZES = {"screen": (1440, 900), "tablet": (1024, 768), "phone": (390, 844)}
TAGS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]
TAGS_ONLY = {"runOnly": {"type": "tag", "values": TAGS}}

if not AXE.exists():
    leave_out("axe-core is not there", is_whole_file=True)


def told(violation: dict[str, Any]) -> str:
    places = [" ".join(map(str, node["target"])) for node in violation["nodes"]]
    return f"{violation['id']} ({violation['help']}): {'; '.join(places[:4])}"


def complaints(page: Page, what: str) -> list[str]:
    result = page.evaluate("tags => axe.run(document, tags)", TAGS_ONLY)
    return [f"{what}: {told(each)}" for each in result["violations"]]


# What brings the page into a state, and what it then has.
STATES = {
    "no limb": ("limb", "0", "[name=on-thigh]"),
    "streaming": ("probe", "0", ".numbers"),
    "refused": ("calibrate", "imud.view._guide.kind.value = 'tip'", ".guide"),
    "calibrating": ("calibrate", "imud.view._do('all')", "button:text('Cancel')"),
    "playing": (
        "signals",
        "imud.link.logs().then(([{ name }]) => imud.link.play(name, 1))",
        ".playbar:not([hidden])",
    ),
}


@pytest.mark.nightly
def test_no_state_has_what_axe_complains_of(browser: Browser, desk: Desk) -> None:
    found = []
    with seen(browser, desk, bypass_csp=True) as shown, Served() as alone:
        page = shown.page

        def look(name: str, element: str) -> None:
            page.locator(element).first.wait_for()
            found.extend(complaints(page, name))

        page.add_script_tag(path=str(AXE))
        for name, (view, act, element) in STATES.items():
            page.evaluate("view => { location.hash = `#/${view}`; }", view)
            shown.until("view => imud.viewName === view && imud.view !== null", view)
            page.evaluate(act)
            look(name, element)
        page.evaluate("imud.link.live()")
        page.evaluate("imud.link.calibrate(imud.model.selected, 'stop')")
        desk.hand.turn((1.0, 0.0, 0.0, 0.0), tilt_sigma=0.1, heading_sigma=0.1)
        page.evaluate("location.hash = '#/aim'")
        page.get_by_role("button", name="Aim", exact=True).click()
        look("aim green", '.reading [data-part="word"]:text-is("On target")')
        page.evaluate("location.hash = '#/limb'")
        for number in range(1, 100):
            desk.publish("imud/body/right-leg/state", json.dumps(leg(number)).encode())
            page.wait_for_timeout(15)
        look("limb", ".limb [data-plot]")
        desk.hand.state = "idle"
        look("idle", ".lead:has-text('is idle')")
        page.goto(alone.page.url)
        page.add_script_tag(path=str(AXE))
        look("no probe", ".lead:has-text('No probe yet')")
        shown.complaints.clear()
        shown.elsewhere.clear()
    assert not found, "\n".join(found)


@pytest.mark.long
@pytest.mark.parametrize("size", SIZES)
def test_no_view_has_what_axe_complains_of(
    browser: Browser, desk: Desk, size: str
) -> None:
    width, height = SIZES[size]
    viewport = {"width": width, "height": height}
    themes = ["light", "dark"]
    if not IS_LONG:
        themes = [themes[[*SIZES].index(size) % 2]]
    found = []
    # Without the page's policy, under which no other script can be put in.
    with seen(browser, desk, viewport=viewport, bypass_csp=True) as shown:
        page = shown.page
        page.add_script_tag(path=str(AXE))
        for view in VIEWS:
            page.evaluate("view => { location.hash = `#/${view}`; }", view)
            shown.until("view => imud.viewName === view && imud.view !== null", view)
            for theme in themes:
                page.evaluate(
                    "name => { document.documentElement.dataset.theme = name; }", theme
                )
                page.wait_for_timeout(300)
                found += complaints(page, f"{view}, {theme}")
        shown.complaints.clear()
    assert not found, "\n".join(found)
