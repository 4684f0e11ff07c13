# SPDX-License-Identifier: MIT
"""subscribe(): poses as typed objects, in order, with counts of what was missed.

`for pose in subscribe(): ...`, or `async for`: docs/subscribe.md.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Literal, Self, TypeVar, cast, overload

import msgspec

from imud.client.client import Client, Delivery
from imud.client.missed import Followed, Missed, Series
from imud.client.published import KINDS, Pose, Published, Status, Topic
from imud.defaults import ENDPOINT, PREFIX
from imud.errors import ConfigError, ImudError
from imud.published import Numbered

# How many messages may wait for this program: 30 s of one probe at 200 Hz.
WAITING_MAX = 6000

T = TypeVar("T", bound=Published)


@dataclass(slots=True)
class _Queue:
    """The messages that wait for the program, and what wakes it."""

    waiting: deque[tuple[Series, Published]] = field(default_factory=deque)
    wake: threading.Condition = field(default_factory=threading.Condition)
    on_wake: Callable[[], object] | None = None
    is_closed: bool = False


class Subscription(Generic[T]):
    """An iterator and an asynchronous iterator over the messages of some topics.

    Close it, or use `with`.
    """

    def __init__(
        self,
        client: Client,
        probe: str | None,
        topics: Sequence[str],
        *,
        history: int,
        seconds: float | None,
        waiting_max: int,
    ) -> None:
        self._client = client
        self._waiting_max = waiting_max
        self._until_s = None if seconds is None else time.monotonic() + seconds
        self._series = Followed(probe)
        self._queue = _Queue()
        for topic in topics:
            decoder = msgspec.json.Decoder(KINDS[topic])
            kept = history if topic == "pose" else 0
            try:
                client.listen(topic, probe, self._keeper(topic, decoder), history=kept)
            except ImudError:
                client.close()
                raise

    @property
    def endpoint(self) -> str:
        """The Zenoh endpoint of the daemon."""
        return self._client.endpoint

    @property
    def missed(self) -> Missed:
        """Messages missed so far, of all probes and topics."""
        with self._queue.wake:
            return self._series.missed()

    def missed_of(self, probe: str, topic: Topic = "pose") -> Missed:
        """Messages missed so far, of one topic of one probe."""
        with self._queue.wake:
            series = self._series.known(probe, topic)
            return series.missed() if series is not None else Missed()

    @property
    def is_connected(self) -> bool:
        """False while the daemon is away; Zenoh reconnects when it is back."""
        return self._client.is_connected

    def close(self) -> None:
        """Ends the iteration, also in another thread."""
        with self._queue.wake:
            is_first, self._queue.is_closed = not self._queue.is_closed, True
            self._rouse()
        if is_first:
            self._client.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        # Zenoh waits for its callbacks, which may wait for the thread of this loop.
        await asyncio.to_thread(self.close)

    def __iter__(self) -> Self:
        return self

    def last_statuses(self) -> list[Status]:
        """The last status of each probe, for a start before new ones arrive."""
        return [msgspec.convert(each, Status) for each in self._client.statuses()]

    def get(self, timeout_s: float) -> T | None:
        """The next message, or None if none arrives in that time."""
        queue = self._queue
        with queue.wake:
            queue.wake.wait_for(self._is_due, timeout_s)
            return self._pop()

    def __next__(self) -> T:
        queue = self._queue
        with queue.wake:
            queue.wake.wait_for(self._is_due, self._left_s())
            message = self._pop()
        if message is None:
            self.close()
            raise StopIteration
        return message

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> T:
        loop = asyncio.get_running_loop()
        roused = asyncio.Event()
        queue = self._queue
        while True:
            with queue.wake:
                message, is_over = self._pop(), queue.is_closed
                if message is not None:
                    return message
                queue.on_wake = lambda: loop.call_soon_threadsafe(roused.set)
            left_s = self._left_s()
            if is_over or (left_s is not None and left_s <= 0):
                await asyncio.to_thread(self.close)
                raise StopAsyncIteration
            try:
                await asyncio.wait_for(roused.wait(), left_s)
            except TimeoutError:
                continue
            roused.clear()

    def _keeper(
        self, topic: str, decoder: msgspec.json.Decoder[Published]
    ) -> Callable[[Delivery], None]:
        """A callback, in a thread of Zenoh's, that counts and queues a topic."""

        def keep(delivery: Delivery) -> None:
            with self._queue.wake:
                series = self._series.of(delivery.probe, delivery.probe_id, topic)
                try:
                    message = decoder.decode(delivery.payload)
                except msgspec.MsgspecError:
                    series.unreadable += 1
                    return
                if isinstance(message, Numbered) and not series.count(
                    message, delivery.source
                ):
                    return
                if isinstance(message, Status):
                    self._tell(message, delivery.source)
                waiting = self._queue.waiting
                if len(waiting) >= self._waiting_max:
                    oldest, _ = waiting.popleft()
                    oldest.queue += 1
                waiting.append((series, message))
                self._rouse()

        return keep

    def _tell(self, status: Status, source: str) -> None:
        """A status says how many poses there were, also if none comes after a loss."""
        poses = self._series.known(status.probe_id, "pose")
        number = status.quality.get("number")
        if poses is not None and number is not None:
            poses.tell(number, source)

    def _rouse(self) -> None:
        self._queue.wake.notify_all()
        on_wake, self._queue.on_wake = self._queue.on_wake, None
        if on_wake is not None:
            with contextlib.suppress(RuntimeError):  # its loop has ended
                on_wake()

    def _is_due(self) -> bool:
        return bool(self._queue.waiting) or self._queue.is_closed

    def _pop(self) -> T | None:
        """The oldest message in the queue, or None. After the end always None."""
        left_s = self._left_s()
        is_over = self._queue.is_closed or (left_s is not None and left_s <= 0)
        if is_over or not self._queue.waiting:
            return None
        _, message = self._queue.waiting.popleft()
        return cast(T, message)

    def _left_s(self) -> float | None:
        if self._until_s is None:
            return None
        return max(0.0, self._until_s - time.monotonic())


@overload
def subscribe(
    probe: str | None = None,
    *,
    topics: tuple[Literal["pose"]] = ("pose",),
    endpoint: str = ENDPOINT,
    prefix: str = PREFIX,
    keys: str | Path | None = None,
    history: int = 0,
    seconds: float | None = None,
    waiting_max: int = WAITING_MAX,
) -> Subscription[Pose]: ...


@overload
def subscribe(
    probe: str | None = None,
    *,
    topics: Sequence[Topic],
    endpoint: str = ENDPOINT,
    prefix: str = PREFIX,
    keys: str | Path | None = None,
    history: int = 0,
    seconds: float | None = None,
    waiting_max: int = WAITING_MAX,
) -> Subscription[Published]: ...


def subscribe(
    probe: str | None = None,
    *,
    topics: Sequence[Topic] = ("pose",),
    endpoint: str = ENDPOINT,
    prefix: str = PREFIX,
    keys: str | Path | None = None,
    history: int = 0,
    seconds: float | None = None,
    waiting_max: int = WAITING_MAX,
) -> Subscription[Any]:
    """The messages of one probe, or of all, as they arrive: for some seconds or for
    ever.

    `history` earlier poses of each probe come first, as far as the daemon kept them.
    `keys` is the file that `imud keys` made for you. DaemonNotFound if no daemon is at
    `endpoint`, NotAllowed if the keys do not allow a topic.
    """
    unknown = [topic for topic in topics if topic not in KINDS]
    if unknown or not topics:
        raise ConfigError(
            f"topics are {', '.join(KINDS)}, not {', '.join(unknown) or 'none'}"
        )
    if waiting_max < 1 or history < 0:
        raise ConfigError("waiting_max must be at least 1, history at least 0")
    return Subscription(
        Client(endpoint, prefix, keys),
        probe,
        tuple(dict.fromkeys(topics)),
        history=history,
        seconds=seconds,
        waiting_max=waiting_max,
    )
