# SPDX-License-Identifier: MIT
"""The page without a daemon, opened as a file, and a serial port that a test plays."""

from __future__ import annotations

import base64
import contextlib
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser

from fakes import FakeProbe
from imud.web import packed
from web.desk import SLOWLY, Seen

# A busy machine must not run into what the page waits for: a hello, a reply.
PATIENTLY = """const soon = globalThis.setTimeout;
globalThis.setTimeout = (act, ms = 0) => soon(act, ms < 1000 ? ms : 60 * ms);
"""
# What WebSerial gives a page, with `say` for what comes and `heard` for what it writes.
SERIAL = """
class FakePort extends EventTarget {
  readable = null;
  writable = null;
  async open({ baudRate }) {
    if (this.readable || this.isTaken) throw new DOMException("taken", "NetworkError");
    this.baudRate = baudRate;
    this.begin();
    const never = new Promise(() => {});
    const write = (bytes) => this.isFull ? never : globalThis.heard([...bytes]);
    this.writable = new WritableStream({ write });
  }
  begin() {
    const start = (controller) => { this.controller = controller; };
    this.readable = new ReadableStream({ start });
  }
  async close() { this.readable = this.writable = null; }
  getInfo() { return { usbVendorId: 0x1a86, usbProductId: 0x7523 }; }
  say(text) {
    const bytes = Uint8Array.from(atob(text), (each) => each.charCodeAt(0));
    this.controller.enqueue(bytes);
  }
  stumble() {
    const { controller } = this;
    this.begin();
    controller.error(new DOMException("a wrong stop bit", "FramingError"));
  }
  vanish() {
    this.readable = this.writable = null;
    this.controller.error(new DOMException("it is lost", "NetworkError"));
  }
}
const serial = new EventTarget();
globalThis.replug = () => { globalThis.port = new FakePort(); };
globalThis.replug();
serial.requestPort = async () => globalThis.port;
Object.defineProperty(navigator, "serial", { value: serial });
"""


class Alone(Seen):
    """The page, and the port that it opens."""

    written = b""

    def say(self, data: bytes) -> None:
        text = base64.b64encode(data).decode()
        self.page.evaluate("(text) => globalThis.port.say(text)", text)

    def connect(self) -> None:
        self.page.get_by_role("button", name="Connect a probe").click()
        self.until("Boolean(globalThis.port.readable)")

    def play(self, probe: FakeProbe, is_so: str, **fields: Any) -> None:
        """Has the probe say poses, a status now and then, and answers, until that."""
        for count in itertools.count():
            said = probe.hear(self.take()) + probe.say("pose", **fields)
            if count % 20 == 0:
                said += probe.say("hello") + probe.say("status", state="streaming")
            self.say(said)
            if self.page.evaluate(is_so):
                return
            self.page.wait_for_timeout(20)

    def take(self) -> bytes:
        """What the page has written since."""
        written, self.written = self.written, b""
        return written


@contextlib.contextmanager
def alone(
    browser: Browser, folder: Path, view: str = "probe", **options: Any
) -> Iterator[Alone]:
    """The page as a file; it must not complain, nor ask anybody for anything."""
    packed.write(folder)
    options = {"viewport": {"width": 800, "height": 480}} | options
    context = browser.new_context(**options)
    try:
        found = Alone(context.new_page(), "nobody")
        found.page.clock.install()
        found.page.add_init_script(f"{PATIENTLY}{SLOWLY}\n{SERIAL}")
        hear: Callable[..., None] = lambda _, data: setattr(  # noqa: E731
            found, "written", found.written + bytes(data)
        )
        found.page.expose_binding("heard", hear)
        found.page.goto(f"{(folder / 'index.html').as_uri()}#/{view}")
        found.until("Boolean(globalThis.imud)")
        yield found
        assert not [u for u in found.elsewhere if not u.startswith(("file:", "data:"))]
        assert not found.complaints, found.complaints
    finally:
        context.close()
