# SPDX-License-Identifier: MIT
"""The page of a daemon with virtual probes in simulated hands, for pictures of it."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.common.images import simulated
from benchmarks.common.load import free_endpoint
from benchmarks.page.walking_leg import walking
from imud.client import Client

# Without a sandbox of its own, as root; drawn by the processor.
ARGUMENTS = ("--no-sandbox", "--enable-unsafe-swiftshader")
START_S = 30.0
# Has the page draw as it does with a graphics card, but only so often: the processor
# draws, and the virtual boards need their time.
FRAME_MS = 80
WITH_CARD = """(frameMs) => {
  globalThis.requestAnimationFrame = (draw) =>
    setTimeout(() => draw(performance.now()), frameMs);
  const { prototype } = WebGL2RenderingContext;
  const get = prototype.getParameter;
  prototype.getParameter = function (name) {
    return name === this.RENDERER ? "a card" : get.call(this, name);
  };
}"""
# The virtual boards: how each is held, and its name.
BOARDS = {"nano": ("--module", "shop", "--hand", "follow"), "f405": ()}
NAMES = {"nano": "module", "f405": "stylus"}
# Rest at the start, until both boards have calibrated their gyroscopes.
REST_S = 8.0


@contextlib.contextmanager
def served() -> Iterator[tuple[str, str]]:
    """A daemon with both virtual boards and a leg: its page, and its endpoint."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))

        def start(*words: str) -> Path:
            log = folder / f"{words[0]}-{words[1]}.txt"
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
        ports = [folder / board for board in BOARDS]
        page = free_endpoint().removeprefix("tcp/")
        for (board, held), port in zip(BOARDS.items(), ports, strict=True):
            words = (*held, "--page", f"http://{page}", "--stream", "--link", str(port))
            start(*simulated(board), *words)
        config.write_text(
            f'[web]\nlisten = "{page}"\n'
            f"[ports]\nnamed = {[str(port) for port in ports]}\n"
        )
        wait_for(lambda: all(port.exists() for port in ports))
        endpoint = free_endpoint()
        log = start(
            *("run", "--config", str(config), "--log", str(folder / "logs")),
            *("--listen", endpoint),
        )
        time.sleep(REST_S)
        wait_for(lambda: "page is at" in log.read_text())
        name_probes(endpoint)
        stack.enter_context(walking(endpoint))
        lines = log.read_text().splitlines()
        line = next(line for line in lines if "page is at" in line)
        yield line.rpartition(" ")[2], endpoint


def name_probes(endpoint: str) -> None:
    """Gives each probe the name of its board: a Nano's id is another in each image."""
    with Client(endpoint) as client:
        wait_for(lambda: len(client.statuses()) == len(NAMES))
        for status in client.statuses():
            name = NAMES[status["hello"]["board"]]
            client.command(status["probe"], "configure", rename=name)


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """The system's browser, without a window."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=[*ARGUMENTS]
        )
        yield browser
        browser.close()


@contextlib.contextmanager
def opened(
    browser: Browser, url: str, size: tuple[int, int], *, is_dark: bool
) -> Iterator[Page]:
    """The page in a window of that size, once it shows a pose of the stylus."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]},
        color_scheme="dark" if is_dark else "light",
    )
    page = context.new_page()
    page.add_init_script(f"({WITH_CARD})({FRAME_MS})")
    page.goto(f"{url}/#/probe/stylus")
    wait_for(
        lambda: page.evaluate("Boolean(globalThis.imud?.model.probe?.pose)"),
        lambda: page.wait_for_timeout(100),
    )
    yield page
    context.close()


def wait_for(
    is_so: Callable[[], object],
    pause: Callable[[], object] = lambda: time.sleep(0.1),
) -> None:
    """Waits until that is so; TimeoutError if it takes too long."""
    until_s = time.monotonic() + START_S
    while not is_so():
        if time.monotonic() > until_s:
            raise TimeoutError("the probes or the page did not start")
        pause()
