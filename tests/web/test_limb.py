# SPDX-License-Identifier: MIT
"""The view Limb in Chromium: it draws what a body's states say, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser

from imud.web.bodies import STATE_MAX, line_of
from web.desk import Desk, Seen, seen
from web.limbs import SAYS, leg

KEY = "imud/body/right-leg/state"
# The rods' names, and where the foot's path ends.
DRAWN = """() => {
  const { figure, _recorder: recorder } = globalThis.imud.view;
  const { history } = recorder;
  const names = figure.limb.children.map((one) => one.name).filter(Boolean);
  const last = history ? history.length - 1 : -1;
  return {
    rods: [...new Set(names)],
    words: figure._words.children.length,
    row: history ? history.names.map((_, at) => history.value(at, last)) : [],
    columns: history ? [...history.names] : [],
  };
}"""


@pytest.fixture(scope="module")
def shown(browser: Browser, desk: Desk) -> Iterator[Seen]:
    with seen(browser, desk) as found:
        found.page.keyboard.press("6")
        found.page.wait_for_selector(".limb.view")
        yield found


def publish_until(shown: Seen, desk: Desk, is_so: str, **fields: Any) -> None:
    """Publishes such states until the page says that it is so."""
    number = 1
    for _ in range(2000):
        desk.publish(KEY, json.dumps(leg(number, **fields)).encode())
        number += 1
        shown.page.wait_for_timeout(15)
        if shown.page.evaluate(is_so):
            return
    raise AssertionError(is_so)


def shows(text: str) -> str:
    part = "document.querySelector('[data-part=says]')"
    return f"({part}?.textContent ?? '').includes({json.dumps(text)})"


def test_it_guides_through_the_alignment(shown: Seen, desk: Desk) -> None:
    shown.page.get_by_text("No limb yet").wait_for()
    for stage in ("standing", "moving"):
        publish_until(shown, desk, shows(SAYS[stage]), stage=stage)
        assert (
            shown.page.get_attribute(f'[data-stage="{stage}"]', "aria-current")
            == "step"
        )
    assert shown.page.evaluate(DRAWN)["rods"] == []
    publish_until(shown, desk, shows("Aligned by motion"))


def test_figure_and_plots_are_what_the_states_say(shown: Seen, desk: Desk) -> None:
    angle = "document.querySelector('[data-angle=\"shank flexion\"]').textContent"
    publish_until(shown, desk, f"{angle}.includes('47.5° ±1.6')", flexion=47.5)
    drawn = shown.page.evaluate(DRAWN)
    assert drawn["rods"] == ["thigh", "shank", "foot"]
    assert drawn["words"] == 0
    row = dict(zip(drawn["columns"], drawn["row"], strict=True))
    assert row["shank_knee_flexion_deg"] == pytest.approx(47.5)
    assert [row[f"foot_{axis}_m"] for axis in "xyz"] == pytest.approx(
        [-0.03, 0.0, -0.89], abs=1e-6
    )
    assert shown.page.locator(".charts [data-plot]").count() == 3


def test_events_of_the_gait_are_listed(shown: Seen, desk: Desk) -> None:
    events = "globalThis.imud.view._recorder.events.length"
    publish_until(shown, desk, f"{events} >= 1", is_down=False)
    publish_until(shown, desk, f"{events} >= 2", is_down=True)
    shown.page.get_by_text("toe off, foot").wait_for()
    shown.page.get_by_text("foot strike, foot").wait_for()


def test_what_is_missing_is_drawn_as_missing_and_never_as_still(
    shown: Seen, desk: Desk
) -> None:
    one = "globalThis.imud.view.figure._words.children.length === 1"
    publish_until(shown, desk, one, missing=("foot",))
    drawn = shown.page.evaluate(DRAWN)
    assert drawn["rods"] == ["thigh", "shank"]
    row = dict(zip(drawn["columns"], drawn["row"], strict=True))
    missing = {name for name, value in row.items() if value != value}
    assert {"foot_ankle_flexion_deg", "foot_x_m", "foot_z_m"} <= missing
    assert row["shank_knee_flexion_deg"] == 30.0
    shown.until(
        "document.querySelector('[data-angle=\"foot flexion\"]')"
        ".textContent.endsWith('missing')"
    )
    shown.page.locator('[data-segment="foot"]').get_by_text("missing").wait_for()
    # Nothing at all comes any more.
    shown.page.wait_for_selector('.limb[data-stale] [data-part="age"]:not([hidden])')


def test_a_phone_shows_it(shown: Seen, desk: Desk) -> None:
    shown.page.set_viewport_size({"width": 360, "height": 640})
    publish_until(shown, desk, shows("Aligned by motion"))
    assert shown.page.evaluate("document.documentElement.scrollWidth") <= 360


@pytest.mark.parametrize(
    ("key", "payload"),
    [
        (KEY, b'{"type":"page","body":"right-leg"}'),
        (KEY, b'{"type":"body","body":"left-leg"}'),
        (KEY, b'{"type":"body",\n"body":"right-leg"}'),
        (KEY, b"no JSON"),
        (KEY, b'{"type":"body","body":"right-leg"}' + b" " * STATE_MAX),
    ],
)
def test_what_is_no_state_goes_to_no_browser(key: str, payload: bytes) -> None:
    assert line_of(key, payload) is None
    assert line_of(KEY, b'{"type":"body","body":"right-leg"}') is not None
