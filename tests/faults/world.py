# SPDX-License-Identifier: MIT
"""A daemon in a world made of one seed: its clocks, ports, disk, network and stderr are
doubles, and time is a number. The same seed is the same day, to the microsecond.

The loop's selector moves the world: while the daemon waits, probes speak, bytes arrive,
and faults happen (faults.py).
"""

from __future__ import annotations

import asyncio
import gc
import heapq
import itertools
import logging
import os
import random
import secrets
import selectors
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import pytest

from fakes import FakeProbe
from imud.config.settings import Config, LogSettings, PortSettings, ProbeSettings
from imud.daemon import daemon, hub, lane
from imud.daemon.command_runner import Request
from imud.daemon.daemon import Daemon
from imud.errors import PortLost
from imud.journal.output import JournalStream, logger
from imud.machine import system
from imud.net import network
from imud.ports import port as ports
from imud.probes.timeline import host_ns
from imud.sinks import log, zenoh

S, MS = 1_000_000_000, 1_000_000
PROBES, SLOW_HZ, FAST_HZ = 8, 20, 200
BAUD = 921_600
BYTE_NS = 10 * S // BAUD
KERNEL = 4096  # bytes that a port keeps while nobody reads
RECOVERED_NS = 2 * S  # after a fault, until all is well again
LATE_NS = 50 * MS  # the loop may be kept from its ports by a fault of the daemon's
AGE_US = 20_000  # bounds of ages, when all is well
TURN_NS = 1000  # of the loop
MADE = 4096  # messages of which the true time is known

LOG = LogSettings(rotate_mb=1, keep_mb=3, keep_days=2.0)


class Pose(msgspec.Struct):
    probe: str
    seq: int
    age_us: int | None
    t_bound_us: int | None


class Inline:
    """A pool that does all at once, in the thread of its caller."""

    def __init__(self, *_: object) -> None:
        pass

    def submit(self, call: Callable[..., Any], *arguments: Any) -> Future[Any]:
        done: Future[Any] = Future()
        try:
            done.set_result(call(*arguments))
        except Exception as error:  # noqa: BLE001 - as a pool does
            done.set_exception(error)
        return done

    def shutdown(self, **_: object) -> None:
        pass


@dataclass
class Said:
    """Bytes of a probe, and when they were made and came, in true time."""

    data: bytes
    made_ns: int
    came_ns: int = 0


class Device:
    """A probe, the wire to its port, and when each of its messages was made."""

    def __init__(self, world: World, number: int) -> None:
        self.world = world
        self.path = f"/virtual/port{number}"
        self.probe = FakeProbe(probe_id=bytes([0xAB, number]) * 4)
        self.id = self.probe.name
        self.rate = 1 + world.chance.uniform(-200e-6, 200e-6)
        self.born_ns = world.now_ns - world.chance.randrange(4000 * S)
        self.made: dict[int, Said] = {}
        self.link: Link | None = None  # that has the port open
        self.is_plugged = True
        self.late_ns = 0  # of its bytes
        self.keeps = 0  # bytes that its port keeps while nobody reads
        self.old: list[Said] = []
        self.good_ns = 0  # when a pose came whose age was right
        self._spoke_ns = -1
        world.at(world.chance.randrange(S), self.pose)
        world.at(world.chance.randrange(S), self.hello)

    def restart(self) -> None:
        self.probe.restart()
        self.born_ns = self.world.now_ns
        self.made.clear()
        self.old.clear()
        self.hello(is_once=True)

    def skip(self, ns: int, kept: int) -> None:
        """Speaks for that time; a port keeps `kept` bytes of it, the rest is lost."""
        end_ns = self.world.now_ns + ns
        begin_ns = self.world.now_ns
        while kept > 0 and self.world.now_ns < end_ns:
            self.old.append(self._say("pose"))
            kept -= len(self.old[-1].data)
            self.world.now_ns += S // SLOW_HZ
        lost = (end_ns - self.world.now_ns) * SLOW_HZ // S
        self.world.now_ns = begin_ns
        self.probe.sequence += max(0, lost)

    def pose(self) -> None:
        self.world.at(S // self.world.hz, self.pose)
        self.send(self._say("pose"))

    def hello(self, *, is_once: bool = False) -> None:
        if not is_once:
            self.world.at(S, self.hello)
        self.send(self._say("hello"))
        counters = {"messages_sent": self.probe.sequence + 1, "messages_dropped": 0}
        self.send(self._say("status", **counters))

    def _say(self, name: str, **fields: Any) -> Said:
        self._stamp()
        first = self.probe.sequence
        return self._made(first, self.probe.say(name, **fields))

    def _made(self, first: int, data: bytes) -> Said:
        said = Said(data, self.world.now_ns)
        for number in range(first, self.probe.sequence):
            self.made[number % MADE] = said
        return said

    def _stamp(self) -> None:
        device_us = int((self.world.now_ns - self.born_ns) * self.rate / 1000)
        self.probe.time_us = device_us & 0xFFFFFFFF

    def hear(self, data: bytes) -> None:
        self._stamp()
        first = self.probe.sequence
        self.send(self._made(first, self.probe.hear(data)))

    def send(self, said: Said) -> None:
        world = self.world
        late_ns = world.chance.randrange(2 * MS)
        late_ns += world.chance.randrange(self.late_ns + 1)
        arrives_ns = world.now_ns + len(said.data) * BYTE_NS + late_ns
        self._spoke_ns = max(self._spoke_ns, arrives_ns)  # in their order
        world.at(self._spoke_ns - world.now_ns, lambda: self.arrive(said))

    def arrive(self, said: Said) -> None:
        said.came_ns = self.world.now_ns
        if self.link is not None and self.is_plugged:
            self.link.on_data(said.data, host_ns())
        elif self.keeps > 0:
            self.old.append(said)
            self.keeps -= len(said.data)

    def give_old(self) -> None:
        old, self.old, self.keeps = self.old, [], 0
        for said in old:
            self.arrive(said)

    def unplug(self, keeps: int = 0) -> None:
        self.is_plugged, self.keeps = False, keeps
        if self.link is not None:
            self.link.hang_up()


class Link:
    """The double of imud.ports.link.Link."""

    world: World

    def __init__(self, port: str, baud: int, **callbacks: Any) -> None:
        self.baud = baud
        self._device = next(d for d in self.world.devices if d.path == port)
        self.on_data = callbacks["on_data"]
        self._callbacks = callbacks
        self._lost: asyncio.Future[None] | None = None

    @property
    def is_open(self) -> bool:
        return self._device.link is self

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    async def run(self) -> None:
        try:
            while True:
                while not self._device.is_plugged:
                    await asyncio.sleep(0.15)
                self._lost = asyncio.get_running_loop().create_future()
                self._device.link = self
                self._callbacks["on_open"]()
                self._device.give_old()
                await self._lost
                self._device.link = None
                self._callbacks["on_fault"](PortLost(f"{self._device.path} is gone"))
        finally:
            self._device.link = None

    def hang_up(self) -> None:
        if self._lost is not None and not self._lost.done():
            self._lost.set_result(None)

    def write(self, data: bytes) -> None:
        late_ns = len(data) * BYTE_NS + self.world.chance.randrange(MS)
        self.world.at(late_ns, lambda: self._device.hear(data))


class SteppedLane(lane.Lane):
    """A lane without a thread: the world hands its records over."""

    world: World

    def start(self) -> None:
        self.sink.open()
        self._begin()

    def follow(self, before: Any, names: Any, put: Any) -> None:
        self._names, self._broken_until = names, 0.0
        if before is None:
            self._mine.earlier.update(put)
        else:
            before.close(0.0)
            self._mine = self._mine.after(before._counts(), names)
        self._begin()

    def _begin(self) -> None:
        self.world.lanes.append(self)

    def put(self, *items: lane.Item) -> None:
        self._wait_in_line(items)
        if self.sink.period_s == 0:
            self.pump()

    def pump(self) -> None:
        self._in_hand = items = self._next()
        self._hand_over(items)
        self._in_hand = ()

    def end(self) -> None:
        pass

    def close(self, timeout_s: float) -> bool:  # noqa: ARG002
        if self in self.world.lanes:
            self.world.lanes.remove(self)
            self.pump()
            self._attempt(self.sink.close)
        return True


class Publisher:
    """A publisher of a topic, and whoever listens to it."""

    def __init__(self, world: World, key: str) -> None:
        self._world, self._of, self._topic = world, *key.split("/")[-2:]

    def put(self, payload: bytes, **_: object) -> None:
        if self._world.is_router_down:
            raise OSError("the router is gone")
        if self._topic == "pose":
            self._world.judge(self._of, payload)
        elif self._topic == "status":
            ledger = msgspec.json.decode(payload)["ledger"]
            self._world.differs[self._of] = ledger["differs"]

    def undeclare(self) -> None:
        pass


class Network:
    """A session of Zenoh that does nothing else."""

    def __getattr__(self, _: str) -> Any:
        return lambda *_args, **_named: self

    @property
    def info(self) -> Any:
        return self


class Console(JournalStream):
    """A stderr that at times nobody reads."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.is_read = threading.Event()
        self.is_read.set()
        super().__init__(-1)

    def _put(self, data: bytes) -> None:  # noqa: ARG002
        self.is_read.wait()


class World(selectors.DefaultSelector):
    """All that is around a daemon."""

    def __init__(self, seed: int, folder: Path, fast_hz: int = FAST_HZ) -> None:
        """`fast_hz`: poses a second around each fault."""
        super().__init__()
        self.fast_hz = fast_hz
        self.chance = random.Random(seed)  # noqa: S311 - to be repeated
        self.folder = folder
        self.now_ns = 1_000_000 * S  # true time, which nobody can read
        self.slept_ns = 5 * S
        self.paused_ns = 0  # what no clock counts
        self.utc_off_ns = 1_800_000_000 * S
        self.hz = SLOW_HZ
        self.free_bytes = 1 << 40
        self.is_router_down = False
        self.console = Console(self)
        self.failures: list[str] = []
        self.judged = 0
        self.lanes: list[SteppedLane] = []
        self.on_turn: Callable[[], object] = lambda: None
        self._events: list[tuple[int, int, Callable[[], object]]] = []
        self._order = itertools.count()
        self.loop: Any = None
        self.drawn: list[str] = []
        self._left_ns = self.now_ns  # when the daemon began to run
        self._is_over = self._is_killed = False
        self._ending: asyncio.Event | None = None
        self.config = Config(
            ports=PortSettings(
                named=tuple(f"/virtual/port{n}@{BAUD}" for n in range(PROBES)),
                find=False,
                memory=str(folder / "ports.json"),
            ),
            log=msgspec.structs.replace(LOG, dir=str(folder / "logs")),
            web=msgspec.structs.replace(Config().web, enabled=False),
        )
        self.began: dict[str, int] = {}  # logs, and the true time of their begin
        self.sizes: dict[str, int] = {}
        self.stop: Callable[[], None] = lambda: None
        self.devices = [Device(self, number) for number in range(PROBES)]
        self.heard: dict[str, int] = {}  # when a subscriber by id got a pose
        self.differs: dict[str, list[str]] = {}  # in the ledgers, as last published
        self.at(100 * MS, self._pump)

    # Its life

    def run(self, patch: pytest.MonkeyPatch) -> None:
        """Until end() is called, one daemon after another lives in it."""
        self.install(patch)
        self.loop = asyncio.SelectorEventLoop(self)
        threshold = gc.get_threshold()
        lines = logging.StreamHandler(self.console)
        logger.addHandler(lines)
        try:
            while not self._is_over:
                self.loop.run_until_complete(self._live())
        finally:
            self.loop.close()
            logger.removeHandler(lines)
            self.console.is_read.set()
            gc.unfreeze()
            gc.set_threshold(*threshold)

    async def _live(self) -> None:
        self._is_killed, self._ending = False, asyncio.Event()
        selector: Any = self
        self._daemon = Daemon(self.config, lambda: self.config, selector, self.console)
        living = asyncio.create_task(self._daemon.run())
        ending = asyncio.create_task(self._ending.wait())
        await asyncio.wait([living, ending], return_when=asyncio.FIRST_COMPLETED)
        ending.cancel()
        if self._is_killed:
            for each in self.lanes:
                if (file := getattr(each.sink, "_log", None)) is not None:
                    file.close()
            self.lanes.clear()
            for task in asyncio.all_tasks() - {asyncio.current_task()}:
                task.cancel()
        elif self._is_over:
            self.stop()
        results = await asyncio.gather(living, return_exceptions=True)
        if isinstance(results[0], Exception):
            raise results[0]
        self.on_turn = lambda: None

    def kill(self) -> None:
        self._is_killed = True
        if self._ending is not None:
            self._ending.set()

    def end(self) -> None:
        self._is_over = True
        if self._ending is not None:
            self._ending.set()

    def rename(self, device: Device, name: str) -> None:
        """As `imud name` does."""
        renaming = (self.name_of(device.id), "configure", {"rename": name}, "it")
        work = self._daemon._runner.run(Request(*renaming))
        self._renaming = self.loop.create_task(work)
        self.config = self.config.with_probe(device.id, ProbeSettings(name=name))

    # Its clocks

    def read(self, which: int) -> int:
        is_still = which in (time.CLOCK_MONOTONIC, time.CLOCK_MONOTONIC_RAW)
        return self.now_ns - self.paused_ns - (self.slept_ns if is_still else 0)

    def utc_ns(self) -> int:
        return self.now_ns - self.paused_ns + self.utc_off_ns

    def install(self, patch: pytest.MonkeyPatch) -> None:
        real_gmtime = time.gmtime
        still = time.CLOCK_MONOTONIC
        patch.setattr(time, "clock_gettime_ns", self.read)
        patch.setattr(time, "monotonic", lambda: self.read(still) / 1e9)
        patch.setattr(time, "monotonic_ns", lambda: self.read(still))
        patch.setattr(time, "time_ns", self.utc_ns)
        patch.setattr(time, "time", lambda: self.utc_ns() / 1e9)
        patch.setattr(
            time,
            "gmtime",
            lambda s=None: real_gmtime(self.utc_ns() // S if s is None else s),
        )
        patch.setattr(system.host_clock_ns, "_slept_ns", self.slept_ns)
        patch.setattr(random, "SystemRandom", lambda: self.chance)
        patch.setattr(secrets, "randbelow", self.chance.randrange)
        patch.setattr(system, "free_bytes", lambda *_: self.free_bytes)
        patch.setattr(system, "sync", lambda _: None)
        patch.setattr(system, "on_signals", lambda stop, _: setattr(self, "stop", stop))
        for module in (log, daemon):
            patch.setattr(module, "ThreadPoolExecutor", Inline)
        patch.setattr(hub, "_lane", type("_", (SteppedLane,), {"world": self}))
        patch.setattr(ports, "Link", type("_", (Link,), {"world": self}))
        patch.setattr(network, "open_guarded", lambda *_: (Network(), None))
        patch.setattr(
            zenoh, "declare_publisher", lambda _session, key, _: Publisher(self, key)
        )

    # Its time

    def at(self, after_ns: int, call: Callable[[], object]) -> None:
        event = self.now_ns + after_ns, next(self._order), call
        heapq.heappush(self._events, event)

    def pass_by(self, ns: int) -> None:
        """Lets time pass in which nothing happens that is to come."""
        self.now_ns = self._left_ns = self.now_ns + ns
        self._events = [(at + ns, n, call) for at, n, call in self._events]

    def _mind_lateness(self) -> None:
        kept_ns = self.now_ns - self._left_ns
        if kept_ns > LATE_NS:
            self.fail(f"the loop was kept for {kept_ns / S:.1f} s")

    def select(self, timeout: float | None = None) -> list[Any]:
        self.on_turn()
        self._mind_lateness()
        self.now_ns += TURN_NS
        still = time.CLOCK_MONOTONIC
        due_ns = self.read(still) + int(S * (1 if timeout is None else timeout)) + 1
        while not self.loop._ready and self.read(still) < due_ns:
            left_ns = due_ns - self.read(still)
            if not self._events or self._events[0][0] > self.now_ns + left_ns:
                self.now_ns += left_ns
                break
            at_ns, _, call = heapq.heappop(self._events)
            self.now_ns = max(self.now_ns, at_ns)
            self._left_ns = self.now_ns
            call()
            self._mind_lateness()
        self._left_ns = self.now_ns
        return super().select(0)

    # Its disk

    def _pump(self) -> None:
        self.at(100 * MS, self._pump)
        for each in [one for one in self.lanes if one.sink.period_s > 0]:
            each.pump()
            path = getattr(each.sink, "path", None)
            if path is not None and path.exists():
                os.utime(path, ns=(self.utc_ns(), self.utc_ns()))
                self.began.setdefault(path.name, self.now_ns)
        self.look_at_logs()

    def look_at_logs(self) -> None:
        """What was removed was the oldest, and had to be."""
        there = {path.name: path.stat().st_size for path in self.logs()}
        removed = self.sizes.keys() - there.keys()
        if removed:
            newest = max(removed, key=lambda name: self.began[name])
            began_ns = self.began[newest]
            if any(began_ns > self.began.get(each, began_ns) for each in there):
                self.fail(f"{newest} was removed before an older log")
            is_young = self.now_ns - began_ns < LOG.keep_days * 86_400 * S
            kept_bytes = sum(there.values()) + self.sizes[newest]
            if is_young and kept_bytes < LOG.keep_mb * 1_000_000:
                self.fail(f"{newest} was removed, and had room")
        self.sizes = there

    def logs(self) -> list[Path]:
        return list((self.folder / "logs").glob("*.mcap"))

    def check(self) -> None:
        """All is well again, some time after a fault."""
        for device in self.devices:
            if device.is_plugged and self.now_ns - device.good_ns > S:
                self.fail(f"{device.id}: no pose with its true age for 1 s")
            if device.is_plugged and self.now_ns - self.heard.get(device.id, 0) > S:
                self.fail(f"{device.id}: nothing for who subscribed to its id")
        if wrong := {of: what for of, what in self.differs.items() if what}:
            self.fail(f"the ledgers do not add up: {wrong}")
        kept = sum(path.stat().st_size for path in self.logs())
        if kept > (LOG.keep_mb + 2 * LOG.rotate_mb) * 1_000_000:
            self.fail(f"{kept} bytes of logs are kept")

    # What is true

    def judge(self, of: str, payload: bytes) -> None:
        """A pose that somebody gets who subscribed to a name or an id."""
        device = next((d for d in self.devices if d.id in of), None)
        if device is None:
            return
        self.heard[device.id] = self.now_ns
        self.judged += 1
        pose = msgspec.json.decode(payload, type=Pose)
        said = device.made.get(pose.seq % MADE)
        if pose.age_us is None or said is None:
            if pose.age_us is None and pose.t_bound_us is not None:
                self.fail(f"{pose.probe}: a bound and no age")
            return
        error_us = abs(pose.age_us - (said.came_ns - said.made_ns) / 1000)
        if pose.age_us < 0:
            self.fail(f"{pose.probe}: age {pose.age_us} us")
        if pose.t_bound_us is None or error_us > pose.t_bound_us + 200:
            self.fail(
                f"{pose.probe}: age {pose.age_us} us is {error_us:.0f} us off, bound "
                f"{pose.t_bound_us}"
            )
        elif error_us < AGE_US:
            device.good_ns = self.now_ns

    def name_of(self, probe_id: str) -> str:
        return self.config.name_of(probe_id)

    def fail(self, text: str) -> None:
        self.failures.append(f"at {self.now_ns / S:.3f} s: {text}")
