# SPDX-License-Identifier: MIT
"""Runs outputs: each in a thread, with a subscription of its own, so that one that is
slow loses only its own messages, which are counted.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import signal
import threading
import time
from collections.abc import Sequence

import msgspec

from imud.bridge.output import AWAY, Output
from imud.client import Body, Event, Mark, Pose, Status, Subscription, subscribe
from imud.client.published import Published
from imud.config.settings import Config
from imud.journal.output import journal_on_stderr

TICK_S = 1.0
TELL_S = 10.0  # at least between two lines about messages that are missing

logger = logging.getLogger("imud")


class Pace:
    """Lets through so many poses of each probe a second."""

    def __init__(self, rate_hz: float) -> None:
        self._period_s = 1.0 / rate_hz if rate_hz else 0.0
        self._due_s: dict[str, float] = {}

    def is_due(self, probe: str, now_s: float) -> bool:
        due_s = self._due_s.get(probe, now_s)
        if now_s < due_s:
            return False
        # On its beat; after a pause from now on.
        next_s = due_s + self._period_s
        self._due_s[probe] = next_s if next_s > now_s else now_s + self._period_s
        return True


class Runner:
    """One output."""

    def __init__(
        self, name: str, output: Output, subscription: Subscription[Published]
    ) -> None:
        self.name = name
        self._output = output
        self._subscription = subscription
        self._pace = Pace(output.rate_hz)
        self._statuses: dict[str, Status] = {}
        self._missed = 0
        self._told_s = 0.0
        self.sent = 0
        self.fault: BaseException | None = None

    def run(self, stop: threading.Event) -> None:
        """Until `stop`; sets it where the output has a fault."""
        try:
            for status in self._subscription.last_statuses():
                self.take(status, time.monotonic())
            next_s = time.monotonic()
            while not stop.is_set():
                now_s = time.monotonic()
                if now_s >= next_s:
                    next_s = max(next_s + TICK_S, now_s)
                    self._tick(now_s)
                message = self._subscription.get(max(0.0, min(next_s - now_s, 0.2)))
                if message is not None:
                    self.take(message, time.monotonic())
        except BaseException as fault:  # noqa: BLE001 - raised again in the main thread
            self.fault = fault
            stop.set()

    def take(self, message: Published, now_s: float) -> None:
        output = self._output
        match message:
            case Pose():
                if self._pace.is_due(message.probe, now_s):
                    output.pose(message)
                    self.sent += 1
            case Status():
                self._statuses[message.probe_id] = message
                output.status(message)
            case Event():
                output.event(message)
            case Mark():
                output.mark(message)
            case Body():
                if self._pace.is_due(f"body {message.body}", now_s):
                    output.body(message)

    def _tick(self, now_s: float) -> None:
        if not self._subscription.is_connected:
            for status in self._statuses.values():
                away = msgspec.structs.replace(status, state=AWAY, t_ns=time.time_ns())
                self._output.status(away)
        self._output.tick()
        missed = self._subscription.missed.total
        if missed > self._missed and now_s >= self._told_s + TELL_S:
            more, self._missed = missed - self._missed, missed
            self._told_s = now_s
            logger.warning("%s: %d messages missed", self.name, more)

    def summary(self) -> str:
        missed = self._subscription.missed
        return f"{self.name}: {self.sent} poses sent, {missed.total} messages missed"


def opened(name: str, config: Config) -> Output:
    """`osc` is OscOutput of osc.py, with its section of the settings. ConfigError
    without its library, or for a setting that can't be.
    """
    module = importlib.import_module(f"imud.bridge.{name}")
    made: Output = getattr(module, f"{name.capitalize()}Output")(getattr(config, name))
    return made


def run(names: Sequence[str], config: Config, seconds: float | None) -> int:
    """Until SIGTERM, SIGINT or for some seconds; returns 0."""
    with journal_on_stderr(config.journal.level):
        return _run(names, config, seconds)


def _run(names: Sequence[str], config: Config, seconds: float | None) -> int:
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    source = config.bridge
    with contextlib.ExitStack() as stack:
        runners, threads = [], []
        for name in names:
            output = opened(name, config)
            stack.callback(output.close)
            told: Subscription[Published] = subscribe(
                topics=output.topics,
                endpoint=source.connect,
                prefix=config.zenoh.prefix,
                keys=source.keys or None,
            )
            runners.append(Runner(name, output, stack.enter_context(told)))
        for runner in runners:
            thread = threading.Thread(target=runner.run, args=(stop,), name=runner.name)
            threads.append(thread)
            thread.start()
        logger.info("%s: from %s", ", ".join(names), source.connect)
        stop.wait(seconds)
        stop.set()
        for thread in threads:
            thread.join()
    for runner in runners:
        if runner.fault is not None:
            raise runner.fault
        logger.info(runner.summary())
    return 0
