# SPDX-License-Identifier: MIT
"""Poses as typed objects, in order, with an account of those that did not come.

`for pose in subscribe(): ...`, or `async for`. docs/subscribe.md says what is counted.
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

from imud.client.client import Client, Heard
from imud.defaults import ENDPOINT, PREFIX
from imud.errors import ConfigError, ImudError
from imud.probes.record import euler_deg

# Messages that may wait for this program: 30 s of one probe at 200 Hz.
WAITING_MAX = 6000

Topic = Literal["pose", "raw", "event", "status"]
Vector = tuple[float, float, float]


class _Numbered(msgspec.Struct, frozen=True, kw_only=True):
    """What every message of a probe carries."""

    probe: str  # its name in keys
    seq: int  # its number among all messages of the probe
    number: int  # its number among those of its kind, without gaps
    missing: int  # messages of the probe lost on its wire since the last of its kind
    t_device_us: int
    t_ns: int | None = None  # UTC: when what it says was so
    t_bound_us: int | None = None  # that is right to this, 99 times of 100
    age_us: int | None = None  # of its sample, when the daemon had read it


class Pose(_Numbered, frozen=True, kw_only=True):
    """Where the probe points; docs/pose.md has the frames."""

    q: tuple[float, float, float, float]  # w x y z, of the world from the body
    position_m: Vector | None
    normal: Vector | None
    tilt_sigma_deg: float | None
    heading_sigma_deg: float | None
    flags: tuple[str, ...]

    @property
    def yaw_pitch_roll_deg(self) -> Vector:
        """Yaw from east to north, pitch and roll: docs/angles.md."""
        return euler_deg(list(self.q))


class Raw(_Numbered, frozen=True, kw_only=True):
    """One sample, in the axes of the body."""

    acc_m_s2: Vector | None
    gyr_rad_s: Vector | None
    mag_uT: Vector | None  # noqa: N815 - the unit's own spelling
    temperature_c: float | None
    acc_counts: tuple[int, int, int]
    gyr_counts: tuple[int, int, int]
    mag_counts: tuple[int, int, int] | None
    flags: tuple[str, ...]


class Event(_Numbered, frozen=True, kw_only=True):
    """Something happened at the probe."""

    event: str
    cause: str
    detail: int


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """What the daemon says of a probe, once a second."""

    probe: str
    probe_id: str
    state: str
    port: str | None
    t_ns: int
    pose_rate_hz: float
    quality: dict[str, Any]
    ledger: dict[str, Any]
    link: dict[str, Any] | None = None
    clock: dict[str, Any] = {}
    counters: dict[str, Any] = {}
    equipment: dict[str, Any] | None = None
    hello: dict[str, Any] = {}


Message = Pose | Raw | Event | Status
_KINDS: dict[str, type[Message]] = {
    "pose": Pose,
    "raw": Raw,
    "event": Event,
    "status": Status,
}
T = TypeVar("T", bound=Message)


class Missed(msgspec.Struct, frozen=True):
    """What did not come, and where it was lost."""

    wire: int = 0  # between probe and daemon, of any kind, as messages that came tell
    network: int = 0  # published, and not come here
    queue: int = 0  # came here, and this program did not take it in time
    unreadable: int = 0  # came here, and is no message of imud's
    daemon_restarts: int = 0  # what was published just before one is not in `network`

    @property
    def total(self) -> int:
        return self.wire + self.network + self.queue + self.unreadable


@dataclass(slots=True)
class _Series:
    """The numbers of one kind of message of one probe."""

    last: int | None = None
    source: str = ""
    wire: int = 0
    network: int = 0
    queue: int = 0
    unreadable: int = 0
    restarts: int = 0

    def take(self, message: _Numbered, source: str) -> bool:
        """Counts what is missing before it; False: it came before."""
        last, self.source, source_before = self.last, source, self.source
        if last is None:
            self.last = message.number
            return True
        if source != source_before or (not source and message.number <= last):
            # Another daemon counts from 1: what it said while nobody listened is lost.
            self.restarts += 1
            last = 0
        if message.number <= last:
            return False
        self.network += message.number - last - 1
        self.wire += message.missing
        self.last = message.number
        return True

    def missed(self) -> Missed:
        return Missed(
            self.wire, self.network, self.queue, self.unreadable, self.restarts
        )


@dataclass(slots=True)
class _Queue:
    """What waits for the program, and who waits for it."""

    waiting: deque[tuple[_Series, Message]] = field(default_factory=deque)
    wake: threading.Condition = field(default_factory=threading.Condition)
    on_wake: Callable[[], object] | None = None
    is_closed: bool = False


class Subscription(Generic[T]):
    """An iterator and an asynchronous one over what comes. Close it, or use `with`."""

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
        self._series: dict[tuple[str, str], _Series] = {}
        self._queue = _Queue()
        for topic in topics:
            decoder = msgspec.json.Decoder(_KINDS[topic])
            kept = history if topic == "pose" else 0
            try:
                client.listen(topic, probe, self._keeper(topic, decoder), history=kept)
            except ImudError:
                client.close()
                raise

    @property
    def endpoint(self) -> str:
        """Where the daemon is."""
        return self._client.endpoint

    @property
    def missed(self) -> Missed:
        """What did not come so far, of all probes and topics."""
        with self._queue.wake:
            parts = {key: series.missed() for key, series in self._series.items()}
        # Each topic of a probe tells of losses on one wire: the most that one knew.
        wire: dict[str, int] = {}
        for (probe, _), part in parts.items():
            wire[probe] = max(wire.get(probe, 0), part.wire)
        return Missed(
            sum(wire.values()),
            sum(part.network for part in parts.values()),
            sum(part.queue for part in parts.values()),
            sum(part.unreadable for part in parts.values()),
            max((part.daemon_restarts for part in parts.values()), default=0),
        )

    def missed_of(self, probe: str, topic: Topic = "pose") -> Missed:
        """What did not come so far of one kind of one probe's messages."""
        with self._queue.wake:
            series = self._series.get((probe, topic))
            return series.missed() if series is not None else Missed()

    @property
    def is_connected(self) -> bool:
        """False while the daemon is away; it is connected to again when it is back."""
        return self._client.is_connected

    def close(self) -> None:
        """Ends the iteration, also that of another thread."""
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
        # Zenoh waits for its callbacks, and one may wait for this loop's thread.
        await asyncio.to_thread(self.close)

    def __iter__(self) -> Self:
        return self

    def last_statuses(self) -> list[Status]:
        """What the daemon said last of each probe, to begin with."""
        return [msgspec.convert(said, Status) for said in self._client.statuses()]

    def get(self, timeout_s: float) -> T | None:
        """The next, or None where none comes in that time."""
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
        self, topic: str, decoder: msgspec.json.Decoder[Message]
    ) -> Callable[[Heard], None]:
        """Counts and queues what comes on a topic; called in a thread of Zenoh's."""

        def keep(heard: Heard) -> None:
            with self._queue.wake:
                series = self._series.setdefault((heard.probe, topic), _Series())
                try:
                    message = decoder.decode(heard.payload)
                except msgspec.MsgspecError:
                    series.unreadable += 1
                    return
                if isinstance(message, _Numbered) and not series.take(
                    message, heard.source
                ):
                    return
                waiting = self._queue.waiting
                if len(waiting) >= self._waiting_max:
                    oldest, _ = waiting.popleft()
                    oldest.queue += 1
                waiting.append((series, message))
                self._rouse()

        return keep

    def _rouse(self) -> None:
        self._queue.wake.notify_all()
        on_wake, self._queue.on_wake = self._queue.on_wake, None
        if on_wake is not None:
            with contextlib.suppress(RuntimeError):  # its loop has ended
                on_wake()

    def _is_due(self) -> bool:
        return bool(self._queue.waiting) or self._queue.is_closed

    def _pop(self) -> T | None:
        """The oldest that waits. None after the end, whatever waits then."""
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
) -> Subscription[Message]: ...


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
    """What a probe says, or all probes, as it comes: for some time or for ever.

    `history` poses of each probe from before come first, as far as the daemon kept
    them. `keys` is the file that `imud keys add` made for who subscribes.
    """
    unknown = [topic for topic in topics if topic not in _KINDS]
    if unknown or not topics:
        raise ConfigError(
            f"topics are {', '.join(_KINDS)}, not {', '.join(unknown) or 'none'}"
        )
    if waiting_max < 1 or history < 0:
        raise ConfigError("waiting_max is 1 at least, history not below 0")
    return Subscription(
        Client(endpoint, prefix, keys),
        probe,
        tuple(dict.fromkeys(topics)),
        history=history,
        seconds=seconds,
        waiting_max=waiting_max,
    )
