# SPDX-License-Identifier: MIT
"""The page with 8 probes at 200 Hz in headless Chromium with software rendering: frames
a second, the main thread's time a frame, the way of a pose from the port to the drawn
frame, first paint; and what a browser costs the daemon.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright
from websockets.sync.client import connect
from websockets.typing import Origin

from benchmarks import harness
from benchmarks.common.load import cpu_s, feed, free_endpoint, idle_s, rss_mib
from benchmarks.common.source import RATE_HZ
from benchmarks.harness import Report, Table

PROBES = 8
VIEWS = ("probe", "signals")
PATIENCE_S = 30.0
# Without a sandbox of its own, as root; drawn by the processor.
ARGUMENTS = ("--no-sandbox", "--enable-unsafe-swiftshader")
WARM_UP_S = 7.0  # the picture adapts to the machine meanwhile

# For each drawn frame: its time, its duration, and the age of the pose since the
# daemon had read it from the port. Both clocks are this machine's.
WATCH = """() => {
  const { imud } = globalThis;
  const notes = (globalThis.notes = []);
  const frame = imud.frame.bind(imud);
  let last = null;
  imud.frame = (nowMs) => {
    const begin = performance.now();
    frame(nowMs);
    const end = performance.now();
    const pose = imud.model.probe?.pose;
    const readMs = pose ? pose.t_ns / 1e6 + pose.age_us / 1e3 : NaN;
    const age = pose && pose !== last ? performance.timeOrigin + end - readMs : null;
    last = pose;
    notes.push([end, end - begin, age]);
  };
}"""

# A row of the table, and the view's figures in it.
SHOWN = {
    "frames a second, median and worst second": (
        "{frames_hz:.0f}, {worst_frames_hz:.0f}"
    ),
    "main thread a frame, median and p95, ms": (
        "{frame_median_ms:.1f}, {frame_p95_ms:.1f}"
    ),
    "from the port to the drawn frame, median and p95, ms": (
        "{pixel_median_ms:.0f}, {pixel_p95_ms:.0f}"
    ),
    "first paint, ms": "{first_paint_ms:.0f}",
    "size of the page, compressed, kB": "{transfer_kb:.0f}",
}


@contextlib.contextmanager
def daemon(folder: Path) -> Iterator[tuple[int, str]]:
    """The daemon with its probes: its process id and the page's address."""
    spawn = multiprocessing.get_context("spawn")
    to_feeder, feeder_end = spawn.Pipe()
    words = (PROBES, RATE_HZ, feeder_end, folder / "sent.npy")
    feeder = spawn.Process(target=feed, args=words)
    feeder.start()
    names = to_feeder.recv()
    command = [sys.executable, "-m", "imud", "run", *names, "--no-log"]
    command += ["--listen", free_endpoint(), "--page", "127.0.0.1:0"]
    with (folder / "daemon.txt").open("w") as lines:
        process = subprocess.Popen(command, stderr=lines, cwd=folder)
    try:
        yield process.pid, address_of(folder / "daemon.txt", to_feeder)
    finally:
        process.terminate()
        process.wait()
        feeder.kill()
        feeder.join()


def address_of(lines: Path, to_feeder: Connection) -> str:
    """Waits for the page, and has the probes begin."""
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        found = [
            each for each in lines.read_text().splitlines() if "page is at" in each
        ]
        if found and "listens on" in lines.read_text():
            to_feeder.send("go")
            return found[0].rpartition(" ")[2]
        time.sleep(0.05)
    raise TimeoutError(lines.read_text())


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """The system's browser, without a window."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium-headless-shell")
            or shutil.which("chromium"),
            args=[*ARGUMENTS],
        )
        yield browser
        browser.close()


def quantiles(values: Sequence[float], *shares: float) -> list[float]:
    return [float(each) for each in np.quantile(np.array(values), shares)]


def opened(browser: Browser, url: str, view: str) -> tuple[Page, dict[str, float]]:
    """A page that shows poses; ms to its first paint and bytes of its files."""
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.goto(f"{url}/#/{view}")
    until_s = time.monotonic() + PATIENCE_S
    while not page.evaluate("Boolean(globalThis.imud?.model.probe?.pose)"):
        assert time.monotonic() < until_s
        page.wait_for_timeout(50)
    paint = "performance.getEntriesByName('first-contentful-paint')[0].startTime"
    size = (
        "[...performance.getEntriesByType('resource'),"
        "...performance.getEntriesByType('navigation')]"
        ".reduce((sum, one) => sum + one.encodedBodySize, 0)"
    )
    return page, {
        "first_paint_ms": page.evaluate(paint),
        "transfer_kb": page.evaluate(size) / 1000,
    }


def drawing(page: Page, seconds: float) -> dict[str, float]:
    """The browser's activity in that time."""
    page.evaluate(WATCH)
    page.wait_for_timeout(1000 * seconds)
    notes = page.evaluate("globalThis.notes")
    times = np.array([note[0] for note in notes]) / 1000
    per_second = np.bincount((times - times[0]).astype(int))[:-1]
    ages = [note[2] for note in notes if note[2] is not None]
    median_ms, p95_ms = quantiles(ages, 0.5, 0.95)
    busy_ms, busy_p95_ms = quantiles([note[1] for note in notes], 0.5, 0.95)
    return {
        "frames_hz": float(np.median(per_second)),
        "worst_frames_hz": float(per_second.min()),
        "pixel_median_ms": median_ms,
        "pixel_p95_ms": p95_ms,
        "frame_median_ms": busy_ms,
        "frame_p95_ms": busy_p95_ms,
    }


def draw_like_a_browser(url: str, to: Connection) -> None:
    """A connection that asks for what the view Probe does, and reports it as drawn."""
    with connect(
        url.replace("http", "ws", 1) + "/live",
        origin=Origin(url),
        max_size=None,
        compression=None,
    ) as live:
        to.send("open")
        probe = ""
        while True:
            message = live.recv()
            assert isinstance(message, bytes)
            head, *lines = map(json.loads, message.split(b"\n"))
            poses = [line for line in lines if line["type"] == "pose"]
            if poses and not probe:
                probe = poses[0]["probe"]
                live.send(json.dumps({"do": "watch", "probe": probe}))
            number = head["n"]
            if number % 4 == 0:
                live.send(json.dumps({"do": "seen", "n": number}))
            if to.poll():
                return


def cost(pid: int, url: str, browsers: int, seconds: float) -> dict[str, float]:
    """The daemon's CPU with this many browsers; the last of several is stopped."""
    spawn = multiprocessing.get_context("spawn")
    pipes, processes = [], []
    for _ in range(browsers):
        mine, theirs = spawn.Pipe()
        process = spawn.Process(target=draw_like_a_browser, args=(url, theirs))
        process.start()
        pipes.append(mine)
        processes.append(process)
    for pipe in pipes:
        pipe.recv()
    if browsers > 1 and processes[-1].pid is not None:
        subprocess.run(
            ["kill", f"-{signal.SIGSTOP.value}", str(processes[-1].pid)], check=True
        )
    time.sleep(1.0)
    begin_s, begin, idle = time.monotonic(), cpu_s(pid), idle_s()
    time.sleep(seconds)
    passed_s = time.monotonic() - begin_s
    found = {
        "browsers": float(browsers),
        "cpu_core": (cpu_s(pid) - begin) / passed_s,
        "idle_cores": (idle_s() - idle) / passed_s,
        "rss_mib": rss_mib(pid),
    }
    for process in processes:
        process.kill()
        process.join()
    return found


def tables_of(found: dict[str, Any]) -> Iterator[Table]:
    """What the browser does in each view, and the daemon's cost."""
    heads = {"": "", **dict.fromkeys((view.title() for view in found["views"]), "")}
    rows = [
        (words, *(form.format(**row) for row in found["views"].values()))
        for words, form in SHOWN.items()
    ]
    yield Table("views", heads, rows)
    columns = {"browsers": ".0f", "the daemon's share of a core": ".1%"}
    columns |= {"cores idle": ".2f", "memory, MiB": ".0f"}
    yield Table("browsers", columns, [tuple(row.values()) for row in found["cost"]])


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=20.0, help="of each figure")
    parser.add_argument("--browsers", type=int, nargs="*", default=[0, 1, 8, 32])


def measured(args: argparse.Namespace) -> Report:
    found: dict[str, Any] = {"views": {}}
    with (
        tempfile.TemporaryDirectory() as folder,
        daemon(Path(folder)) as (pid, url),
        chromium() as browser,
    ):
        time.sleep(WARM_UP_S)
        found["cost"] = [cost(pid, url, n, args.seconds) for n in args.browsers]
        for view in VIEWS:
            page, about = opened(browser, url, view)
            page.wait_for_timeout(1000 * WARM_UP_S)
            found["views"][view] = drawing(page, args.seconds) | about
    return Report([*tables_of(found)], data=found)


main = partial(harness.run, "page", __doc__, measured, options)
