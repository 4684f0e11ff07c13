# SPDX-License-Identifier: MIT
"""docs/pictures/page-*.png: each view of the page, light and dark, with two virtual
probes in simulated hands; and on a phone.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from live import free_endpoint
from page import ARGUMENTS
from playwright.sync_api import Browser, sync_playwright

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
START_S = 20.0
VIEWS = ("probe", "signals", "aim", "probes")
SIZE, PHONE = {"width": 1180, "height": 720}, {"width": 360, "height": 720}
# The plots are to be full, and the probe not yet far from the target.
SHOWN_S = {"probe": 2.0, "signals": 11.0, "aim": 0.3, "probes": 1.5}

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


def take(browser: Browser, url: str, scheme: str, *, is_phone: bool) -> None:
    page = browser.new_context(
        viewport=PHONE if is_phone else SIZE,  # type: ignore[arg-type] # a dict of ints
        color_scheme="dark" if scheme == "dark" else "light",
    ).new_page()
    page.goto(url)
    until_s = time.monotonic() + START_S
    while not page.evaluate("Boolean(globalThis.imud?.model.probe?.pose)"):
        if time.monotonic() > until_s:
            sys.exit("no pose came")
        page.wait_for_timeout(100)
    page.evaluate(PLOTS)
    for view in VIEWS:
        if view == "aim":
            page.evaluate(AIM)
        page.evaluate("view => { location.hash = `#/${view}` }", view)
        page.wait_for_timeout(1000 * SHOWN_S[view])
        kind = "-phone" if is_phone else ""
        page.screenshot(path=PICTURES / f"page-{view}{kind}-{scheme}.png")
    page.context.close()


def main() -> int:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))

        def start(*words: str) -> Path:
            log = folder / f"{words[1]}.txt"
            process = subprocess.Popen(
                [sys.executable, "-m", "imud", *words],
                stdout=stack.enter_context(log.open("w")),
                stderr=subprocess.STDOUT,
                cwd=folder,
            )
            stack.callback(process.wait)
            stack.callback(process.terminate)
            return log

        config = folder / "imud.toml"
        ports = [str(folder / board) for board in ("nano", "f405")]
        for board, port in zip(("nano", "f405"), ports, strict=True):
            start("sim", board, "--stream", "--link", port)
        config.write_text(f'[web]\nlisten = "127.0.0.1:0"\n[ports]\nnamed = {ports}\n')
        while not all(Path(port).exists() for port in ports):
            time.sleep(0.1)
        log = start(
            *("run", "--config", str(config), "--log", str(folder / "logs")),
            *("--listen", free_endpoint()),
        )
        time.sleep(8.0)  # until both have calibrated their gyroscopes
        lines = log.read_text().splitlines()
        url = next(line for line in lines if "page is at" in line).rpartition(" ")[2]
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=[*ARGUMENTS]
        )
        for scheme in ("light", "dark"):
            take(browser, url, scheme, is_phone=False)
        take(browser, url, "dark", is_phone=True)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
