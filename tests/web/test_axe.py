# SPDX-License-Identifier: MIT
"""Each view can be read by a screen reader and worked by keys, as far as axe-core can
tell: WCAG 2.1, levels A and AA, in both themes, on a screen and on a phone.
"""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import Browser

from demanded import leave_out
from imud.checkout import ROOT
from length import IS_LONG
from web.desk import Desk, seen

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
                result = page.evaluate("tags => axe.run(document, tags)", TAGS_ONLY)
                found += [
                    f"{view}, {theme}: {told(each)}" for each in result["violations"]
                ]
        shown.complaints.clear()
    assert not found, "\n".join(found)
