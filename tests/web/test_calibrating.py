# SPDX-License-Identifier: MIT
"""Calibrating through the page's server, without a browser."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import threading
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec
import numpy as np
import pytest
from playwright.sync_api import Browser

from benchmarks.calibration.simulated import samples as samples_of
from imud.calibration.mount import ModuleMount, named
from imud.calibration.mounting import ASKED, of_calibration
from imud.calibration.recording import Sample
from imud.params.value import Params
from imud.virtual.calibrating import SCALE
from imud.virtual.modules import calibrated
from imud.web import calibrator, guide
from imud.web.calibrator import End, Task
from imud.web.users import TokenHolder
from raw_probe import calibrating
from streaming import until
from web.served import Live, Served

PROBE = "stylus"
HELLO = {
    "sample_rate": 100,
    "raw_rate": 0,
    "acc_lsb": SCALE.acc_m_s2,
    "gyr_lsb": SCALE.gyr_rad_s,
    "mag_lsb": SCALE.mag_ut,
    "sensor": "mpu9250",
    "who_am_i": (0x71, 0x48),
}


def payload(sample: Sample) -> bytes:
    return json.dumps(
        {
            "type": "raw",
            "probe": PROBE,
            "t_device_us": sample.t_us,
            "acc_counts": sample.acc,
            "gyr_counts": sample.gyr,
            "mag_counts": sample.mag,
            "temperature_c": 24.5,
            "flags": [],
        }
    ).encode()


def states(
    kind: str,
    samples: Sequence[Sample],
    params: Params | None = None,
    *,
    ends: int,
) -> list[dict[str, Any]]:
    """What a calibrator says of these samples, and if it is then ended so often."""
    known = params.encode().hex() if params is not None else ""
    task = Task(PROBE, kind, SCALE, True, known, "")  # type: ignore[arg-type] # a Kind
    lines = [calibrator._encode(task), *map(payload, samples)]
    lines += [calibrator._encode(End())] * ends
    out = io.BytesIO()
    calibrator.run(io.BytesIO(b"\n".join(lines) + b"\n"), out)
    return [json.loads(line) for line in out.getvalue().splitlines()]


def test_a_restart_of_the_probe_is_refused() -> None:
    found = calibrating()
    *_, last = states("acc", [*found[:500], *found[:5]], ends=0)
    assert (last["phase"], last["why"]) == (
        "refused",
        "the probe restarted; start again",
    )


def test_a_mounting_is_found_told_and_shown(browser: Browser) -> None:
    turned = named("back,left")
    samples = [turned_over(each, turned) for each in mounting_poses()]
    *_, last = states("mount", samples, ends=0)
    assert last["phase"] == "done"
    assert last["outcome"]["mount"]["words"] == turned.words
    params = Params.decode(bytes.fromhex(last["outcome"]["records"]))
    assert of_calibration(params.gyr) == turned
    with Served() as served:
        lines = {
            "status": {"hello": HELLO},
            "params": {"digest": "0", "bytes": ""},
            "calibration": last | {"before": "", "before_digest": "0"},
        }
        for topic, line in lines.items():
            line = {"type": topic, "probe": PROBE} | line
            served.page.publish([((PROBE, topic), json.dumps(line).encode())])
        page = browser.new_page()
        page.goto(f"{served.page.url}/#/calibrate/{PROBE}")
        card = page.locator("[data-part=mount]")
        card.get_by_text("The module lies upside down").wait_for()
        assert card.locator("svg line").count() == 2
        page.close()


def mounting_poses() -> list[Sample]:
    ups = [np.array(up, dtype=float) for up in ASKED]
    return samples_of(calibrated(), 3, ups)


def turned_over(sample: Sample, mount: ModuleMount) -> Sample:
    """As a module that is mounted so reads it."""
    return ModuleMount(mount.turn.T).sample(sample)


@contextlib.contextmanager
def known(served: Served, **about: Any) -> Iterator[Live]:
    """A browser of a server that knows a probe, by that status of it."""
    params = {"type": "params", "probe": PROBE, "digest": "0", "bytes": ""}
    status = {"type": "status", "probe": PROBE, "hello": HELLO} | about
    for record in (params, status):
        served.page.publish([((PROBE, record["type"]), json.dumps(record).encode())])
    with served.live() as browser:
        yield browser


@pytest.fixture(autouse=True)
def heard_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guide, "HEARD_S", 0.1)


def calibration(browser: Live, phase: str) -> dict[str, Any]:
    while True:
        record = browser.next("calibration")
        if record["phase"] == phase:
            return record


class Sending(threading.Thread):
    """Sends a second of the first pose again and again: no calibration ends by that."""

    def __init__(self, served: Served) -> None:
        super().__init__(daemon=True)
        self._served = served
        self._is_over = threading.Event()

    def run(self) -> None:
        first = calibrating()[:100]
        for second in itertools.count():
            for sample in first:
                at_us = sample.t_us + second * 1_000_000
                later = msgspec.structs.replace(sample, t_us=at_us)
                self._served.page.publish([((PROBE, "raw"), payload(later))])
            self._served.page.flush()
            if self._is_over.wait(0.02):  # fifty bursts a second
                return

    def stop(self) -> None:
        self._is_over.set()
        self.join()


def test_a_probe_sends_raw_samples_only_while_it_is_calibrated(served: Served) -> None:
    with known(served) as browser:
        browser.say(do="calibrate", id=1, probe=PROBE, kind="all")
        calibration(browser, "preparing")
        browser.say(do="calibrate", id=2, probe=PROBE, kind="acc")
        while (answer := browser.next("answer"))["id"] != 2:
            pass
        assert answer["error"] == "this probe is already being calibrated"
        until(lambda: len(served.asked.all) == 3)
        sending = Sending(served)
        sending.start()
        while (record := calibration(browser, "running"))["poses"] == 0:
            pass
        assert record["of"] == 12
        browser.say(do="calibrate", id=3, probe=PROBE, kind="stop")
        calibration(browser, "none")
        sending.stop()
        assert [(command, given) for _, command, given in served.asked.all] == [
            ("rate", {"stream": "raw", "hz": "100"}),
            *(("fields", {"streams": "pose,raw"}), ("start", {})),
            *(("stop", {}), ("fields", {"streams": "pose"})),
            ("rate", {"stream": "raw", "hz": "0"}),
        ]


def test_what_needs_a_calibrated_probe_is_refused_at_once_with_the_way(
    browser: Browser, served: Served
) -> None:
    with known(served, params={"acc": {"is_calibrated": False}}):
        page = browser.new_page()
        page.goto(f"{served.page.url}/#/calibrate/{PROBE}")
        for kind, words in (("verify", "no calibration"), ("tip", "with calibrated")):
            page.select_option("[aria-label='What to calibrate']", kind)
            page.get_by_role("button", name="Begin").click()
            page.locator(".guide [role=alert]").get_by_text(words).wait_for()
        assert served.asked.all == []
        page.get_by_role("button", name="Calibrate all sensors").click()
        until(lambda: len(served.asked.all) > 0)
        until(lambda: page.evaluate("imud.model.probe.calibration.kind") == "all")
        page.close()


def begun(served: Served, browser: Live) -> Sending:
    """A calibration that takes the samples of a probe."""
    browser.say(do="calibrate", id=1, probe=PROBE, kind="all")
    until(lambda: len(served.asked.all) == 3)
    sending = Sending(served)
    sending.start()
    calibration(browser, "running")
    return sending


def test_a_calibration_may_start_again_at_once_after_its_end(served: Served) -> None:
    set_up = ["rate", "fields", "start"]
    with known(served) as browser:
        sending = begun(served, browser)
        served.asked.waits = "stop"
        for _ in range(2):
            browser.say(do="calibrate", id=2, probe=PROBE, kind="end")
        calibration(browser, "refused")
        sending.stop()
        browser.say(do="calibrate", id=3, probe=PROBE, kind="all")
        calibration(browser, "preparing")
        until(lambda: served.asked.release)
        # The probe is not asked for anything before it is as it was.
        asked = [command for _, command, _ in served.asked.all]
        assert asked == [*set_up, "stop"]
        served.asked.release()
        until(lambda: len(served.asked.all) == 9)
        asked = [command for _, command, _ in served.asked.all]
        assert asked == [*set_up, "stop", "fields", "rate", *set_up]


def test_a_probe_that_is_renamed_meanwhile_is_left_as_it_was(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guide, "SILENT_S", 0.5)
    about = {"probe_id": "11bef7fdb5481413", "t_ns": 1}
    with known(served, **about) as browser:
        sending = begun(served, browser)
        status = (
            {"type": "status", "probe": "pen", "hello": HELLO} | about | {"t_ns": 2}
        )
        served.page.publish([(("pen", "status"), json.dumps(status).encode())])
        sending.stop()
        record = calibration(browser, "refused")
        assert record["probe"] == "pen"
        assert record["why"] == "the probe was renamed to pen; start again"
        until(lambda: len(served.asked.all) == 6)
        assert [(name, command) for name, command, _ in served.asked.all[3:]] == [
            *(("pen", "stop"), ("pen", "fields"), ("pen", "rate"))
        ]


def test_a_probe_that_has_just_come_is_waited_for(served: Served) -> None:
    status = {"type": "status", "probe": PROBE, "hello": HELLO}
    params = {"type": "params", "probe": PROBE, "digest": "0", "bytes": ""}
    served.page.publish([((PROBE, "status"), json.dumps(status).encode())])
    with served.live() as browser:
        browser.say(do="calibrate", id=1, probe=PROBE, kind="all")
        calibration(browser, "preparing")
        assert served.asked.all == []
        served.page.publish([((PROBE, "params"), json.dumps(params).encode())])
        served.page.flush()
        until(lambda: len(served.asked.all) == 3)


def test_a_probe_that_never_tells_its_params_is_refused(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guide, "KNOWN_S", 0.1)
    with served.live() as browser:
        browser.say(do="calibrate", id=1, probe=PROBE, kind="all")
        assert "has not sent its params" in calibration(browser, "refused")["why"]


@pytest.mark.parametrize(
    ("about", "why"),
    [
        (
            {"hello": HELLO | {"sensor": "mpu6500", "who_am_i": (0x70, 0)}},
            "no magnetometer in this module (an MPU-6500 sold as an MPU-9250): no "
            "heading",
        ),
        ({"sensors": {"is_working": False, "words": ["no answer"]}}, "no answer"),
        (
            {"sensors": {"is_working": False, "words": []}},
            "its sensor was not found yet; try again",
        ),
    ],
)
def test_what_is_not_there_is_not_calibrated(
    served: Served, about: dict[str, Any], why: str
) -> None:
    with known(served, **about) as browser:
        browser.say(do="calibrate", id=1, probe=PROBE, kind="mag")
        assert calibration(browser, "refused")["why"] == why
    assert served.asked.all == []


def test_a_viewer_may_not_calibrate() -> None:
    users = TokenHolder("viewer")
    with Served(users) as served, known(served) as browser:
        browser.say(do="login", user="", secret=users.token)
        browser.say(do="calibrate", id=1, probe=PROBE, kind="all")
        assert "role" in browser.next("answer")["error"]
    assert served.asked.all == []
