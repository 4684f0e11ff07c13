# SPDX-License-Identifier: MIT
"""`imud view`: opens the page of a daemon on this machine, or serves the page here for
a daemon elsewhere.
"""

from __future__ import annotations

import http.client
import sys
import time
import webbrowser
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import zenoh

from imud.client import Client
from imud.client.client import Delivery
from imud.defaults import ENDPOINT, PAGE, PREFIX
from imud.endpoint import host_and_port, is_loopback, misspelt
from imud.errors import ConfigError, ImudError, ListenFailed
from imud.net.access import BODIES, BODY_STATE
from imud.net.network import read_credentials
from imud.web.bodies import line_of
from imud.web.feed import BODY
from imud.web.server import Page
from imud.web.session import Answer
from imud.web.users import TOPICS, TokenHolder

FRAME_S = 1 / 60
IDLE_S = 0.1
ANSWER_S = 0.5  # a page on this machine answers within milliseconds
# Commands may each wait for a probe; those of other probes should not wait for them.
WORKERS = 8

_encode = msgspec.json.Encoder().encode


class Distant:
    """A daemon elsewhere, as the page needs it: its payloads, and its answers."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._workers = ThreadPoolExecutor(WORKERS, thread_name_prefix="imud-ask")

    def feed(self, page: Page, prefix: str = PREFIX) -> None:
        """Hands what the daemon publishes to the page, from here on."""

        def forwarder(topic: str) -> Callable[[Delivery], None]:
            def forward(delivery: Delivery) -> None:
                # A line is one object; JSON of imud's has no line breaks.
                if b"\n" not in delivery.payload:
                    page.publish([((delivery.probe, topic), delivery.payload)])

            return forward

        def forward_body(sample: zenoh.Sample) -> None:
            found = line_of(str(sample.key_expr), sample.payload.to_bytes())
            if found is not None:
                page.publish([found])

        for topic in sorted(TOPICS - {BODY}):
            if self._client.may(topic):
                self._client.listen(topic, None, forwarder(topic))
        bodies = f"{prefix}/{BODIES}/*/{BODY_STATE}"
        self._client.session.declare_subscriber(bodies, forward_body)
        for status in self._client.statuses():
            page.publish([((str(status["probe"]), "status"), _encode(status))])

    def ask(
        self,
        probe: str,
        command: str,
        parameters: dict[str, str],
        answer: Answer,
        _by: str,
    ) -> None:
        """Executes a command without waiting for it. To the daemon it is a command from
        the network, whichever browser sent it.
        """
        self._workers.submit(self._ask, probe, command, parameters, answer)

    def _ask(
        self, probe: str, command: str, parameters: dict[str, str], answer: Answer
    ) -> None:
        try:
            if command == "params":
                records = bytes.fromhex(parameters.get("records", ""))
                reply = self._client.change_params(probe, records)
            else:
                reply = self._client.command(probe, command, **parameters)
        except (ImudError, ValueError) as error:
            answer(b"", str(error))
        else:
            answer(_encode(reply), "")


def has_page() -> bool:
    """Whether a daemon on this machine serves the page where it is by default."""
    address = host_and_port(PAGE)
    if address is None:
        return False
    connection = http.client.HTTPConnection(*address, timeout=ANSWER_S)
    try:
        connection.request("GET", "/")
        return (connection.getresponse().getheader("Server") or "").startswith("imud/")
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()


def run(
    endpoint: str,
    prefix: str,
    keys: Path | None,
    address: str | None,
    *,
    is_opened: bool,
) -> int:
    """Opens the page in a browser; serves it until Ctrl-C where no daemon does."""
    if endpoint == ENDPOINT and keys is None and address is None and has_page():
        show(f"http://{PAGE}", is_opened=is_opened)
        return 0
    with Client(endpoint, prefix, keys) as client:
        users = TokenHolder(read_credentials(keys).role) if keys is not None else None
        distant = Distant(client)
        about = {"connect": client.endpoint}

        def make(where: tuple[str, int]) -> Page:
            return Page(where, distant.ask, users=users, about=about)

        page = _started(make, address)
        try:
            distant.feed(page, prefix)
            secret = f"/#token={users.token}" if users is not None else ""
            show(f"{page.url}{secret}", is_opened=is_opened)
            while True:
                page.flush()
                time.sleep(FRAME_S if page.is_watched else IDLE_S)
        finally:
            page.close()


def show(url: str, *, is_opened: bool) -> None:
    """Prints the address, and opens it in a browser if there is one."""
    sys.stdout.write(f"the page is at {url}\n")
    sys.stdout.flush()
    if is_opened:
        webbrowser.open(url)


def _started(make: Callable[[tuple[str, int]], Page], address: str | None) -> Page:
    """A page that is served; at any free port if the usual one is taken."""
    wanted = host_and_port(PAGE if address is None else address)
    if wanted is None or not is_loopback(wanted[0]):
        wrong = misspelt(str(address), PAGE)
        raise ConfigError(wrong or f"{address} is not on this machine: try {PAGE}")
    page = make(wanted)
    try:
        page.start()
    except ListenFailed:
        if address is not None:
            raise
        page = make((wanted[0], 0))
        page.start()
    return page
