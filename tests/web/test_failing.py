# SPDX-License-Identifier: MIT
"""A view of the page that fails takes nothing else with it, and says that it did."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from web.desk import Desk, Seen

REASON = "a value that no view expects"
VIEWS = ("signals", "calibrate", "aim", "probes", "limb", "probe")


def show(shown: Seen, view: str) -> None:
    shown.page.evaluate("name => { location.hash = `#/${name}`; }", view)
    shown.until("name => imud.viewName === name && imud.view !== null", view)


def break_view(shown: Seen, method: str) -> None:
    """Has a method of the view that is shown throw from now on."""
    shown.page.evaluate(
        "([name, why]) => { imud.view[name] = () => { throw new Error(why); }; }",
        [method, REASON],
    )


def test_a_view_that_throws_says_so_and_all_others_go_on(
    shown: Seen, desk: Desk, tmp_path: Path
) -> None:
    page = shown.page
    for name in VIEWS:
        show(shown, name)
        break_view(shown, "draw")
        failed = page.locator("[data-part=failed]")
        failed.get_by_text("has failed").wait_for()
        assert REASON in failed.locator("pre").inner_text()
        before = shown.page.evaluate("imud.frames")
        shown.until(f"imud.frames > {before} + 3")
    with page.expect_download() as saving:
        page.get_by_role("button", name="Save a report").click()
    path = tmp_path / "report"
    saving.value.save_as(path)
    report = path.read_text()
    assert REASON in report
    assert "view Probe" in report
    assert "Chrom" in report
    page.get_by_role("button", name="Open it again").click()
    desk.hand.turn((0.0, 1.0, 0.0, 0.0))
    shown.until("imud.view?.scene && imud.model.probe.pose.q[1] === 1")
    assert len(shown.complaints) == len(VIEWS)
    assert all(REASON in each for each in shown.complaints)
    shown.complaints.clear()


def test_a_view_that_can_not_be_left_is_left(shown: Seen) -> None:
    show(shown, "calibrate")
    break_view(shown, "close")
    show(shown, "aim")
    failed = shown.page.locator("[data-part=failed]")
    assert not failed.is_visible()
    assert REASON in shown.complaints.pop()


@pytest.mark.nightly
def test_a_daemon_that_is_slow_to_connect_is_waited_for(
    shown: Seen, desk: Desk
) -> None:
    """After 3 s of silence the page connects again, which then takes 4 s: complaints of
    a connection that was given up would fail the test.
    """
    desk.daemon.process.send_signal(signal.SIGSTOP)
    try:
        shown.page.wait_for_timeout(7000)
    finally:
        desk.daemon.process.send_signal(signal.SIGCONT)
    shown.page.wait_for_selector('.link[data-state="open"]')
    shown.until("!globalThis.imud.model.probe.isStale(performance.now())")
