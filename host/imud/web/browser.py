# SPDX-License-Identifier: MIT
"""One connected browser: what it wants, what waits for it, and when it is sent.

A message is lines of JSON. The first is a head with the message's number, which the
browser reports back once it has drawn it: a browser that does not draw is sent nothing.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

import msgspec

from imud.web.feed import EVENTS, LATEST, STREAMS, Key

# Messages that a browser may be behind with: a quarter of a second at 60 Hz, which
# covers a slow frame and the collection of garbage.
WINDOW = 16
# Payloads that wait for a browser that wants all of them: 2 s of a probe at 200 Hz.
WAITING_MAX = 400
ANSWERS_MAX = 64
# Without anything new a head alone is sent so often: it shows that the server is there.
HEARTBEAT_S, STRANGER_S = 0.2, 1.0  # the second before a login
RATE_HZ = 60.0
# Poses of probes that are not looked at are sent this often.
OTHERS_S = 0.1
# A message may be sent this share of a period before it is due.
SLACK = 0.4

NO_IDS: Mapping[str, str] = {}

Send = Callable[[bytes], Awaitable[None]]

_encode = msgspec.json.Encoder().encode


class Browser:
    """Belongs to the server's loop, which makes all calls."""

    def __init__(
        self, window: int | None = WINDOW, ids: Mapping[str, str] = NO_IDS
    ) -> None:
        """`window`: messages that it may be behind with. None: it is a program, which
        need not report what it has seen; how fast it reads is what holds it back.
        `ids`: the present ids of probes, by name.
        """
        self._ids = ids
        self._window = window
        self.is_program = window is None
        self._reads: frozenset[str] = frozenset()
        self._every: frozenset[Key] = frozenset()
        self._probe = ""  # that is looked at; empty: all are
        self._period_s = 1.0 / RATE_HZ
        self._sent_s = 0.0  # time of the loop
        self._is_beat = False
        self._latest: dict[Key, bytes] = {}
        self._others: dict[Key, bytes] = {}
        self._others_s = 0.0  # when they were sent last
        self._waiting: dict[Key, deque[bytes]] = {}
        self._answers: deque[bytes] = deque(maxlen=ANSWERS_MAX)
        self._wake = asyncio.Event()
        self._sent = 0
        self._seen = 0
        self.is_playing = False  # a log, in the place of what is live
        self.left_out = 0  # payloads of streams for which there was no room

    def grant(self, reads: frozenset[str]) -> None:
        """Sets the topics that its user may read."""
        self._reads = reads

    def watch(self, every: frozenset[Key], rate_hz: float, probe: str = "") -> None:
        """Sets of what it wants every payload, how often it draws, and which probe: by
        its name, or by its id under every name.
        """
        self._probe = probe
        self._every = frozenset(key for key in every if key[1] in STREAMS)
        self._waiting = {k: v for k, v in self._waiting.items() if self._wants(k)}
        self._period_s = 1.0 / rate_hz

    def _wants(self, key: Key) -> bool:
        """Whether it asked for every payload of a key."""
        own = self._ids.get(key[0], key[0]), key[1]
        return key in self._every or own in self._every

    @property
    def answers(self) -> int:
        """Answers that wait to be sent."""
        return len(self._answers)

    def seen(self, number: int) -> None:
        """The browser has drawn the message of that number."""
        if self._seen < number <= self._sent:
            self._seen = number
            self._window = WINDOW
            self._wake.set()

    def play(self, *, is_playing: bool) -> None:
        """From here on it gets what a log has, or again what is live."""
        self.is_playing = is_playing
        self._latest.clear()
        self._others.clear()
        self._waiting.clear()

    def put(
        self, fresh: Mapping[Key, deque[bytes]], *, is_played: bool = False
    ) -> None:
        """Payloads by probe and topic, which are live or `is_played` from a log."""
        if is_played != self.is_playing or not self._reads:
            return
        for key, payloads in fresh.items():
            topic = key[1]
            if topic not in self._reads:
                continue
            if topic in EVENTS or self._wants(key):
                waiting = self._waiting.setdefault(key, deque())
                waiting.extend(payloads)
                while len(waiting) > WAITING_MAX:
                    waiting.popleft()
                    self.left_out += 1
            elif topic == "pose" and self._is_other(key[0]):
                self._others[key] = payloads[-1]
            elif topic in LATEST:
                self._latest[key] = payloads[-1]
        self._wake.set()

    def _is_other(self, probe: str) -> bool:
        """Whether another probe than this one is looked at."""
        return self._probe not in ("", probe, self._ids.get(probe, ""))

    def say(self, message: Mapping[str, Any]) -> None:
        """Something of the server's own, such as the answer to a command."""
        self._answers.append(_encode(message))
        self._wake.set()

    async def write(self, send: Send) -> None:
        """Sends what waits, at the rate of the screen, until it is cancelled."""
        loop = asyncio.get_running_loop()
        beating = asyncio.create_task(self._beat())
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                if self._is_behind() or not self._has_news():
                    continue
                early_s = self._sent_s + self._period_s - loop.time()
                # A timer costs as much as a message: a little early is on time.
                if early_s > SLACK * self._period_s:
                    await asyncio.sleep(early_s)
                self._sent_s = loop.time()
                await send(self._compose())
        finally:
            beating.cancel()

    def _is_behind(self) -> bool:
        return self._window is not None and self._sent - self._seen >= self._window

    async def _beat(self) -> None:
        """Has a head sent where nothing else was."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(HEARTBEAT_S if self._reads else STRANGER_S)
            if loop.time() - self._sent_s > 0.9 * HEARTBEAT_S:
                self._is_beat = True
                self._wake.set()

    def _has_news(self) -> bool:
        now_s = asyncio.get_running_loop().time()
        if self._others and now_s - self._others_s >= OTHERS_S:
            self._others_s = now_s
            self._latest |= self._others
            self._others.clear()
        return bool(self._latest or self._waiting or self._answers or self._is_beat)

    def _compose(self) -> bytes:
        self._sent += 1
        self._is_beat = False
        head = {
            "type": "head",
            "n": self._sent,
            "t_ms": time.time_ns() / 1e6,
            "left_out": self.left_out,
        }
        lines = [_encode(head), *self._answers]
        for waiting in self._waiting.values():
            lines += waiting
        lines += self._latest.values()
        self._answers.clear()
        self._waiting.clear()
        self._latest.clear()
        return b"\n".join(lines)
