# SPDX-License-Identifier: MIT
"""`imud run`: ports in, sinks out, commands back; one asyncio loop."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import math
import sys
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from imud.config.settings import Config, listens_on
from imud.daemon import names
from imud.daemon.command_runner import CommandRunner, Request
from imud.daemon.commands import Commander
from imud.daemon.configure import configured
from imud.daemon.hub import Hub
from imud.daemon.intake import Intake
from imud.daemon.metrics import DaemonCounts, MetricsServer
from imud.daemon.outputs import Outputs
from imud.daemon.params_history import HistoryFiles
from imud.daemon.registry import ProbeEntry
from imud.daemon.selector import GatheringSelector
from imud.daemon.status import STATUS_S
from imud.daemon.systemd import Notifier
from imud.endpoint import host_and_port
from imud.errors import ImudError, ListenFailed, described
from imud.journal.output import Journal, JournalStream, journal_on_stderr
from imud.log.marks import marks_in
from imud.machine import system
from imud.net.network import Keys, read_keys
from imud.net.queries import Answer
from imud.params.value import Params
from imud.ports.finder import Finder
from imud.probes.timeline import host_ns
from imud.serving import faults
from imud.stages import SendCommands
from imud.version import version
from imud.virtual.sim import running_links

logger = logging.getLogger("imud")


# How long a sink's thread may keep the interpreter while the loop waits for it: with
# many ports, reads come more often than in Python's default of 5 ms.
SWITCH_S = 0.0005

# A port of the metrics that was taken is tried again this often.
AGAIN_S = 5.0

# New objects before Python looks for garbage. It looks at all of them meanwhile, and
# refused connections leave rings of objects: 50,000 take 15 to 49 ms. With 2,000 a
# flood of such connections leaves a 99th percentile of poses of 2 to 4 ms, not 30.
GARBAGE_MIN = 2_000


class Daemon:
    """Connects ports, probes, commands and sinks. Runs in the thread of the loop."""

    def __init__(
        self,
        config: Config,
        load: Callable[[], Config],
        selector: GatheringSelector,
        stream: JournalStream,
    ) -> None:
        self._load = load
        self._stream = stream
        # For what may wait: a disk, a look-up of a name, a server that starts or ends.
        self._waiter = ThreadPoolExecutor(1, "imud-waiter")
        self._changing = asyncio.Lock()  # the settings; one after the other
        self._of_file = config
        self._config = config = names.with_names(config)
        self._selector = selector  # of the loop
        self._hub = Hub()
        self._journal = Journal(config.journal.quiet_s, config.journal.burst)
        self._outputs = Outputs(
            *(self._hub, self._on_command, self._on_notice),
            lambda name: self._registry.id_of(name),
        )
        self._intake = Intake(config, self._hub, self._journal)
        self._registry = self._intake.registry
        self._reports = self._intake.reports
        self._commander = Commander(self._registry)
        self._history = HistoryFiles(config.params.folder)
        self._runner = CommandRunner(
            *(self._commander, self._intake, self._history, self._configure),
            lambda port, seconds: self._finder.lend(port, seconds),
        )
        self._intake.params.keep = self._keep_params
        self._told: dict[str, str] = {}  # names by ids, of the probes' params
        self._intake.on_reply = self._commander.handle_reply
        self._intake.on_found = self._begin_set_up
        self._intake.on_gesture = self._begin_gesture
        self._intake.stages.on_commands = self._begin_commands
        self._tasks: set[asyncio.Task[None]] = set()
        self._setting_up: dict[str, asyncio.Task[None]] = {}
        self._notifier = Notifier()
        self._metrics: MetricsServer | None = None
        self._metrics_again_s = math.inf  # when a taken address is tried again
        self._finder = Finder(
            config.ports, self._intake, self._journal, simulated=running_links
        )

    async def run(self) -> None:
        """Serves until SIGTERM or SIGINT; raises the error of a task that failed."""
        loop = asyncio.get_running_loop()
        stop = asyncio.Event()
        system.on_signals(stop.set, self._begin_reload)
        loop.set_exception_handler(self._log_fault)
        self._loop = loop
        self._hub.has_turns = True
        self._selector.on_turn = self._hub.end_turn
        try:
            self._outputs.open(self._config)
            await self._serve_metrics()
            logger.info("%s", self._greeting())
            if self._config.log.enabled:
                self._start(self._recall(Path(self._config.log.dir)))
            # Objects made by now stay: a collection that includes them takes 25 ms.
            gc.freeze()
            gc.set_threshold(GARBAGE_MIN, *gc.get_threshold()[1:])
            self._notifier.ready()
            serving = [asyncio.create_task(self._finder.run())]
            serving.append(asyncio.create_task(self._watch()))
            serving.append(
                asyncio.create_task(self._commander.keep_time(self._intake.look))
            )
            stopping = asyncio.create_task(stop.wait())
            # None of these tasks should end: one that does has failed, and its error is
            # shown.
            await asyncio.wait(
                [stopping, *serving], return_when=asyncio.FIRST_COMPLETED
            )
            self._notifier.stopping()
            for task in (*serving, stopping, *self._tasks):
                task.cancel()
            results = await asyncio.gather(*serving, return_exceptions=True)
            ended = [r for r in results if isinstance(r, Exception)]
        finally:
            if self._metrics is not None:
                self._metrics.close()
            self._hub.close()
            self._history.close()
            self._waiter.shutdown(wait=False)
        logger.info("%s", self._closing_line())
        if ended:
            raise ended[0]

    def _on_notice(self, kind: object, text: str, is_warning: bool) -> None:
        """Called in a thread of Zenoh, which may outlive the loop."""
        with contextlib.suppress(RuntimeError):
            say = partial(self._journal.write, kind, text, is_warning=is_warning)
            self._loop.call_soon_threadsafe(say)

    def _on_command(
        self,
        name: str,
        command: str,
        parameters: dict[str, str],
        answer: Answer,
        by: str,
    ) -> None:
        """Called in a thread of Zenoh, which may outlive the loop, or of the page."""
        work = self._runner.answer(Request(name, command, parameters, by), answer)
        try:
            self._loop.call_soon_threadsafe(self._start, work)
        except RuntimeError:
            work.close()

    def _in_thread(self, call: Callable[..., Any], *arguments: Any) -> Awaitable[Any]:
        return self._loop.run_in_executor(self._waiter, call, *arguments)

    async def _serve_metrics(self) -> None:
        """Starts, moves or stops the server, as the configuration says."""
        address = host_and_port(self._config.metrics.listen)
        is_told, self._metrics_again_s = self._metrics_again_s < math.inf, math.inf
        before, self._metrics = self._metrics, None
        if before is not None:
            await self._in_thread(before.close)
        self._reports.on_status = lambda _: None
        self._reports.on_forgotten = lambda _: None
        if address is None:
            return
        server = MetricsServer(address)
        try:
            await self._in_thread(server.start)
        except ListenFailed as error:
            # Poses do not depend on it.
            self._metrics_again_s = self._loop.time() + AGAIN_S
            if not is_told:
                logger.warning("%s", error)
            return
        self._metrics = server
        self._reports.on_status = server.update
        self._reports.on_forgotten = server.forget

    async def _recall(self, logs: Path) -> None:
        """Takes up the marks in the latest logs."""
        self._intake.recall(await self._in_thread(marks_in, logs))

    def _begin_reload(self) -> None:
        self._start(self._reload())

    async def _reload(self) -> None:
        """SIGHUP: applies changed settings; a file with a mistake changes nothing."""
        async with self._changing:
            self._notifier.reloading()
            try:
                self._of_file = await self._in_thread(self._load)
                config = await self._in_thread(
                    names.with_names, self._of_file, self._told
                )
                keys = await self._in_thread(read_keys, config)
            except ImudError as error:
                logger.warning(
                    "reload failed, the current configuration stays active: %s", error
                )
            else:
                await self._apply(self._config, config, keys)
            self._notifier.ready()

    async def _apply(self, before: Config, config: Config, keys: Keys) -> None:
        self._config = config
        logger.setLevel(config.journal.level.upper())
        self._journal.configure(config.journal.quiet_s, config.journal.burst)
        renamed = self._registry.configure(config)
        put = {entry.name: entry.put for entry in self._registry}
        changed = ["keys"] if keys != self._outputs.keys else []
        self._outputs.keys = keys
        self._outputs.apply(config, renamed, put)
        # Presence last: who sees it may ask for the rest at once.
        self._intake.params.announce(self._intake.timeline.utc(host_ns()))
        self._intake.announce_marks()
        self._reports.announce()
        self._finder.configure(config.ports)
        self._history.configure(config.params.folder)
        for entry in self._registry:
            probe_id = entry.probe.probe_id
            is_other = config.settings_of(probe_id) != before.settings_of(probe_id)
            if is_other and entry.is_alive:
                self._begin_set_up(entry.name)
        if config.metrics != before.metrics:
            self._metrics_again_s = math.inf
            await self._serve_metrics()
        changed += [
            name
            for name in Config.__struct_fields__
            if getattr(config, name) != getattr(before, name)
        ]
        logger.info("reloaded: %s", ", ".join(changed) or "no change")

    async def _watch(self) -> None:
        """Once a second: looks for silent ports, publishes each probe's status."""
        loop = asyncio.get_running_loop()
        due = before = loop.time()
        while True:
            # After a pause it goes on from now.
            due = (due if loop.time() < due + STATUS_S else loop.time()) + STATUS_S
            await asyncio.sleep(due - loop.time())
            elapsed_s, before = loop.time() - before, loop.time()
            self._finder.check(host_ns())
            for _ in self._reports.tick(elapsed_s):
                await asyncio.sleep(0)
            for entry in self._intake.params.due(loop.time()):
                failure = "it does not send its params"
                order = SendCommands((("params_tell", {}),), failure)
                self._begin_commands(entry.name, order)
            for entry, records in self._intake.params.unplaced():
                self._place(entry, records)
            self._notifier.alive()
            self._notifier.status(self._state())
            if loop.time() >= self._metrics_again_s:
                self._start(self._serve_metrics())
            if self._metrics is not None:
                refused = self._hub.refused()
                if self._metrics.refused:
                    refused["metrics"] = dict(self._metrics.refused)
                self._metrics.update_counts(
                    DaemonCounts(
                        self._hub.failures(),
                        refused,
                        faults.count,
                        self._stream.dropped,
                    )
                )

    def _place(self, entry: ProbeEntry, records: bytes) -> None:
        """Sends a probe the Earth's field of its place, or asks the user for it."""
        text = (
            "set latitude_deg and longitude_deg in [place] of the configuration, so "
            "that it can tell the Earth's field from iron before it is calibrated"
        )
        if records:
            text = "is sent the Earth's field of its place"
            words = {"records": records.hex(), "probe": entry.probe.probe_id}
            order = SendCommands((("params", words),), "its place can't be activated")
            self._begin_commands(entry.name, order)
        self._journal.write(("place", entry.name), f"probe {entry.name}: {text}")

    def _start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)
        return task

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        fault = None if task.cancelled() else task.exception()
        if fault is not None:
            faults.count += 1
            logger.error("internal error: %s", described(fault))

    def _log_fault(self, _: object, context: dict[str, Any]) -> None:
        """An exception in a callback: one line, not the traceback of the loop."""
        faults.count += 1
        fault = context.get("exception")
        words = described(fault) if isinstance(fault, Exception) else context["message"]
        text = f"internal error: {words}"
        self._journal.write(("fault", words), text, is_warning=True)

    async def _configure(self, probe_id: str, parameters: Mapping[str, str]) -> bool:
        """Returns whether that is kept: what the file of settings has nothing for."""
        async with self._changing:
            before, is_kept = self._config, False
            after = configured(before, probe_id, parameters)
            of_file = self._of_file.settings_of(probe_id)
            for key, file, told in (
                ("rename", names.FILE, of_file.name),
                ("button", names.BUTTONS, of_file.button),
            ):
                if key in parameters and not told:
                    # First: a name that can't be kept is not given.
                    text, is_kept = parameters[key], True
                    await self._in_thread(names.keep, before, probe_id, text, file)
            await self._apply(before, after, self._outputs.keys)
            return is_kept

    def _keep_params(self, probe_id: str, params: Params, t_ns: int) -> None:
        self._history.keep(probe_id, params, t_ns)
        if params.name != self._told.get(probe_id, ""):
            self._told[probe_id] = params.name
            self._start(self._take_name(probe_id, params.name))

    async def _take_name(self, probe_id: str, name: str) -> None:
        """Calls a probe what it says, unless a user of this host has named it."""
        async with self._changing:
            given = await self._in_thread(names.with_names, self._of_file)
            before = self._config
            settings = before.settings_of(probe_id)
            if given.settings_of(probe_id).name or settings.name == name:
                return
            after = before.with_probe(probe_id, replace(settings, name=""))
            after = names.with_texts(after, {probe_id: name}, names.PARAMS)
            await self._apply(before, after, self._outputs.keys)

    def _begin_gesture(self, entry: ProbeEntry, action: str) -> None:
        if action not in ("none", "stroke"):  # the filter makes strokes
            self._start(self._runner.by_button(entry, action))

    def _begin_set_up(self, name: str) -> None:
        before = self._setting_up.get(name)
        if before is not None:
            before.cancel()  # it may wait for a reply from before a replug
        self._setting_up[name] = self._start(self._set_up(name))

    async def _set_up(self, name: str) -> None:
        """Applies a probe's own settings, whenever it appears or restarts."""
        try:
            entry = self._registry.named(name)
            if entry is not None:
                settings = self._config.settings_of(entry.probe.probe_id)
                await self._commander.set_up(name, settings)
        except ImudError as error:
            text = f"probe {name}: its settings can't be applied: {error}"
            self._journal.write(("settings", name), text, is_warning=True)

    def _begin_commands(self, name: str, order: SendCommands) -> None:
        self._start(self._send_commands(name, order))

    async def _send_commands(self, name: str, order: SendCommands) -> None:
        """Sends a probe the commands that one of its stages asks for."""
        try:
            for command, parameters in order.commands:
                await self._runner.run(Request(name, command, parameters, "daemon"))
        except ImudError as error:
            text = f"probe {name}: {order.failure}: {error}"
            self._journal.write((order.failure, name), text, is_warning=True)

    def _state(self) -> str:
        """A line for `systemctl status`."""
        alive = sum(entry.is_alive for entry in self._registry)
        rate_hz = sum(entry.pose_rate_hz for entry in self._registry)
        probes = "1 probe" if alive == 1 else f"{alive} probes"
        return f"{probes}, {rate_hz:.0f} poses a second"

    def _greeting(self) -> str:
        log = "writes no log"
        if self._outputs.is_logging:
            log = f"logs to {self._outputs.log_path or self._config.log.dir}"
        ports = self._config.ports
        named = f"reads {', '.join(ports.named)}" if ports.named else ""
        finds = "detects probes" if ports.find else ""
        takes = f"accepts datagrams on {ports.udp}" if ports.udp else ""
        reads = " and ".join(filter(None, (named, finds, takes)))
        network = self._config.zenoh
        listen = listens_on(network)
        where = f"listens on {', '.join(listen)}" if listen else ""
        joins = f"connects to {', '.join(network.connect)}" if network.connect else ""
        serves = " and ".join(filter(None, (where, joins)))
        return f"imud {version()} {serves}, {log}, {reads}"

    def _closing_line(self) -> str:
        is_logging, path = self._outputs.is_logging, self._outputs.log_path
        log = f"; log {path}" if is_logging else ""
        return f"stopped; {self._registry.closing_line()}{log}"


def run(load: Callable[[], Config]) -> int:
    """Runs until SIGTERM or SIGINT; `load` reads the configuration, again at each
    SIGHUP."""
    config = load()
    system.raise_files_limit()
    sys.setswitchinterval(SWITCH_S)
    selector = GatheringSelector()
    make_loop = partial(asyncio.SelectorEventLoop, selector)
    with (
        journal_on_stderr(config.journal.level) as stream,
        asyncio.Runner(loop_factory=make_loop) as runner,
    ):
        runner.run(Daemon(config, load, selector, stream).run())
    return 0
