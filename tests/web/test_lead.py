# SPDX-License-Identifier: MIT
"""The card above each view: what is missing with its button, and the steps of a new
probe.
"""

from __future__ import annotations

import json
from typing import Any

from playwright.sync_api import Browser, Locator, Page

from imud.web.users import TokenHolder
from streaming import until
from web.served import Served
from web.test_ports import Ports

POSE = {"number": 1, "flags": [], "tilt_sigma_deg": 0.1, "heading_sigma_deg": 1.0}
NO_PARAMS = {"is_known": True, "acc": {"is_calibrated": False}}
CALIBRATED = {name: {"is_calibrated": True} for name in ("acc", "gyr")}

LEVEL = {"q": (1, 0, 0, 0)}
NEEDS = {
    "calibrating": "lay it still",
    "gone": "plug it in again",
    "silent": "check its cable",
    "fault": "under Probes",
    "other schema": "update it",
}


def say(served: Served, topic: str, **fields: Any) -> None:
    line = {"type": topic, "probe": "stylus"} | fields
    served.page.publish([(("stylus", topic), json.dumps(line).encode())])
    served.page.flush()


def lead(page: Page) -> Locator:
    return page.locator(".lead")


def test_without_a_probe_each_view_has_what_there_is_to_do(browser: Browser) -> None:
    ports = Ports()
    with Served(ports=ports, virtual=("imud", "sim", "no-such-board")) as served:
        page = browser.new_page()
        for view in ("limb", "aim", "probe"):
            page.goto(f"{served.page.url}/#/{view}")
            lead(page).get_by_text("No probe yet").wait_for()
        lead(page).get_by_role("button", name="Adopt /dev/ttyUSB0").click()
        until(lambda: ports.ours == {"/dev/ttyUSB0"})
        lead(page).get_by_role("button", name="Try a virtual probe").click()
        page.get_by_text("there is no 'no-such-board'").wait_for()
        page.close()


def test_who_may_not_command_has_no_buttons(browser: Browser) -> None:
    users = TokenHolder("viewer")
    with Served(users, ports=Ports(), virtual=("imud", "--version")) as served:
        page = browser.new_page()
        page.goto(f"{served.page.url}/#token={users.token}")
        lead(page).get_by_text("where imud runs").wait_for()
        assert lead(page).get_by_role("button").count() == 0
        with served.live() as viewer:
            viewer.say(do="login", user="", secret=users.token)
            assert viewer.next("page")["virtual"] == ""
            viewer.say(do="virtual", id=1, on=True)
            assert "may not start" in viewer.next("answer")["error"]
        page.close()


def test_each_state_of_a_probe_says_what_it_needs(
    browser: Browser, served: Served
) -> None:
    page = browser.new_page()
    page.goto(f"{served.page.url}/#/signals")
    for state, words in NEEDS.items():
        say(served, "status", state=state)
        lead(page).get_by_text(words).wait_for()
    page.close()


def test_a_new_probe_is_led_until_all_is_done(browser: Browser, served: Served) -> None:
    def now(params: Any, **pose: Any) -> None:
        say(served, "status", state="streaming", params=NO_PARAMS | params)
        say(served, "pose", **POSE | pose)

    page = browser.new_page()
    page.goto(f"{served.page.url}/#/probe")
    say(served, "status", state="idle", params=NO_PARAMS)
    lead(page).get_by_role("button", name="Start").click()
    until(lambda: served.asked.all == [("stylus", "start", {})])
    now({}, q=(1, 0, 0, 0))
    lead(page).get_by_text("Turn it in your hand").wait_for()
    now({}, q=(0.98, 0.2, 0, 0))
    lead(page).get_by_role("button", name="Calibrate").click()
    page.wait_for_selector(".calibrate.view")
    now(CALIBRATED, q=(1, 0, 0, 0))
    lead(page).get_by_role("button", name="Set origin").click()
    until(lambda: ("stylus", "tare", {"what": "all"}) in served.asked.all)
    now(CALIBRATED, q=(1, 0, 0, 0), flags=["tared"])
    lead(page).get_by_text("until it is green").wait_for()
    page.reload()  # what is done stays so
    lead(page).get_by_text("until it is green").wait_for()
    assert page.locator(".steps [data-done]").count() == 3
    lead(page).get_by_role("button", name="Hide").click()
    lead(page).wait_for(state="hidden")
    page.close()


def test_errors_are_explained_and_only_what_is_unusual_is_in_front(
    browser: Browser, served: Served
) -> None:
    page = browser.new_page()
    page.goto(f"{served.page.url}/#/probe")
    acc = {"sigma_m_s2": 0.0142, "condition": "other temperature"}
    params = {"acc": acc, "mag": {"sigma_uT": 0.31}}
    about = {"state": "streaming", "pose_rate_hz": 99.0, "hello": {"pose_rate": 100}}
    say(served, "status", params=params, ledger={"lost": 0, "sent": 9}, **about)
    say(served, "pose", **POSE | {"flags": ["uncalibrated", "mag_disturbed"]}, **LEVEL)
    made = page.locator(".numbers [data-part=accuracy]")
    made.locator("summary").click()
    for words in (
        *("tilt ±0.12°, field ±0.3 µT", "bias not measured", "lay it still for 3 s"),
        *("disturbed", "move away from iron", "other temperature"),
    ):
        made.get_by_text(words).first.wait_for()
    front = page.locator(".numbers > .quantities [data-value]:visible")
    keys = "all => all.map(one => one.dataset.value)"
    assert front.evaluate_all(keys) == ["yaw", "pitch", "roll"]
    say(served, "status", params=params, ledger={"lost": 1, "sent": 9}, **about)
    say(served, "pose", **POSE | {"age_us": 400e3}, **LEVEL)
    until(lambda: {*front.evaluate_all(keys)[3:]} == {"lost", "age"})
    slow = about | {"pose_rate_hz": 61.0}
    say(served, "status", params=params, ledger={"lost": 0, "sent": 9}, **slow)
    say(served, "pose", **POSE, **LEVEL)
    until(lambda: front.evaluate_all(keys)[3:] == ["rate"])
    page.close()


def test_aim_refuses_what_it_would_have_to_change(
    browser: Browser, served: Served
) -> None:
    page = browser.new_page()
    page.goto(f"{served.page.url}/#/aim")
    say(served, "status", state="streaming", params=CALIBRATED)
    say(served, "pose", **POSE, **LEVEL)
    aim = page.get_by_role("button", name="Aim", exact=True)
    targets = page.locator(".targets .target")
    for name, wrong, right in (
        *(("tolerance", "0", "2"), ("hold", "-1", "2")),
        *(("pitch", "91", "80"), ("yaw", "361", "-360")),
    ):
        page.fill(f"[name={name}]", wrong)
        aim.click()
        assert targets.count() == 0, name
        page.fill(f"[name={name}]", right)
    for wrong, words in (
        *(("tolerance_deg\n1,2,3,0", "tolerance_deg has"), ("name\n1,91,3,a", "pitch")),
        ("hold_s\n1,2,3,-1", "hold_s has"),
    ):
        file = ("t.csv", "text/csv", f"yaw,pitch,roll,{wrong}".encode())
        names = ("name", "mimeType", "buffer")
        page.set_input_files("input[type=file]", [dict(zip(names, file, strict=True))])
        page.locator(".toast.bad", has_text=words).wait_for()
        assert targets.count() == 0, wrong
    aim.click()
    assert targets.count() == 1
    page.locator(".card", has=targets).get_by_role("button", name="Clear").click()
    assert targets.count() == 0
    page.locator("form").get_by_role("button", name="Set origin").click()
    until(lambda: ("stylus", "tare", {"what": "all"}) in served.asked.all)
    page.close()
