# SPDX-License-Identifier: MIT
"""Tasks of a person at a bedside, by clicks alone, at the widths of a desk, a tablet
and a phone. Others: calibration to green in test_nectec.py, the tip in test_guides.py,
a limb in test_limb_setup.py.
"""

from __future__ import annotations

import csv
import io
import zipfile
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from fakes import PATIENCE_S, DaemonProcess
from web.desk import Desk, seen
from web.test_button import press
from web.test_page import downloaded

SIZES = {1280: 800, 820: 1180, 390: 844}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("width", SIZES)
def test_a_press_marks_a_moment_in_signals_and_in_a_table(
    browser: Browser, desk: Desk, width: int
) -> None:
    viewport = {"width": width, "height": SIZES[width]}
    with seen(browser, desk, viewport=viewport) as shown:
        page = shown.page
        page.get_by_text("Button", exact=True).click()
        page.get_by_label("Click", exact=True).select_option(label="mark")
        page.get_by_role("button", name="Apply").first.click()
        page.get_by_text("imud acts on its button").wait_for()
        before = page.locator(".marks li").count()
        press(desk, 100_000)
        shown.until(
            "count => document.querySelectorAll('.marks li').length > count", before
        )
        page.get_by_role("button", name="Show the moment").first.click()
        shown.until("imud.viewName === 'signals' && imud.view && !imud.view._isLive")
        page.get_by_role("link", name="Probes").click()
        with zipfile.ZipFile(downloaded(page, "CSV")) as tables:
            (marks,) = (name for name in tables.namelist() if "-mark" in name)
            rows = csv.DictReader(io.StringIO(tables.read(marks).decode()))
            assert [*rows][-1]["text"] == "by its button"


@pytest.mark.nightly
@pytest.mark.parametrize("width", SIZES)
def test_without_hardware_a_virtual_probe_moves_after_one_click(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with DaemonProcess(directory=tmp_path, page=True) as daemon:
        page = browser.new_page(viewport={"width": width, "height": SIZES[width]})
        page.set_default_timeout(1000 * PATIENCE_S)
        page.goto(daemon.expect("the page is at").split()[-1])
        page.get_by_role("button", name="Try a virtual probe").click()
        page.locator(".lead li[data-done]", has_text="See it move").wait_for()
        page.get_by_role("button", name="End the virtual probe").click()
        page.get_by_text("is unplugged").wait_for()
        page.get_by_role("button", name="Try a virtual probe").click()
        page.get_by_role("button", name="End the virtual probe").wait_for()
        page.close()
        daemon.stop()
