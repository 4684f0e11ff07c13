# SPDX-License-Identifier: MIT
"""Each kind of calibration that the page offers, driven to its end in Chromium: once
well, once refused.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest
from playwright.sync_api import Browser
from playwright.sync_api import TimeoutError as PlaywrightTimeout

from benchmarks.calibration.simulated import samples
from fakes import PATIENCE_S
from imud.calibration.mounting import ASKED
from imud.calibration.recording import Sample
from imud.client import Client
from imud.params.value import Params
from imud.virtual.dimpling import Wobble
from imud.virtual.modules import calibrated
from length import choose
from raw_probe import calibrating, lying, waved
from web.desk import Desk, Seen, seen
from wobbled import CALIBRATED, wobbled

UP = np.array([0.0, 0.0, 1.0])
OVER = np.array([0.0, 0.0, -1.0])
PHASE = "imud.model.probe.calibration?.phase"
# Whether the ghost lies so that what should be up is: its third row of the matrix.
IS_GHOST_RIGHT = """() => {
  const [a, b, c] = imud.model.probe.calibration.wanted ?? [0, 0, 0];
  const [x, y, z, w] = imud.view._ghost._body.quaternion.toArray();
  const row = [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)];
  const up = row[0] * a + row[1] * b + row[2] * c;
  return imud.view._ghost.group.visible && up > 0.999;
}"""
SAYS = '[data-part="says"]'
REFUSED = "Refused. The previous calibration stays active."


def mounting() -> Sequence[Sample]:
    ups = [np.array(up, dtype=float) for up in ASKED]
    return samples(calibrated(), 3, ups)


# What the hand does for each kind, and what the result then says.
WELL: dict[str, tuple[Callable[[], Sequence[Sample]], str]] = {
    "all": (calibrating, "of the field are level"),
    "acc": (calibrating, "residual at the stops"),
    "gyro": (calibrating, "residual after a turn"),
    "mag": (waved, "of the field are level"),
    "mount": (mounting, "mounting"),
    "tip": (lambda: wobbled(Wobble(), 26.0), "mm from the sensor"),
    "verify": (lambda: lying([UP, OVER]), "gravity"),
}


@pytest.fixture(scope="module")
def shown(browser: Browser, desk: Desk) -> Iterator[Seen]:
    with Client(desk.daemon.endpoint) as client:
        name = client.wait_for(seconds=PATIENCE_S)
        client.change_params(name, CALIBRATED.encode())
    with seen(browser, desk, "calibrate") as found:
        yield found


def begin(shown: Seen, desk: Desk, kind: str, found: Sequence[Sample]) -> None:
    page = shown.page
    desk.hand.calibrate(found)
    shown.until("imud.model.probe.status.hello.raw_rate === 100")
    page.select_option("[aria-label='What to calibrate']", kind)
    page.get_by_role("button", name="Begin").click()
    shown.until(f"{PHASE} === 'running'")


def judged(shown: Seen, desk: Desk) -> str:
    """The phase in which it ends, judged once the hand has done all."""
    while (phase := shown.page.evaluate(PHASE)) == "running":
        button = shown.page.get_by_role("button", name="Finish now")
        if not desk.hand._samples and button.is_visible():
            with contextlib.suppress(PlaywrightTimeout):  # it has just ended
                button.click(timeout=500)
        shown.page.wait_for_timeout(200)
    return str(phase)


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "width"),
    choose(
        everyday=[("all", 820), ("tip", 390)],
        long=[*((kind, 1280) for kind in WELL), ("tip", 820), ("tip", 390)],
    ),
)
def test_each_kind_comes_to_a_good_end(
    shown: Seen, desk: Desk, kind: str, width: int
) -> None:
    shown.page.set_viewport_size({"width": width, "height": 800})
    made, words = WELL[kind]
    begin(shown, desk, kind, made())
    frames = shown.page.evaluate("imud.frames")
    if kind == "all":
        shown.until(IS_GHOST_RIGHT)
    assert judged(shown, desk) == "done"
    shown.until(f"imud.frames > {frames} + 3 && imud.view !== null")
    page = shown.page
    page.locator(".result").get_by_text(words).first.wait_for()
    if kind != "verify":
        page.get_by_text("not active yet").wait_for()
        page.get_by_role("button", name="Apply").click()
        page.get_by_text("The calibration is active").first.wait_for()
        assert desk.probe.params.records != CALIBRATED.encode()
        Params.decode(desk.probe.params.records)
    desk.hand.pick_up()
    if kind == "all":
        assert page.evaluate("imud.view._cover.covered") >= 12
        assert shown.number("cal-tilt") < 0.1
        step = page.locator('[data-part="last-step"]')
        desk.hand.turn((1, 0, 0, 0), pose_flags=("uncalibrated", "starting"))
        step.get_by_text("let go for 3 s").wait_for()
        desk.hand.turn((1, 0, 0, 0), pose_flags=(), tilt_sigma=0.4, heading_sigma=None)
        step.get_by_text("Nearly there").wait_for()
        desk.hand.turn((1, 0, 0, 0), pose_flags=(), tilt_sigma=0.4, heading_sigma=1.2)
        step.get_by_text(
            "Ready. As it lies now: tilt ±0.40°, heading ±1.20°"
        ).wait_for()
        page.get_by_role("link", name="See it move").click()
        shown.until("imud.viewName === 'probe'")
        page.evaluate("location.hash = '#/calibrate'")
        shown.until("imud.viewName === 'calibrate'")
    if kind != "verify":
        page.get_by_role("button", name="Undo", exact=True).click()
        page.get_by_text("The previous params are active again").first.wait_for()
        assert desk.probe.params.records == CALIBRATED.encode()
    page.locator(SAYS, has_text="Done").wait_for()


@pytest.mark.long
@pytest.mark.parametrize("goes_on", choose(everyday=[True], long=[True, False]))
def test_an_early_end_asks_for_the_missing_poses_once(
    shown: Seen, desk: Desk, goes_on: bool
) -> None:
    page, five = shown.page, calibrating(len(ASKED))
    begin(shown, desk, "all", five)
    shown.until("imud.model.probe.calibration.poses === 5")
    page.get_by_role("button", name="Finish now").click()
    asked = page.locator(".guide [role=alert]")
    asked.get_by_text("lay it on its left side").wait_for()
    assert page.evaluate(PHASE) == "running"
    page.locator(SAYS, has_text="Good (5 of 12)").wait_for()
    if goes_on:
        desk.hand.goes_on(calibrating()[len(five) :])
    assert judged(shown, desk) == ("done" if goes_on else "refused")
    if goes_on:
        page.get_by_role("button", name="Apply").wait_for()
    else:
        asked.get_by_text("lay it on its left side").wait_for()
        page.locator(SAYS, has_text=REFUSED).wait_for()
    desk.hand.pick_up()
    assert desk.probe.params.records == CALIBRATED.encode()


@pytest.mark.long
@pytest.mark.parametrize("kind", choose(everyday=["tip", "mag"], long=[*WELL]))
def test_each_kind_says_why_it_is_refused(shown: Seen, desk: Desk, kind: str) -> None:
    begin(shown, desk, kind, lying([UP]))
    phase = judged(shown, desk)
    page = shown.page
    if kind == "verify":
        # It has a verdict of each sensor: none was seen turned.
        assert phase in ("refused", "done")
        page.get_by_text("calibrate again").wait_for()
    else:
        assert phase == "refused"
        page.locator(SAYS, has_text=REFUSED).wait_for()
        assert len(page.locator(".guide [role=alert]").inner_text()) > 20
    desk.hand.pick_up()
    assert desk.probe.params.records == CALIBRATED.encode()
