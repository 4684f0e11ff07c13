# SPDX-License-Identifier: MIT
"""docs/pictures/page-*.png: each view of the page, light and dark, with two virtual
probes in simulated hands and a leg that walks; and on a phone.
"""

from __future__ import annotations

import sys

from playwright.sync_api import Browser

from benchmarks.common.paths import PICTURES
from benchmarks.page.desk import chromium, opened, served

VIEWS = ("probe", "signals", "calibrate", "aim", "probes", "limb")
SIZE, PHONE = (1180, 720), (360, 720)
# The plots are to be full, and the probe not yet far from the target.
SHOWN_S = {"probe": 2.0, "signals": 11.0, "calibrate": 30.0, "aim": 0.3, "probes": 1.5}
SHOWN_S["limb"] = 12.0

# Plots of poses and raw samples, which the probe is asked for.
PLOTS = """async () => {
  const plots = ["attitude", "sigma", "gyr", "pitch"];
  localStorage.setItem("imud.plots", JSON.stringify(plots));
  const { model } = globalThis.imud;
  await model.link.ask(model.selected, "rate", { stream: "raw", hz: "100" });
  await model.link.ask(model.selected, "fields", { streams: "pose,raw" });
}"""

# Aims 3 degrees beside where the probe is.
AIM = """() => {
  const { model } = globalThis.imud;
  const [w, x, y, z] = model.probe.pose.q;
  const [c, s] = [Math.cos(0.026), Math.sin(0.026)];
  const q = [c * w - s * y, c * x + s * z, c * y + s * w, c * z - s * x];
  const target = { name: "entry", q, axis: "x", tolerance_deg: 2, hold_s: 2 };
  localStorage.setItem("imud.targets", JSON.stringify([target]));
  localStorage.setItem("imud.target", JSON.stringify("entry"));
}"""

# Restarted if it was begun for another picture.
CALIBRATE = """async () => {
  const { link } = globalThis.imud.model;
  await link.calibrate("module", "stop");
  await link.calibrate("module", "all");
}"""


def take(browser: Browser, url: str, scheme: str, *, is_phone: bool) -> None:
    size = PHONE if is_phone else SIZE
    with opened(browser, url, size, is_dark=scheme == "dark") as page:
        page.evaluate(PLOTS)
        for view in VIEWS:
            probe = "module" if view == "calibrate" else "stylus"
            if view == "aim":
                page.evaluate("location.hash = '#/probe/stylus'")
                page.wait_for_function("globalThis.imud.model.probe?.pose")
                page.evaluate(AIM)
            if view == "calibrate":
                page.evaluate(CALIBRATE)
            page.evaluate(f"location.hash = '#/{view}/{probe}'")
            page.wait_for_timeout(300)
            # As on a machine that need not make the picture coarser.
            page.evaluate("globalThis.imud.view.adapt = null")
            page.wait_for_timeout(1000 * SHOWN_S[view])
            kind = "-phone" if is_phone else ""
            page.screenshot(path=PICTURES / f"page-{view}{kind}-{scheme}.png")


def main() -> int:
    with served() as (url, _), chromium() as browser:
        for scheme in ("light", "dark"):
            take(browser, url, scheme, is_phone=False)
        take(browser, url, "dark", is_phone=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
