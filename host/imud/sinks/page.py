# SPDX-License-Identifier: MIT
"""Feeds the page of this daemon with every record's JSON, fifty times a second."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping

from imud.errors import ListenFailed
from imud.probes.record import Presence, Record
from imud.web.bodies import line_of
from imud.web.feed import Key
from imud.web.server import Page

# With a browser, records are handed on this often: at 60 Hz, which screens draw, a
# browser would cost 3 % of a core.
WATCHED_S = 1 / 50
IDLE_S = 0.2

# A port that was taken is tried again this often.
AGAIN_S = 5.0
PATIENCE_S = 0.8

logger = logging.getLogger("imud")


class PageSink:
    """Serves the page while it can: a port that is taken does not stop the daemon."""

    name = "web"
    patience_s = PATIENCE_S
    is_quick = True  # it takes records as they are

    def __init__(self, make: Callable[[], Page]) -> None:
        self._make = make
        self._page: Page | None = None
        self._again_s = 0.0
        self._fresh: list[tuple[Key, bytes]] = []
        self._is_told = False
        self.period_s = IDLE_S

    def open(self) -> None:
        """Serves the page; a taken address is told once, and tried again."""
        page = self._make()
        try:
            page.start()
        except ListenFailed as error:
            self._again_s = time.monotonic() + AGAIN_S
            if not self._is_told:
                logger.warning("%s", error)
            self._is_told = True
        else:
            self._page = page
            logger.info("the page is at %s", page.url)

    @property
    def refused(self) -> Mapping[str, int]:
        """Requests and messages, by reason."""
        return self._page.refused if self._page is not None else {}

    def write(self, record: Record | Presence) -> None:
        if isinstance(record, Record) and record.payload:
            self._fresh.append(((record.probe, record.topic), record.payload))

    def hear_body(self, key: str, payload: bytes) -> None:
        """Accepts another program's message about a body; called in any thread."""
        page, line = self._page, line_of(key, payload)
        if page is not None and line is not None:
            page.publish([line])

    def flush(self) -> None:
        """Passes on what was written, more often while a browser watches."""
        page = self._page
        fresh, self._fresh = self._fresh, []
        self.period_s = WATCHED_S if page is not None and page.is_watched else IDLE_S
        if page is not None:
            page.publish(fresh)
            page.flush()
        elif time.monotonic() > self._again_s:
            self.open()

    def close(self) -> None:
        page, self._page = self._page, None
        if page is not None:
            page.close()

    def go_on_for(self, _: PageSink) -> None:
        """Browsers keep their connection."""
        if self._page is not None:
            self._page.forget()
