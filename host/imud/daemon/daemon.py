# SPDX-License-Identifier: MIT
"""`imud run`: ports in, sinks out, commands back; one asyncio loop."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import signal
import sys
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from imud import journal
from imud.config.settings import Config, Zenoh, listens_on
from imud.daemon.commands import Commander
from imud.daemon.fleet import LOG, NETWORK, STATUS_S, Fleet, Want
from imud.daemon.hub import Hub
from imud.daemon.lane import Sink
from imud.daemon.metrics import Metrics
from imud.daemon.selector import GatheringSelector
from imud.daemon.systemd import Notifier
from imud.endpoint import host_and_port
from imud.errors import ImudError, described
from imud.journal.speaker import Speaker
from imud.log.file import Settings
from imud.net.network import own_credentials, tell_refusals
from imud.ports.finder import Finder
from imud.probes.timeline import host_ns
from imud.sinks.log import LogSink
from imud.sinks.ros2 import Ros2Sink, own_network
from imud.sinks.zenoh import Answer, ZenohSink
from imud.stages.twin import WantsRestart
from imud.version import version

logger = logging.getLogger("imud")


# The name of its sink; those of the others are in the status.
ROS2 = "ros2"

# How long a sink's thread may keep the interpreter while the loop waits for it: many
# ports are read more often than in Python's 5 ms.
SWITCH_S = 0.0005

# Objects that may come to be more before those are looked through that may be garbage:
# what waits for a sink is none.
GARBAGE_MIN = 50_000


@dataclass(frozen=True, slots=True)
class Wanted:
    """A sink, and what it is made of: another sink if that is another."""

    settings: object
    make: Callable[[], Sink]


class Daemon:
    """Wires ports to the hub. All of it runs in the loop's thread."""

    def __init__(
        self, config: Config, load: Callable[[], Config] | None = None
    ) -> None:
        self._config = config
        self._load = load or (lambda: config)
        self._hub = Hub()
        self._speaker = Speaker(config.journal.quiet_s, config.journal.burst)
        self._fleet = Fleet(config, self._hub, self._speaker)
        self._commander = Commander(self._fleet)
        self._fleet.on_reply = self._commander.take_reply
        self._fleet.on_want = self._begin_twin
        self._fleet.on_found = self._begin_set_up
        self._encoder = msgspec.json.Encoder()
        self._tasks: set[asyncio.Task[None]] = set()
        self._setting_up: dict[str, asyncio.Task[None]] = {}
        self._notifier = Notifier()
        self._metrics: Metrics | None = None
        self._kept: dict[str, object] = {}  # what each sink was made of
        self._log: LogSink | None = None
        self._is_told_of_refusals = False
        self._finder = Finder(config.ports, self._fleet, self._speaker)

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        stop = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, stop.set)
        loop.add_signal_handler(signal.SIGHUP, self._reload)

        loop.set_exception_handler(self._tell_fault)
        self._loop = loop
        self._hub.later = loop.call_soon
        try:
            for name, wanted in self._wanted(self._config).items():
                self._hub.add(wanted.make())
                self._kept[name] = wanted.settings
            self._serve_metrics()
            logger.info("%s", self._greeting())
            # What is there by now stays: to look through it for garbage takes 25 ms.
            gc.freeze()
            gc.set_threshold(GARBAGE_MIN, *gc.get_threshold()[1:])
            self._notifier.ready()
            serving = [asyncio.create_task(self._finder.run())]
            serving.append(asyncio.create_task(self._watch()))
            serving.append(asyncio.create_task(self._commander.keep_time()))
            stopping = asyncio.create_task(stop.wait())
            # A task of ours that ends is a fault of ours: let it be seen.
            await asyncio.wait(
                [stopping, *serving], return_when=asyncio.FIRST_COMPLETED
            )
            self._notifier.stopping()
            for task in (*serving, stopping, *self._tasks):
                task.cancel()
            results = await asyncio.gather(*serving, return_exceptions=True)
            faults = [r for r in results if isinstance(r, Exception)]
        finally:
            if self._metrics is not None:
                self._metrics.close()
            self._hub.close()
        logger.info("%s", self._farewell())
        if faults:
            raise faults[0]

    def _wanted(self, config: Config) -> dict[str, Wanted]:
        """The sinks that a configuration asks for; the first has to come up first."""
        network, log, ros2 = config.zenoh, config.log, config.ros2
        wanted = {NETWORK: Wanted(network, lambda: self._zenoh(network))}
        if log.enabled:
            settings = _log_settings(config)
            # All of the configuration is in a log, but most of it doesn't change it.
            of_log = (log, network.prefix, settings.unlogged)
            wanted[LOG] = Wanted(of_log, lambda: self._logger(log.dir, settings))
        if ros2.enabled:
            own = own_network(network.mode, network.listen, network.connect)
            wanted[ROS2] = Wanted(
                (ros2, own, network.keys, network.credentials),
                lambda: Ros2Sink(
                    ros2.connect or own,
                    ros2.domain,
                    ros2.namespace,
                    ros2.world_frame,
                    own_credentials(network, is_abroad=bool(ros2.connect)),
                ),
            )
        return wanted

    def _zenoh(self, network: Zenoh) -> ZenohSink:
        if network.keys and not self._is_told_of_refusals:
            self._is_told_of_refusals = True
            tell_refusals(lambda kind, text: self._on_notice(kind, text, True))
        return ZenohSink(network, self._on_command, self._on_notice)

    def _on_notice(self, kind: object, text: str, is_warning: bool) -> None:
        """In a thread of Zenoh's, which may outlive the loop."""
        with contextlib.suppress(RuntimeError):
            say = partial(self._speaker.say, kind, text, is_warning=is_warning)
            self._loop.call_soon_threadsafe(say)

    def _logger(self, directory: str, settings: Settings) -> LogSink:
        self._log = LogSink(Path(directory), settings)
        return self._log

    def _on_command(
        self, name: str, command: str, parameters: dict[str, str], answer: Answer
    ) -> None:
        """In a thread of Zenoh's, which may outlive the loop."""
        work = self._answer(name, command, parameters, answer)
        try:
            self._loop.call_soon_threadsafe(self._start, work)
        except RuntimeError:
            work.close()

    def _serve_metrics(self) -> None:
        """Where the configuration says, or no longer."""
        address = host_and_port(self._config.metrics.listen)
        if self._metrics is not None:
            self._metrics.close()
        self._metrics = None
        self._fleet.on_status = lambda _: None
        if address is not None:
            self._metrics = Metrics(*address)
            self._metrics.start()
            self._fleet.on_status = self._metrics.take

    def _reload(self) -> None:
        """SIGHUP: takes up what was changed; a file with a mistake changes nothing."""
        before = self._config
        self._notifier.reloading()
        try:
            config = self._load()
        except ImudError as error:
            logger.warning("not reloaded, all stays as it is: %s", error)
        else:
            self._take_up(before, config)
        self._notifier.ready()

    def _take_up(self, before: Config, config: Config) -> None:
        self._config = config
        logger.setLevel(config.journal.level.upper())
        self._speaker.configure(config.journal.quiet_s, config.journal.burst)
        names = self._fleet.configure(config)
        wanted = self._wanted(config)
        for name in self._kept.keys() - wanted.keys():
            self._hub.set(name, None)
            del self._kept[name]
        put = {watched.name: watched.put for watched in self._fleet}
        for name, want in wanted.items():
            # Keys and channels have the probes' names.
            if names or self._kept.get(name) != want.settings:
                self._hub.set(name, want.make(), names, put)
                self._kept[name] = want.settings
        if not config.log.enabled:
            self._log = None
        self._fleet.announce()
        self._finder.configure(config.ports)
        if config.metrics != before.metrics:
            try:
                self._serve_metrics()
            except ImudError as error:
                logger.warning("%s", error)
        for watched in self._fleet:
            probe_id = watched.probe.probe_id
            is_other = config.settings_of(probe_id) != before.settings_of(probe_id)
            if is_other and watched.is_alive:
                self._begin_set_up(watched.name)
        changed = [
            name
            for name in Config.__struct_fields__
            if getattr(config, name) != getattr(before, name)
        ]
        logger.info("reloaded: %s", ", ".join(changed) or "nothing was changed")

    async def _watch(self) -> None:
        """Once a second: what has not come, and the status of each probe."""
        loop = asyncio.get_running_loop()
        due = before = loop.time()
        while True:
            due = max(due + STATUS_S, loop.time())
            await asyncio.sleep(due - loop.time())
            elapsed_s, before = loop.time() - before, loop.time()
            self._finder.check(host_ns())
            for _ in self._fleet.tick(elapsed_s):
                await asyncio.sleep(0)
            self._notifier.alive()
            self._notifier.status(self._state())
            if self._metrics is not None:
                self._metrics.take_sinks(self._hub.failures())

    def _start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)
        return task

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        fault = None if task.cancelled() else task.exception()
        if fault is not None:
            logger.error("a fault of imud's own: %s", described(fault))

    def _tell_fault(self, _: object, context: dict[str, Any]) -> None:
        """What a callback of the loop raised: a line, and not the loop's traceback."""
        fault = context.get("exception")
        words = described(fault) if isinstance(fault, Exception) else context["message"]
        text = f"a fault of imud's own: {words}"
        self._speaker.say(("fault", words), text, is_warning=True)

    async def _answer(
        self, name: str, command: str, parameters: dict[str, str], answer: Answer
    ) -> None:
        try:
            value = await self._commander.command(name, command, parameters)
        except ImudError as error:
            answer(b"", str(error))
        else:
            reply = {"ok": True, "probe": name, "command": command, "value": value}
            answer(self._encoder.encode(reply), "")

    def _begin_set_up(self, name: str) -> None:
        before = self._setting_up.get(name)
        if before is not None:
            before.cancel()  # it may wait for an answer of before a replug
        self._setting_up[name] = self._start(self._set_up(name))

    async def _set_up(self, name: str) -> None:
        """Applies a probe's own settings, whenever it appears or restarts."""
        try:
            watched = self._fleet.named(name)
            if watched is not None:
                settings = self._config.settings_of(watched.probe.probe_id)
                await self._commander.set_up(name, settings)
        except ImudError as error:
            text = f"probe {name}: its settings can't be applied: {error}"
            self._speaker.say(("settings", name), text, is_warning=True)

    def _begin_twin(self, name: str, wants: Want) -> None:
        self._start(self._serve_twin(name, wants))

    async def _serve_twin(self, name: str, wants: Want) -> None:
        """Asks a probe for what its twin needs."""
        command = self._commander.command
        try:
            if isinstance(wants, WantsRestart):
                await command(name, "restart", {})
                return
            if wants.rate_hz is not None:
                await command(name, "rate", {"stream": "raw", "hz": str(wants.rate_hz)})
            await command(name, "fields", {"streams": "pose,raw"})
        except ImudError as error:
            text = f"probe {name}: its twin can't begin: {error}"
            self._speaker.say(("twin", name, "unserved"), text, is_warning=True)

    def _state(self) -> str:
        """A line for `systemctl status`."""
        alive = sum(watched.is_alive for watched in self._fleet)
        rate_hz = sum(watched.pose_rate_hz for watched in self._fleet)
        probes = "1 probe" if alive == 1 else f"{alive} probes"
        return f"{probes}, {rate_hz:.0f} poses a second"

    def _greeting(self) -> str:
        log = "keeps no log"
        if self._log is not None:
            log = f"logs to {self._log.path or self._config.log.dir}"
        named = ", ".join(self._config.ports.named)
        finds = "finds probes by itself" if self._config.ports.find else ""
        reads = " and ".join(filter(None, (named and f"reads {named}", finds)))
        network = self._config.zenoh
        listen = listens_on(network)
        where = f"listens on {', '.join(listen)}" if listen else ""
        joins = f"connects to {', '.join(network.connect)}" if network.connect else ""
        serves = " and ".join(filter(None, (where, joins)))
        return f"imud {version()} {serves}, {log}, {reads}"

    def _farewell(self) -> str:
        log = f"; log {self._log.path}" if self._log is not None else ""
        return f"stopped; {self._fleet.farewell()}{log}"


def _log_settings(config: Config) -> Settings:
    log = config.log
    return Settings(
        prefix=config.zenoh.prefix,
        rotate_bytes=log.rotate_mb * 10**6,
        rotate_s=log.rotate_minutes * 60,
        floor_bytes=log.floor_mb * 10**6,
        unlogged=frozenset(
            config.name_of(probe_id)
            for probe_id, probe in config.probes.items()
            if not probe.log
        ),
        has_foxglove=log.foxglove,
        configuration=msgspec.json.encode(config).decode(),
    )


def _loop() -> asyncio.AbstractEventLoop:
    return asyncio.SelectorEventLoop(GatheringSelector())


def run(load: Callable[[], Config]) -> int:
    """Runs until SIGTERM or SIGINT; `load` says what to do, again at each SIGHUP."""
    config = load()
    sys.setswitchinterval(SWITCH_S)
    handler = journal.handler()
    logger.addHandler(handler)
    logger.setLevel(config.journal.level.upper())
    try:
        with asyncio.Runner(loop_factory=_loop) as runner:
            runner.run(Daemon(config, load).run())
    finally:
        logger.removeHandler(handler)
    return 0
