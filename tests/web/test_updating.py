# SPDX-License-Identifier: MIT
"""New firmware from the page. The program that writes it is played here: the real one,
on a board in its emulator, is in tests/system/test_flash.py.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser

from imud.flash.firmware import Firmware
from imud.web import processes, updater
from imud.web.users import TokenHolder
from streaming import until
from web.served import Served

OFFERED = tuple(
    Firmware(
        file="x.hex",
        board=board,
        filter=chosen,
        version="0.3.0+1234567",
        schema="0" * 8,
        sha256="0" * 64,
        bytes=1,
    )
    for board, chosen in (
        ("nano", "mahony"),
        ("nano", "fuse"),
        ("f405", "all"),
        ("pico", "all"),
    )
)

# Takes the questions of `imud flash`, and prints its arguments. Its outcome is in the
# probe's name.
PROGRAM = """
import json, sys
def tell(**fields):
    print(json.dumps(fields), flush=True)
def ask(what, **fields):
    tell(ask=what, **fields)
    return json.loads(sys.stdin.readline())
print("firmware", ask("status")["value"]["hello"]["firmware"], flush=True)
print("params", ask("params")["value"], flush=True)
print("lend", ask("command", command="lend", parameters={"seconds": "300"}), flush=True)
print("fly", ask("command", command="fly")["error"], flush=True)
tell(share=0.25)
sys.stdin.readline() if sys.argv[1] == "waits" else None
tell(share=None)
if sys.argv[1] == "refused":
    tell(error="it is half written")
    sys.exit(1)
if sys.argv[1] == "dies":
    sys.exit(3)
print("filter", "fuse", flush=True)
"""


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    started: list[processes.Process] = []

    async def start(module: str, *arguments: str) -> processes.Process:
        assert (module, arguments[0], arguments[2]) == ("imud", "flash", "--for-page")
        words = (sys.executable, "-c", PROGRAM, arguments[1])
        pipe = asyncio.subprocess.PIPE
        found = await asyncio.create_subprocess_exec(*words, stdin=pipe, stdout=pipe)
        started.append(found)
        return found

    monkeypatch.setattr(updater.processes, "start", start)
    made = Served(firmware=OFFERED)
    with contextlib.closing(made.page):
        yield made
        for each in started:  # while it writes, the page would not end
            processes.kill(each)


def show(served: Served, probe: str, board: str = "nano", **hello: Any) -> None:
    """A daemon's messages about a probe."""
    hello = {"board": board, "firmware": "0.2.9+7654321", "filter": "fuse"} | hello
    status = {"type": "status", "probe": probe, "state": "streaming", "hello": hello}
    params = {"type": "params", "probe": probe, "bytes": ""}
    for line in (status, params):
        key = (probe, str(line["type"]))
        served.page.publish([(key, json.dumps(line).encode())])
    served.page.flush()


def last(served: Served, probe: str) -> dict[str, Any]:
    """How an update ended."""
    with served.live() as visitor:
        visitor.say(do="update", id=1, probe=probe)
        assert visitor.next("answer")["error"] == ""
        while (state := visitor.next("update"))["phase"] == "running":
            pass
    return state


def test_what_is_asked_is_answered_and_what_is_said_is_told(served: Served) -> None:
    show(served, "stylus")
    state = last(served, "stylus")
    assert (state["phase"], state["why"], state["share"]) == ("done", "", None)
    first, params, lent, fly, said = state["said"]
    assert first == "firmware 0.2.9+7654321"
    assert "'bytes': ''" in params
    assert "{'value': {'ok': True}}" in lent
    assert fly == "fly probes can't fly"
    assert said == "filter fuse"
    assert served.asked.all[0] == ("stylus", "lend", {"seconds": "300"})


@pytest.mark.parametrize(
    ("probe", "why"),
    [("refused", "it is half written"), ("dies", "it ended early")],
)
def test_why_it_was_not_updated_is_told(served: Served, probe: str, why: str) -> None:
    show(served, probe)
    state = last(served, probe)
    assert state["phase"] == "refused"
    assert why in state["why"]


def test_a_probe_is_updated_once_at_a_time(served: Served) -> None:
    show(served, "waits")
    with served.live() as visitor:
        visitor.say(do="update", id=1, probe="waits")
        while visitor.next("update")["share"] != 0.25:
            pass
        visitor.say(do="update", id=2, probe="waits")
        while (answer := visitor.next("answer"))["id"] != 2:
            pass
        assert answer["error"] == "this probe is being updated"


def test_firmware_is_for_who_may_command() -> None:
    for role, is_allowed in (("viewer", False), ("operator", True)):
        users = TokenHolder("viewer" if role == "viewer" else "operator")
        with Served(users, firmware=()) as served, served.live() as visitor:
            visitor.say(do="login", user="", secret=users.token)
            visitor.say(do="update", id=1, probe="nobody")
            why = "there is no probe nobody" if is_allowed else "may not update"
            assert why in visitor.next("answer")["error"]


def test_a_page_for_a_daemon_elsewhere_offers_none() -> None:
    with Served() as served, served.live() as visitor:
        assert visitor.next("page")["firmware"] == []
        visitor.say(do="update", id=1, probe="stylus")
        assert "may not update" in visitor.next("answer")["error"]


def test_the_page_offers_what_is_newer_and_writes_it(
    served: Served, browser: Browser
) -> None:
    show(served, "stylus")
    show(served, "newest", firmware="0.3.0+7654321")
    show(served, "other", filter="madgwick")  # of which there is no image
    show(served, "arm", board="f405")
    show(served, "drive", board="pico")
    page = browser.new_page()
    page.goto(f"{served.page.url}/#/probes")
    boxes = {
        name: page.locator(f"[data-probe={name}] [data-part=update]")
        for name in ("stylus", "newest", "other", "arm", "drive")
    }
    boxes["arm"].get_by_text("To update, run: imud flash arm").wait_for()
    assert not boxes["arm"].get_by_role("button").is_visible()
    boxes["drive"].get_by_role("button", name="Update firmware").wait_for()
    for name in ("newest", "other"):
        assert not boxes[name].is_visible()
    text = "Firmware 0.3.0+1234567 is there; the probe has 0.2.9+7654321."
    boxes["stylus"].get_by_text(text).wait_for()
    boxes["stylus"].get_by_role("button", name="Update firmware").click()
    boxes["stylus"].get_by_text("filter fuse").wait_for()
    show(served, "stylus", firmware="0.3.0+1234567")
    boxes["stylus"].get_by_text("The firmware is updated.").wait_for()
    until(lambda: not boxes["stylus"].get_by_role("button").is_visible())
    page.close()


def test_the_page_says_why_it_was_not_updated(served: Served, browser: Browser) -> None:
    show(served, "refused")
    page = browser.new_page()
    page.goto(f"{served.page.url}/#/probes")
    box = page.locator("[data-part=update]")
    box.get_by_role("button").click()
    box.get_by_text("The firmware was not updated: it is half written").wait_for()
    assert box.get_by_role("button").is_visible()  # once more
    page.close()
