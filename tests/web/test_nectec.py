# SPDX-License-Identifier: MIT
"""The task of the NECTEC paper, section 7.3, from the page alone: calibrate a module as
it was bought, set the origin, enter an orientation, and bring the probe there until it
is green. The real image runs in its emulator, in a virtual hand that does what the page
asks; the page is worked by keyboard, and by touch on a phone.
"""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from fakes import PATIENCE_S, DaemonProcess, Forked, free_address
from streaming import until
from web.test_tasks import SIZES

PHASE = "imud.model.probe?.calibration?.phase"
FLAGS = "imud.model.probe.pose.flags"

pytestmark = pytest.mark.nightly


@contextlib.contextmanager
def probe_in_a_hand(folder: Path, hand: str) -> Iterator[str]:
    """The address of the page that shows it."""
    host, port = free_address()
    link = folder / "nano"
    words = ["sim", "nano", "--module", "shop", "--hand", hand, "--stream"]
    words += ["--page", f"http://{host}:{port}", "--link", str(link), "--seed", "3"]
    with Forked("-m", "imud", *words, stderr=subprocess.DEVNULL) as board:
        try:
            until(link.exists)
            options = (link, "--page", f"{host}:{port}")
            with DaemonProcess(*options, directory=folder, page=None) as daemon:
                daemon.expect("the page is at")
                yield f"http://{host}:{port}/"
                daemon.stop()
        finally:
            board.terminate()


class User:
    """Works the page, by keyboard or by touch."""

    def __init__(self, page: Page, *, is_touching: bool) -> None:
        self.page = page
        self._is_touching = is_touching

    def press(self, key: str, name: str) -> None:
        """A key, or the button of that name."""
        # The view's own: the card above it may have the same.
        button = self.page.get_by_role("button", name=name, exact=True).last
        if self._is_touching:
            button.tap()
        else:
            self.page.keyboard.press(key)

    def view(self, key: str, name: str) -> None:
        link = self.page.get_by_role("link", name=name, exact=True)
        if self._is_touching:
            link.tap()
        else:
            self.page.keyboard.press(key)
        self.until(f"document.title.startsWith('{name}')")

    def enter(self, name: str, value: str) -> None:
        self.page.locator(f"[name={name}]").focus()
        self.page.keyboard.press("Control+a")
        self.page.keyboard.type(value)

    def leave(self) -> None:
        """Leaves the fields: keys are the page's again."""
        self.page.evaluate("document.activeElement.blur()")

    def until(self, is_so: str) -> None:
        while not self.page.evaluate(is_so):
            self.page.wait_for_timeout(100)


@contextlib.contextmanager
def user(browser: Browser, url: str, width: int = 1280) -> Iterator[User]:
    """By touch on a phone and on a tablet."""
    is_touching = width < 1280
    size = {"width": width, "height": SIZES[width]}
    context = browser.new_context(viewport=size, has_touch=is_touching)
    try:
        page = context.new_page()
        page.goto(url)
        found = User(page, is_touching=is_touching)
        found.until("Boolean(globalThis.imud?.model.probe?.pose)")
        yield found
    finally:
        context.close()


@pytest.mark.parametrize("width", SIZES)
def test_from_a_shop_module_to_green(
    browser: Browser, tmp_path: Path, width: int
) -> None:
    with (
        probe_in_a_hand(tmp_path, "follow") as url,
        user(browser, url, width) as hand,
    ):
        page = hand.page
        hand.view("3", "Calibrate")
        hand.press("b", "Begin")
        hand.until(f"{PHASE} === 'done'")
        hand.press("y", "Apply")
        hand.until(
            "document.querySelector('[data-part=last-step]').textContent.startsWith('Ready')"
        )

        hand.view("1", "Probe")
        hand.press("o", "Set origin")
        hand.until(f"{FLAGS}.includes('tared')")

        hand.view("4", "Aim")
        page.select_option("[name=axis]", "all")
        hand.enter("yaw", "20")
        hand.enter("pitch", "15")
        hand.leave()
        hand.press("a", "Aim")
        hand.until("document.querySelector('.aim').dataset.state === 'reached'")
        page.locator('[data-part="word"]').get_by_text("Reached").wait_for(
            timeout=1000 * PATIENCE_S
        )
        told = page.locator('.reading [data-part="sigma"]').inner_text()
        assert "since the origin" in told


def test_beside_iron_it_is_refused_with_the_reason(
    browser: Browser, tmp_path: Path
) -> None:
    with (
        probe_in_a_hand(tmp_path, "follow-iron") as url,
        user(browser, url) as hand,
    ):
        hand.view("3", "Calibrate")
        hand.press("b", "Begin")
        trouble = "imud.model.probe?.calibration?.trouble"
        hand.until(f"{PHASE} === 'refused' || {trouble}?.includes('iron')")
        # A user who continues despite that is refused.
        while hand.page.evaluate(PHASE) == "running":
            hand.press("e", "Finish now")
            hand.page.wait_for_timeout(1000)
        assert hand.page.evaluate(PHASE) == "refused"
        why = hand.page.locator(".guide [role=alert]").inner_text()
        assert "iron" in why
