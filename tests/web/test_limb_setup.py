# SPDX-License-Identifier: MIT
"""A limb that a user of the page sets up: probes chosen for its segments, saved, run by
`imud body`, and aligned; with virtual probes on a virtual leg.
"""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import pytest
from playwright.sync_api import Browser, Page

from fakes import PATIENCE_S, free_endpoint
from host.cli.test_body import pose_of
from imud.body import chain
from imud.config.settings import ZenohSettings
from imud.errors import ConfigError, ImudError
from imud.net import network
from imud.net.access import BODIES, BODY_STATE
from imud.virtual import leg
from imud.virtual.leg_probes import RATE_HZ
from imud.web.bodies import line_of
from imud.web.limbs import Limbs, Setup, text_of
from imud.web.messages import decode
from imud.web.users import TokenHolder
from streaming import until
from web.served import Served
from web.test_page import FITS

IDS = {name: f"00000000000000a{n}" for n, name in enumerate(leg.SEGMENTS)}
LEG = Setup("right", dict(IDS))
WIDTHS = (1280, 820, 390)
POSE_HZ = 50


class Leg(threading.Thread):
    """A network with the poses of three probes on a leg that stands until it is told to
    move, and then stands again.
    """

    def __init__(self) -> None:
        super().__init__()
        self.endpoint = free_endpoint()
        settings = ZenohSettings(listen=(self.endpoint,))
        self.session = network.open_daemon(settings, network.new_id())
        self.moves, self._ends = threading.Event(), threading.Event()
        self._made = leg.made(1, leg.Manner(walk_s=2.0, squats=1, raises=1))
        self.start()

    def run(self) -> None:
        begin, end = (self._made.stages[name][0] for name in ("squat", "walk"))
        moved_s, number = 0.0, 0
        while not self._ends.wait(1 / POSE_HZ):
            number += 1
            if self.moves.is_set():
                moved_s = moved_s or time.monotonic()
                at_s = min(begin + time.monotonic() - moved_s, end - 0.1)
            else:
                at_s = begin - 0.1
            for name, motion in self._made.motions.items():
                q = motion.quat[round(at_s * RATE_HZ)].tolist()
                attached = f"{IDS[name]} {name}"
                payload = pose_of(name, number, q=q)
                self.session.put(f"imud/{name}/pose", payload, attachment=attached)

    def close(self) -> None:
        self._ends.set()
        self.join()
        self.session.close()


@pytest.fixture(scope="module")
def worn() -> Iterator[Leg]:
    made = Leg()
    yield made
    made.close()


@pytest.fixture
def served(worn: Leg, tmp_path: Path) -> Iterator[Served]:
    def hear(sample: Any) -> None:
        line = line_of(str(sample.key_expr), sample.payload.to_bytes())
        assert line is not None
        found.page.publish([line])
        found.page.flush()

    limbs = (tmp_path / "limbs", lambda: ("--connect", worn.endpoint))
    with Served(limbs=limbs) as found:
        key = f"imud/{BODIES}/*/{BODY_STATE}"
        heard = worn.session.declare_subscriber(key, hear)
        for name, probe_id in IDS.items():
            say_status(found, name, probe_id)
        yield found
        heard.undeclare()


def say_status(served: Served, name: str, probe_id: str) -> None:
    line = {"type": "status", "probe": name, "probe_id": probe_id, "state": "idle"}
    served.page.publish([((name, "status"), json.dumps(line).encode())])
    served.page.flush()


def fits(page: Page) -> None:
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 800})
        page.wait_for_timeout(50)  # the page draws
        assert page.evaluate(FITS, False), width
    page.set_viewport_size({"width": WIDTHS[0], "height": 800})


def choose(page: Page, **probes: str) -> None:
    for segment, probe in probes.items():
        page.locator(f"[name=on-{segment}]").select_option(label=probe)


def test_a_limb_is_set_up_and_aligned_by_clicks_alone(
    browser: Browser, served: Served, worn: Leg, tmp_path: Path
) -> None:
    page = browser.new_page()
    page.set_default_timeout(1000 * PATIENCE_S)
    page.goto(f"{served.page.url}/#/limb")
    page.get_by_text("choose which sits where").wait_for()
    start = page.get_by_role("button", name="Save and start")
    choose(page, thigh="thigh", foot="foot")
    start.click()
    page.locator(".toast.bad", has_text="neighbours of: thigh, shank").wait_for()
    assert not (tmp_path / "limbs").exists()
    fits(page)
    choose(page, thigh="thigh", shank="shank", foot="foot")
    start.click()
    says = page.locator("[data-part=says]")
    says.get_by_text("stand straight").wait_for()
    angle = page.locator('[data-angle="shank flexion"]')
    angle.get_by_text("not aligned yet").wait_for()
    bar = "one => one.value"
    standing = page.get_by_label("Time of standing still")
    until(lambda: standing.evaluate(bar) > 0)
    fits(page)
    says.get_by_text("bend every joint").wait_for()
    assert page.locator("[data-part=bends]").inner_text() == "bends: knee 0, ankle 0"
    worn.moves.set()
    page.get_by_text("bends: knee 2").wait_for()
    until(lambda: standing.evaluate(bar) > 0)
    page.get_by_text("Aligned by motion").wait_for()
    assert "°" in angle.inner_text()
    # Its probes by their names.
    assert page.locator('[data-segment="shank"]').inner_text().startswith("shank shank")
    fits(page)
    page.get_by_role("button", name="End", exact=True).click()
    # What is saved is asked about before it is replaced.
    page.get_by_label("Saved limbs").select_option("right-leg")
    until(lambda: page.locator("[name=on-foot]").input_value() == IDS["foot"])
    choose(page, foot="no probe")
    start.click()
    page.get_by_role("button", name="Cancel").click()
    saved = tmp_path / "limbs" / "right-leg.toml"
    assert IDS["foot"] in saved.read_text()
    start.click()
    page.get_by_role("button", name="Replace").click()
    page.get_by_text("right-leg runs").wait_for()
    assert IDS["foot"] not in saved.read_text()
    page.close()


def test_who_may_not_command_sets_up_no_limb(tmp_path: Path) -> None:
    users, limbs = TokenHolder("viewer"), (tmp_path, lambda: ("--connect", "x"))
    with Served(users, limbs=limbs) as served, served.live() as viewer:
        viewer.say(do="login", user="", secret=users.token)
        while not (about := viewer.next("page"))["role"]:
            pass
        assert about["limbs"] is None
        for number, what in enumerate(("limbs", "limb")):
            name = {"name": None} if what == "limb" else {}
            viewer.say(do=what, id=number, **name)
            assert "may not set up limbs" in viewer.next("answer")["error"]


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".x", "a b", "x" * 65, 'a"'])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    setup = {"side": "right", "probes": IDS}
    message = {"do": "limb", "id": 1, "name": name, "setup": setup}
    with pytest.raises(msgspec.ValidationError):
        decode(json.dumps(message))


def test_a_saved_limb_is_a_file_for_imud_body(tmp_path: Path) -> None:
    arm = Setup("left", {"forearm": IDS["foot"], "upper-arm": IDS["thigh"]})
    for name, setup in (("right-leg", LEG), ("arm", arm)):
        read = chain.read(text_of(name, setup), name)
        assert (read.name, read.side) == (name, setup.side)
        assert {each.name: each.probe for each in read.segments} == setup.probes
    limbs = Limbs(tmp_path, lambda: (), lambda: None)
    limbs.save("arm", arm, replace=False)
    with pytest.raises(ImudError, match="saved already"):
        limbs.save("arm", LEG, replace=False)
    limbs.save("arm", LEG, replace=True)
    (tmp_path / "bad.toml").write_text("no limb")
    assert [(each["name"], each["probes"]) for each in limbs.saved()] == [("arm", IDS)]
    assert sorted(each.name for each in tmp_path.iterdir()) == ["arm.toml", "bad.toml"]


@pytest.mark.parametrize(
    "probes",
    [
        {"thigh": IDS["thigh"]},
        {"thigh": IDS["thigh"], "foot": IDS["foot"]},
        {"thigh": IDS["thigh"], "upper-arm": IDS["foot"]},
        {"thigh": IDS["thigh"], "shank": IDS["thigh"]},
    ],
)
def test_what_is_no_limb_is_refused_before_it_is_saved(probes: Any) -> None:
    with pytest.raises(ImudError):
        text_of("leg", Setup("right", probes))


def test_of_two_who_start_a_limb_one_at_a_time_runs(worn: Leg, tmp_path: Path) -> None:
    limbs = Limbs(tmp_path, lambda: ("--connect", worn.endpoint), lambda: None)

    async def start() -> None:
        names = ("one", "two", "three")
        for name in names:
            limbs.save(name, LEG, replace=False)
        runs = [limbs.run(name) for name in names]
        found = await asyncio.gather(*runs, return_exceptions=True)
        started = [name for name, error in zip(names, found, strict=True) if not error]
        assert started == [limbs.running]
        await limbs.end()
        assert (limbs.running, limbs._task) == ("", None)

    with ThreadPoolExecutor(1) as thread:  # Playwright has this one's loop
        thread.submit(asyncio.run, start()).result()


def test_a_limb_that_can_not_run_tells_why(tmp_path: Path) -> None:
    def no_keys() -> tuple[str, ...]:
        raise ConfigError("create it with imud keys add")

    with Served(limbs=(tmp_path, no_keys)) as served, served.live() as browser:
        setup = {"side": "right", "probes": IDS}
        browser.say(do="limb", id=1, name="leg", setup=setup)
        assert browser.next("answer")["error"] == "create it with imud keys add"
    find = ("--connect", "tcp/127.0.0.1:1")
    with Served(limbs=(tmp_path, lambda: find)) as served, served.live() as browser:
        browser.say(do="limb", id=1, name="leg")
        assert "no imud at" in browser.next("answer")["error"]
