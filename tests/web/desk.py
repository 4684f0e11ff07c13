# SPDX-License-Identifier: MIT
"""A probe in a hand, a daemon that serves the page, and the page in Chromium."""

from __future__ import annotations

import contextlib
import itertools
import json
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Self

from msgspec.structs import replace
from playwright.sync_api import Browser, Page, Request

from fakes import PATIENCE_S, DaemonProcess, FakeProbe, Port, free_address
from imud.calibration.recording import Sample
from imud.client import Client
from raw_probe import RATES, raw

PERIOD_S = 0.05
BURST = 60  # samples of a calibration in a period
# Frames that a browser without a screen draws, and what is said of it.
ARGUMENTS = ("--no-sandbox", "--enable-unsafe-swiftshader")
# Few of them: a processor draws them, and is wanted for the tests.
SLOWLY = """const draw = requestAnimationFrame.bind(globalThis);
globalThis.requestAnimationFrame = (step) => setTimeout(() => draw(step), 150);"""
# Chromium's own remark on software rendering.
REMARK = "GPU stall due to ReadPixels"


class Hand(threading.Thread):
    """Holds a probe: it says its pose again and again, and answers commands."""

    def __init__(self, port: Port, probe: FakeProbe) -> None:
        super().__init__(daemon=True)
        self._port, self._probe = port, probe
        self._is_over = threading.Event()
        self._fields: dict[str, Any] = {}
        self.is_talking = True
        self.is_telling_raw = False
        self.state = "streaming"
        self._samples: list[Sample] = []
        self._lying: list[Sample] = []  # how it lies after a calibration's samples
        self._turn = threading.Lock()  # of whoever writes or says what is written next

    def turn(self, q: tuple[float, ...], **fields: Any) -> None:
        self._fields = {"q": q, **fields}

    def say(self, *names: str, **fields: Any) -> None:
        """Says these messages between two poses."""
        with self._turn:
            for name in names:
                self._port.write(self._probe.say(name, **fields))

    def calibrate(self, samples: Sequence[Sample]) -> None:
        """Says these raw samples once it is asked for any, faster than a probe."""
        with self._turn:
            self._probe.commands.clear()
            self._probe.hello_fields = self._probe.hello_fields | RATES
            self._queue(samples, self._probe.time_us)
        self.say("hello")

    def goes_on(self, samples: Sequence[Sample]) -> None:
        """Says these after those that were said, instead of lying on."""
        with self._turn:
            self._queue(samples, self._lying[-1].t_us + 10_000 - samples[0].t_us)

    def _queue(self, samples: Sequence[Sample], begin_us: int) -> None:
        self._samples = [replace(each, t_us=each.t_us + begin_us) for each in samples]
        self._lying = self._samples[-1:]

    def pick_up(self) -> None:
        """Ends the calibration's samples."""
        with self._turn:
            self._lying = []

    def _burst(self) -> bytes:
        if not any(each["command"] == "fields" for each in self._probe.commands):
            return b""
        now, self._samples = self._samples[:BURST], self._samples[BURST:]
        if not now:
            (last,) = self._lying
            now = [replace(last, t_us=last.t_us + 10_000 * n) for n in range(1, 6)]
            self._lying = now[-1:]
        return b"".join(raw(self._probe, each) for each in now)

    def run(self) -> None:
        for count in itertools.count():
            if self._is_over.wait(PERIOD_S):
                return
            with self._turn:
                self._port.write(self._said(count))

    def _said(self, count: int) -> bytes:
        data = self._port.answers(self._probe)
        if self._lying:
            return data + self._burst()
        if not self.is_talking:
            return data
        data += self._probe.say("pose", **self._fields)
        if self.is_telling_raw:
            data += self._probe.say("raw")
        if count % 25 == 0:
            data += self._probe.say("status", state=self.state)
        return data

    def stop(self) -> None:
        self._is_over.set()
        self.join()


class Desk:
    """All of it. `poses` are those that a subscriber of the daemon got, by number."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        host, port = free_address()
        self.address = f"{host}:{port}"
        self.probe = FakeProbe()
        self.port = Port(folder / "port")
        self.poses: dict[int, dict[str, Any]] = {}
        self.aims: list[dict[str, Any]] = []
        self.daemon = self._start()
        self.hand = Hand(self.port, self.probe)
        self.hand.turn((1.0, 0.0, 0.0, 0.0))
        self.hand.start()

    @property
    def url(self) -> str:
        return f"http://{self.address}/"

    def _start(self) -> DaemonProcess:
        daemon = DaemonProcess(
            *(self.port.path, "--page", self.address),
            directory=self._folder,
            page=None,
        )
        daemon.find(self.port, self.probe, up="the page is at")
        self._client = Client(daemon.endpoint)
        self._client.wait_for(seconds=PATIENCE_S)
        self._client.subscribe("pose", None, self._keep)
        self._client.subscribe(
            "aim", None, lambda _, payload: self.aims.append(json.loads(payload))
        )
        return daemon

    def _keep(self, _: str, payload: bytes) -> None:
        pose = json.loads(payload)
        self.poses[pose["number"]] = pose

    def publish(self, key: str, payload: bytes) -> None:
        """As another program of the network."""
        self._client.session.put(key, payload)

    def end_daemon(self) -> None:
        self._client.close()
        self.daemon.stop()
        self.daemon.__exit__(None, None, None)

    def restart_daemon(self) -> None:
        self.hand.stop()
        self.port.vanish()
        self.port = Port(self.port.path)
        self.daemon = self._start()
        self.hand = Hand(self.port, self.probe)
        self.hand.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.hand.stop()
        self._client.close()
        self.daemon.__exit__(None, None, None)
        self.port.vanish()


class Seen:
    """The page, and what it complained of and asked for."""

    def __init__(self, page: Page, host: str) -> None:
        self.page = page
        self.complaints: list[str] = []
        self.elsewhere: list[str] = []
        self._host = host
        page.on("console", lambda message: self._hear(message.type, message.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", self._follow)
        page.set_default_timeout(1000 * PATIENCE_S)

    def _hear(self, kind: str, text: str) -> None:
        if kind in ("error", "warning") and REMARK not in text:
            self.complaints.append(text)

    def _follow(self, request: Request) -> None:
        if not request.url.startswith((f"http://{self._host}/", "blob:")):
            self.elsewhere.append(request.url)

    def until(self, is_so: str, argument: Any = None) -> Any:
        """Waits for JavaScript to be true and returns what it says.

        The page's policy forbids that it polls.
        """
        while not (result := self.page.evaluate(is_so, argument)):
            self.page.wait_for_timeout(20)
        return result

    def prefer(self, convention: str) -> None:
        """Sets the convention of angles for the views that are opened from here on."""
        self.page.evaluate(
            "name => localStorage.setItem('imud.convention', JSON.stringify(name))",
            convention,
        )

    def text(self, selector: str) -> str:
        """With the signs and spaces of the keyboard."""
        text = self.page.locator(selector).inner_text()
        return text.replace("\u2212", "-").replace("\u2007", "").strip()

    def number(self, key: str) -> float:
        return float(self.text(f'[data-value="{key}"]').strip("±°"))


@contextlib.contextmanager
def seen(
    browser: Browser, desk: Desk, view: str = "probe", **options: Any
) -> Iterator[Seen]:
    """The page, opened at a view; it must not complain or ask for anything elsewhere.

    Two views draw in three dimensions, which without a GPU costs more than the rest.
    """
    options = {"viewport": {"width": 800, "height": 480}} | options
    context = browser.new_context(**options)
    context.add_init_script(SLOWLY)
    try:
        found = Seen(context.new_page(), desk.address)
        found.page.goto(f"{desk.url}#/{view}")
        found.until("Boolean(globalThis.imud?.model.probe?.pose)")
        yield found
        assert not found.elsewhere, found.elsewhere
        assert not found.complaints, found.complaints
    finally:
        context.close()
