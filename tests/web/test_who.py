# SPDX-License-Identifier: MIT
"""Pages tell whose command it was, where it was not their own."""

from __future__ import annotations

import json
import queue

import jsonschema
from playwright.sync_api import Browser

from imud.client import Client
from imud.log.schemas import JSON_SCHEMAS
from web.desk import Desk, Seen, seen


def test_a_command_is_told_with_who_gave_it(
    browser: Browser, shown: Seen, desk: Desk
) -> None:
    heard: queue.Queue[bytes] = queue.Queue()
    with seen(browser, desk) as other, Client(desk.daemon.endpoint) as client:
        client.subscribe("command", None, lambda _, payload: heard.put(payload))
        client.statuses()  # then the daemon knows the subscriber
        who = shown.page.evaluate("imud.model.page.who")
        shown.page.get_by_role("button", name="Stop", exact=True).click()
        shown.page.get_by_text("Stop: done").wait_for()
        other.page.get_by_text(f"nano-66aa: stopped, by {who}").wait_for()
        told = json.loads(heard.get())
        jsonschema.validate(told, JSON_SCHEMAS["command"])
        assert (told["command"], told["by"]) == ("stop", who)
        assert shown.page.get_by_text("stopped, by").count() == 0  # it knows

        client.command(desk.probe.name, "tare", what="heading")
        for each in (shown, other):
            each.page.get_by_text("its origin was set or undone, by network").wait_for()
        told = json.loads(heard.get())
        assert told["parameters"] == {"what": "heading"}

        # What changes nothing for others is not told, nor what was refused.
        client.command(desk.probe.name, "mark", value="1")
        client.command(desk.probe.name, "start")
        assert json.loads(heard.get())["command"] == "start"
