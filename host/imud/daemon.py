# SPDX-License-Identifier: MIT
"""`imud run`: ports in, sinks out, commands back; one asyncio loop."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import signal
import sys
import time
from collections import Counter, deque
from collections.abc import Coroutine, Mapping
from pathlib import Path
from typing import Any

import msgspec

from imud import messages, schema
from imud.config import Config
from imud.errors import (
    CommandRefused,
    DeviceError,
    ImudError,
    LinkError,
    NoReply,
    PortLost,
    ProbeUnknown,
    VersionMismatch,
)
from imud.frame import encode_frame
from imud.hub import Hub
from imud.ledger import Verdict
from imud.link import Link
from imud.messages import Message
from imud.record import Presence, Record, equipment_of, plain, record_of
from imud.session import (
    Event,
    OnlyNoise,
    OtherSchema,
    Probe,
    ProbeFound,
    Received,
    Refused,
    Session,
    Silent,
)
from imud.sinks.log import LogSink
from imud.sinks.zenoh import Answer, ZenohSink
from imud.twin import Began, Differs, Lost, Twin, WantsRaw, WantsRestart
from imud.version import version

STATUS_S = 1.0

# A probe answers a command within milliseconds; three tries outlast a burst of noise.
REPLY_TIMEOUT_S = 1.0
TRIES = 3

# Of one kind of line about one thing so many are written in so many seconds; the rest
# is counted.
BURST = 3
QUIET_S = 10.0

# Arguments of the command `tare`, as the schema says.
TARE = {"all": 0, "heading": 1, "undo": 2}
STREAMS = {"pose": 0, "raw": 1}
FILTERS = {each.name.lower(): each.value for each in schema.Filter if each}

FAULTS = frozenset(
    {
        "bus_fault",
        "overrun",
        "calibration_refused",
        "sensor_fault",
        "settings_restored",
        "settings_failed",
        "clock_failed",
        "card_fault",
        "card_full",
        "battery_low",
        "going_to_sleep",
        "radio_dropped",
        "radio_fault",
    }
)

# What the detail of an event is; where it is none of these, a bare number.
DETAILS = {
    "calibration_done": "{} samples",
    "calibration_refused": "{} counts of motion",
    "overrun": "{} missed",
    "card_ready": "at block {}",
    "card_fault": "at block {}",
    "card_full": "at block {}",
    "log_started": "recording {}",
    "log_ended": "recording {}",
    "battery_low": "{} mV",
    "going_to_sleep": "{} mV",
}
# Of a clock that failed; it goes on by the spare one.
CLOCK_FAILED = ("at its start", "while it ran")

# Causes of a reset that leave the address at which it struck.
WITH_ADDRESS = frozenset({"hard_fault", "watchdog"})

logger = logging.getLogger("imud")


class Limiter:
    """Lets a few lines of a kind through in a while and counts the others."""

    def __init__(self, quiet_s: float = QUIET_S, burst: int = BURST) -> None:
        self._quiet_s = quiet_s
        self._burst = burst
        self._spoken_s: dict[object, deque[float]] = {}
        self._withheld: Counter[object] = Counter()

    def allow(self, kind: object, now_s: float) -> str | None:
        """What to add to the line, or None to withhold it."""
        spoken = self._spoken_s.setdefault(kind, deque())
        while spoken and now_s - spoken[0] >= self._quiet_s:
            spoken.popleft()
        if len(spoken) >= self._burst:
            self._withheld[kind] += 1
            return None
        spoken.append(now_s)
        withheld = self._withheld.pop(kind, 0)
        return f" (and {withheld} like it before)" if withheld else ""


def port_problem(port: str, event: OnlyNoise | Silent | OtherSchema, baud: int) -> str:
    """The line about a port on which no probe of ours speaks."""
    if isinstance(event, OnlyNoise):
        return (
            f"{port}: {event.count} bytes and no message among them; "
            f"is it a probe, at {baud} baud?"
        )
    if isinstance(event, Silent):
        return f"{port}: nothing heard for {event.seconds:.0f} s; is the probe alive?"
    return (
        f"{port}: probe {event.probe_id} speaks schema {event.fingerprint:#010x} "
        f"(firmware {event.firmware}), this imud speaks {schema.FINGERPRINT:#010x}: "
        "update one of them"
    )


def who(hello: Message) -> str:
    """What a probe says of itself, for people."""
    fields = {name: plain(value) for name, value in hello.fields.items()}
    rates = ", ".join(
        f"{label} {fields[name]} Hz" if fields[name] else f"{label} off"
        for label, name in (
            ("samples", "sample_rate"),
            ("pose", "pose_rate"),
            ("raw", "raw_rate"),
        )
    )
    has_sensor = fields["sensor"] != "none"
    runs = f"{fields['sensor']}, {rates}, filter {fields['filter']}"
    sensor = runs if has_sensor else "no sensor yet"
    cause = ", ".join(
        f"{name} at {fields['reset_address']:#010x}"
        if name in WITH_ADDRESS and fields["reset_address"]
        else name
        for name in fields["reset_cause"]
    ).replace("_", " ")
    return (
        f"{fields['board']}, firmware {fields['firmware']}, {sensor}, "
        f"boot {fields['boot_count']} ({cause or 'no cause known'})"
    )


def event_words(name: str, cause: str, detail: int) -> str:
    """An event for people: what, why, and the number that belongs to it."""
    what = name.replace("_", " ")
    why = "" if cause == "none" else f" ({cause.replace('_', ' ')})"
    if name == "clock_failed":
        return f"{what}{why}, {CLOCK_FAILED[detail != 0]}"
    if detail == 0:
        return f"{what}{why}"
    return f"{what}{why}, {DETAILS.get(name, '{}').format(detail)}"


def arguments_of(name: str, parameters: Mapping[str, str]) -> tuple[int, int]:
    """The two numbers of a command; CommandRefused where they can't be."""
    known = {
        "tare": {"what"},
        "rate": {"stream", "hz"},
        "fields": {"streams"},
        "restart": {"filter"},
    }
    unknown = parameters.keys() - known.get(name, set())
    if unknown:
        raise CommandRefused(f"{name} knows no {', '.join(sorted(unknown))}")
    try:
        if name == "tare":
            return TARE[parameters.get("what", "all")], 0
        if name == "rate":
            return STREAMS[parameters["stream"]], int(parameters["hz"])
        if name == "fields":
            streams = [part for part in parameters["streams"].split(",") if part]
            return sum(1 << STREAMS[stream] for stream in set(streams)), 0
        if name == "restart" and "filter" in parameters:
            return FILTERS[parameters["filter"]], 0
    except (KeyError, ValueError) as error:
        needs = {
            "tare": "what=all, heading or undo",
            "rate": "stream=pose or raw, and hz=a number",
            "fields": "streams=pose,raw or one of them",
            "restart": f"filter={', '.join(FILTERS)}, or nothing",
        }
        raise CommandRefused(f"{name} needs {needs[name]}") from error
    return 0, 0


def _twin(watched: _Watched) -> dict[str, Any]:
    """How the twin of a probe does."""
    twin = watched.twin
    return {
        "state": twin.state.value if twin is not None else "off",
        "compared": twin.compared if twin is not None else 0,
        "differed": twin.differed if twin is not None else 0,
        "lost": watched.twin_lost,
        "first_difference": watched.first_difference,
    }


class _Port:
    """One port of the daemon: its link and the session of its present opening."""

    def __init__(self, daemon: Daemon, name: str, baud: int) -> None:
        self.name = name
        self._daemon = daemon
        self.baud = baud
        self._fault: type[LinkError] | None = None
        self.session: Session | None = None
        self.link = Link(
            name,
            baud,
            on_open=self._opened,
            on_data=self._heard,
            on_fault=self._failed,
        )

    @property
    def probe(self) -> Probe | None:
        return self.session.probe if self.session is not None else None

    def send(self, name: str, token: int, arguments: tuple[int, int]) -> None:
        fields = {"command": name, "token": token, "arguments": arguments}
        time_us = time.monotonic_ns() // 1000
        content = messages.encode("command", fields, self._daemon.next(), time_us)
        # A delimiter first: it ends whatever half frame the probe may hold.
        self.link.write(b"\0" + encode_frame(content))

    def check(self, t_ns: int) -> None:
        if self.session is not None:
            self._tell(self.session.check(t_ns))

    def end(self) -> None:
        session, self.session = self.session, None
        if session is None:
            return
        self._tell(session.close())
        self._daemon.port_ended(session, self)

    def _opened(self) -> None:
        if self._fault is not None:
            self._daemon.say(("open", self.name), f"{self.name}: open")
        self._fault = None
        self.session = Session(self._daemon.probe, time.time_ns())
        # Says at once who is there, instead of within a second. A port that is lost
        # again already is the reader's to find and to tell.
        with contextlib.suppress(PortLost):
            self.send("hello", self._daemon.token(), (0, 0))

    def _heard(self, data: bytes, t_ns: int) -> None:
        if self.session is not None:
            self._tell(self.session.receive(data, t_ns))

    def _failed(self, error: LinkError) -> None:
        self.end()
        # A port that vanished is then not there: that was said already.
        is_known = self._fault is not None and (
            type(error) is self._fault or self._fault is PortLost
        )
        if not is_known:
            kind = ("fault", self.name, type(error))
            self._daemon.say(kind, str(error), is_warning=True)
            self._fault = type(error)

    def _tell(self, events: list[Event]) -> None:
        for event in events:
            if isinstance(event, OtherSchema):
                self._daemon.take_other(event, self)
            elif isinstance(event, OnlyNoise | Silent):
                text = port_problem(self.name, event, self.baud)
                kind = ("problem", self.name, type(event))
                self._daemon.say(kind, text, is_warning=True)
            else:
                self._daemon.take(event, self)


class _Watched:
    """What the daemon keeps of one probe beside its account."""

    def __init__(self, probe: Probe, name: str, *, has_twin: bool) -> None:
        self.probe = probe
        self.name = name
        self.twin = Twin() if has_twin else None
        self.twin_lost: dict[str, Any] | None = None
        self.first_difference: dict[str, Any] | None = None
        self.port: _Port | None = None
        self.other: OtherSchema | None = None  # why it can't be read
        self.is_alive = False
        self.told_who = ""
        self.counters: dict[str, Any] = {}
        self.equipment: dict[str, Any] | None = None  # a board may have none
        self.pose: dict[str, Any] = {}
        self.poses = 0
        self.poses_before = 0
        self.pose_rate_hz = 0.0
        self.last_heard_ns = 0
        self.t_device_us = 0
        self.corrupt_before = 0
        self.told: tuple[int, int, int, int] = (0, 0, 0, 0)
        self.commanding = asyncio.Lock()


class Daemon:
    """Wires ports to the hub. All of it runs in the loop's thread."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._hub = Hub()
        self._encoder = msgspec.json.Encoder()
        self._probes: dict[str, _Watched] = {}
        self._names: dict[str, _Watched] = {}
        self._limiter = Limiter()
        self._told_others: set[tuple[object, ...]] = set()
        self._sequence = 0
        # At random: a probe does not carry out a token twice in a row, and may have
        # heard the last one from the daemon before this one.
        self._token = secrets.randbelow(0xFFFF)
        self._replies: dict[int, asyncio.Future[Message]] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._log = (
            LogSink(Path(config.log.dir), config.prefix) if config.log.enabled else None
        )
        self._ports = [
            _Port(self, name, baud) for name, baud in config.ports_and_bauds()
        ]

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        stop = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, stop.set)

        def on_command(
            name: str, command: str, parameters: dict[str, str], answer: Answer
        ) -> None:
            loop.call_soon_threadsafe(
                self._start_command, name, command, parameters, answer
            )

        zenoh = ZenohSink(self._config.listen, self._config.prefix, on_command)
        try:
            self._hub.add(zenoh)
            if self._log is not None:
                self._hub.add(self._log)
            logger.info("%s", self._greeting())
            serving = [asyncio.create_task(port.link.run()) for port in self._ports]
            serving.append(asyncio.create_task(self._watch()))
            stopping = asyncio.create_task(stop.wait())
            # A task of ours that ends is a fault of ours: let it be seen.
            await asyncio.wait(
                [stopping, *serving], return_when=asyncio.FIRST_COMPLETED
            )
            for task in (*serving, stopping, *self._tasks):
                task.cancel()
            results = await asyncio.gather(*serving, return_exceptions=True)
            for port in self._ports:
                port.end()
            faults = [r for r in results if isinstance(r, Exception)]
        finally:
            self._hub.close()
        logger.info("%s", self._farewell())
        if faults:
            raise faults[0]

    def next(self) -> int:
        self._sequence += 1
        return self._sequence

    def token(self) -> int:
        self._token = self._token % 0xFFFF + 1
        return self._token

    def probe(self, probe_id: str) -> Probe:
        watched = self._probes.get(probe_id)
        if watched is None:
            name = self._config.names.get(probe_id, probe_id)
            watched = _Watched(Probe(probe_id), name, has_twin=self._config.twin)
            self._probes[probe_id] = self._names[name] = watched
        return watched.probe

    def port_ended(self, session: Session, port: _Port) -> None:
        for watched in self._probes.values():
            if watched.port is port:
                watched.corrupt_before += session.corrupt.total()
                watched.port = None
                self._set_alive(watched, is_alive=False)
                self._publish_status(watched)

    def take_other(self, event: OtherSchema, port: _Port) -> None:
        self.probe(event.probe_id)
        watched = self._probes[event.probe_id]
        watched.port = port
        watched.other = event
        # Said once for each build of its firmware, however often its port is opened.
        kind = ("schema", event.probe_id, event.firmware, event.fingerprint)
        if kind not in self._told_others:
            self._told_others.add(kind)
            logger.warning("%s", port_problem(port.name, event, port.baud))

    def take(self, event: Event, port: _Port) -> None:
        if isinstance(event, ProbeFound):
            self._found(event, port)
        elif isinstance(event, Received):
            self._received(event)
        elif isinstance(event, Refused):
            self._refused(event)

    def _found(self, event: ProbeFound, port: _Port) -> None:
        watched = self._probes[event.probe_id]
        if watched.port is not None and watched.port is not port:
            self.say(
                ("twice", event.probe_id),
                f"probe {watched.name} is on {watched.port.name} and on {port.name}; "
                "are there two with one id?",
                is_warning=True,
            )
        watched.port = port
        watched.other = None
        watched.told_who = who(event.hello)
        if watched.twin is not None:
            watched.twin.appear()
        what = "restarted" if event.is_restart else "found"
        text = f"probe {watched.name} {what} on {port.name}: {watched.told_who}"
        self.say(("found", event.probe_id, what), text, is_warning=event.is_restart)
        self._set_alive(watched, is_alive=True)
        self._publish_status(watched)

    def _received(self, event: Received) -> None:
        watched = self._probes[event.probe.probe_id]
        message = event.message
        t_ns = event.t_ns or time.time_ns()
        watched.last_heard_ns = t_ns
        watched.t_device_us = event.t_device_us
        record, described = record_of(
            message,
            event.content,
            watched.name,
            event.t_device_us,
            t_ns,
            event.probe.hello,
            event.probe.hello_content,
        )
        self._hub.put(record)
        if message.name == "pose":
            watched.poses += 1
            watched.pose = described
        if message.name == "status":
            watched.counters = dict(message.fields)
        elif message.name == "equipment":
            watched.equipment = equipment_of(message.fields)
        elif message.name == "event":
            self._tell_event(watched, message)
        elif message.name == "reply":
            self._take_reply(message)
        elif message.name == "hello" and who(message) != watched.told_who:
            watched.told_who = who(message)
            text = f"probe {watched.name} is {watched.told_who}"
            self.say(("who", watched.name), text)
        if not watched.is_alive:
            self._set_alive(watched, is_alive=True)
        if watched.twin is not None:
            self._compare(watched, watched.twin, event, t_ns)

    def _compare(
        self, watched: _Watched, twin: Twin, event: Received, t_ns: int
    ) -> None:
        """What the twin makes of a message."""
        state = twin.state
        outcome = twin.take(event.message, event.content)
        name = watched.name
        place = {
            "seq": event.message.sequence,
            "t_device_us": event.t_device_us,
            "t_ns": t_ns,
        }
        if isinstance(outcome, WantsRaw | WantsRestart):
            self._start(self._serve_twin(name, outcome))
        elif isinstance(outcome, Began):
            watched.twin_lost = None
            self.say(
                ("twin", name, Began),
                f"probe {name}: its twin follows from #{outcome.sequence} on",
            )
        elif isinstance(outcome, Lost):
            watched.twin_lost = place | {
                "seq": outcome.sequence,
                "reason": outcome.reason,
            }
            self.say(
                ("twin", name, Lost),
                f"probe {name}: its twin can't follow from #{outcome.sequence} on: "
                f"{outcome.reason}; imud restart begins anew",
                is_warning=True,
            )
        elif isinstance(outcome, Differs) and outcome.is_first:
            if watched.first_difference is None:
                watched.first_difference = place | {
                    "fields": outcome.fields,
                    "probe": outcome.probe.hex(),
                    "twin": outcome.twin.hex(),
                }
            self.say(
                ("twin", name, Differs),
                f"probe {name}: pose #{outcome.sequence} is not what its samples give: "
                f"{', '.join(outcome.fields)} differ",
                is_warning=True,
            )
        if twin.state is not state:
            described = {"type": "twin", "probe": name, **place, **_twin(watched)}
            payload = self._encoder.encode(described)
            self._hub.put(
                Record(name, "twin", payload, b"", event.message.sequence, t_ns)
            )

    async def _serve_twin(self, name: str, wants: WantsRaw | WantsRestart) -> None:
        """Asks a probe for what its twin needs."""
        try:
            if isinstance(wants, WantsRestart):
                await self.command(name, "restart", {})
                return
            if wants.rate_hz is not None:
                rate = {"stream": "raw", "hz": str(wants.rate_hz)}
                await self.command(name, "rate", rate)
            await self.command(name, "fields", {"streams": "pose,raw"})
        except ImudError as error:
            text = f"probe {name}: its twin can't begin: {error}"
            self.say(("twin", name, "unserved"), text, is_warning=True)

    def _refused(self, event: Refused) -> None:
        watched = self._probes[event.probe_id]
        if event.skew is not None:
            self.say(
                ("skew", event.probe_id, event.skew.kind),
                f"probe {watched.name}: skewed message ({event.skew.kind}): "
                f"{event.skew.detail}",
                is_warning=True,
            )
        elif event.verdict is not Verdict.DUPLICATE:
            self.say(
                ("stray", event.probe_id),
                f"probe {watched.name}: a message out of its order is left out",
                is_warning=True,
            )

    def _tell_event(self, watched: _Watched, message: Message) -> None:
        fields = {name: plain(value) for name, value in message.fields.items()}
        name, cause = str(fields["event"]), str(fields["cause"])
        words = event_words(name, cause, int(fields["detail"]))
        text = f"probe {watched.name}: {words}"
        self.say(("event", watched.name, name, cause), text, is_warning=name in FAULTS)

    def say(self, kind: object, text: str, *, is_warning: bool = False) -> None:
        more = self._limiter.allow(kind, time.monotonic())
        if more is not None:
            level = logging.WARNING if is_warning else logging.INFO
            logger.log(level, "%s%s", text, more)

    def _set_alive(self, watched: _Watched, *, is_alive: bool) -> None:
        if watched.is_alive != is_alive:
            watched.is_alive = is_alive
            self._hub.put(Presence(watched.name, is_alive))

    async def _watch(self) -> None:
        """Once a second: what has not come, and the status of each probe."""
        loop = asyncio.get_running_loop()
        due = before = loop.time()
        while True:
            due = max(due + STATUS_S, loop.time())
            await asyncio.sleep(due - loop.time())
            elapsed, before = loop.time() - before, loop.time()
            t_ns = time.time_ns()
            for port in self._ports:
                port.check(t_ns)
            for watched in self._probes.values():
                poses = watched.poses - watched.poses_before
                watched.poses_before = watched.poses
                watched.pose_rate_hz = poses / elapsed
                self._publish_status(watched)
                self._tell_losses(watched)

    def _corrupt(self, watched: _Watched) -> int:
        session = watched.port.session if watched.port is not None else None
        return watched.corrupt_before + (session.corrupt.total() if session else 0)

    def _tell_losses(self, watched: _Watched) -> None:
        counts: Any = watched.probe.account.counts()
        earlier = counts["earlier_boots"]
        told = (
            counts["lost"] + earlier["lost"],
            self._corrupt(watched),
            counts["duplicated"] + earlier["duplicated"],
            sum(self._hub.dropped(watched.name).values()),
        )
        fresh = [now - then for now, then in zip(told, watched.told, strict=True)]
        words = ("lost", "corrupt", "duplicated", "dropped by a slow or failing sink")
        text = ", ".join(
            f"{n} {word}" for n, word in zip(fresh, words, strict=True) if n > 0
        )
        kind = ("losses", watched.name)
        if text and self._limiter.allow(kind, time.monotonic()) is not None:
            logger.warning("probe %s: %s", watched.name, text)
            watched.told = told

    def _publish_status(self, watched: _Watched) -> None:
        t_ns = time.time_ns()
        probe = watched.probe
        hello = probe.hello
        if watched.other is not None:
            hello = dict(watched.other.hello.fields)
        port = watched.port
        session = port.session if port is not None else None
        state = watched.counters.get("state", "unknown")
        is_heard = t_ns - watched.last_heard_ns < 3 * STATUS_S * 1e9
        if port is None:
            state = "gone"
        elif watched.other is not None:
            state = "other schema"
        elif not is_heard:
            state = "silent"
        status = {
            "type": "status",
            "probe": watched.name,
            "probe_id": probe.probe_id,
            "t_ns": t_ns,
            "state": state,
            "port": port.name if port is not None else None,
            "pose_rate_hz": round(watched.pose_rate_hz, 1),
            "quality": {
                key: watched.pose.get(key)
                for key in ("tilt_sigma_deg", "heading_sigma_deg", "flags")
            },
            "ledger": {
                **probe.account.counts(),
                "corrupt": self._corrupt(watched),
                "published": self._hub.taken(watched.name, ZenohSink.name),
                "logged": self._hub.taken(watched.name, LogSink.name),
                "dropped": self._hub.dropped(watched.name),
            },
            "link": session.counts() if session is not None else None,
            "clock": {
                "t_device_us": watched.t_device_us,
                "t_ns": watched.last_heard_ns,
            },
            "twin": _twin(watched),
            "counters": watched.counters,
            "equipment": watched.equipment,
            "hello": {name: plain(value) for name, value in hello.items()},
            "imud": version(),
        }
        payload = self._encoder.encode(status)
        self._hub.put(Record(watched.name, "status", payload, b"", 0, t_ns))

    def _start_command(
        self, name: str, command: str, parameters: dict[str, str], answer: Answer
    ) -> None:
        self._start(self._answer(name, command, parameters, answer))

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _answer(
        self, name: str, command: str, parameters: dict[str, str], answer: Answer
    ) -> None:
        try:
            value = await self.command(name, command, parameters)
        except ImudError as error:
            answer(b"", str(error))
        else:
            reply = {"ok": True, "probe": name, "command": command, "value": value}
            answer(self._encoder.encode(reply), "")

    async def command(
        self, name: str, command: str, parameters: Mapping[str, str]
    ) -> Any:
        """Sends a command until it is answered; DeviceError says why it was not."""
        watched = self._names.get(name)
        if watched is None:
            raise ProbeUnknown(f"no probe {name} was heard; imud list shows them")
        if watched.other is not None:
            raise VersionMismatch(
                f"probe {name} speaks another schema (firmware "
                f"{watched.other.firmware}); update it or imud"
            )
        known = {member.name.lower() for member in schema.Command}
        if command not in known:
            raise CommandRefused(
                f"there is no command {command!r}, only {', '.join(sorted(known))}"
            )
        arguments = arguments_of(command, parameters)
        async with watched.commanding:
            token = self.token()
            reply = asyncio.get_running_loop().create_future()
            self._replies[token] = reply
            try:
                message = await self._ask(watched, command, token, arguments, reply)
            finally:
                del self._replies[token]
        result = message.fields["result"]
        if result == "bad_argument" and "filter" in parameters:
            raise CommandRefused(
                f"probe {name} has no filter {parameters['filter']}: its firmware was "
                f"built without it and runs {plain(watched.probe.hello['filter'])}"
            )
        if result != "ok":
            raise CommandRefused(
                f"probe {name} refused {command}: {str(result).replace('_', ' ')}"
            )
        return message.fields["value"]

    async def _ask(
        self,
        watched: _Watched,
        command: str,
        token: int,
        arguments: tuple[int, int],
        reply: asyncio.Future[Message],
    ) -> Message:
        for _ in range(TRIES):
            if watched.port is None:
                raise ProbeUnknown(f"probe {watched.name} is gone; plug it in")
            try:
                watched.port.send(command, token, arguments)
            except PortLost as error:
                raise DeviceError(str(error)) from error
            except ValueError as error:
                raise CommandRefused(str(error)) from error
            done, _ = await asyncio.wait([reply], timeout=REPLY_TIMEOUT_S)
            if done:
                return reply.result()
        raise NoReply(
            f"probe {watched.name} did not answer {command}, {TRIES} times; "
            "is it alive? imud list"
        )

    def _take_reply(self, message: Message) -> None:
        token = message.fields["replied_token"]
        reply = self._replies.get(token) if isinstance(token, int) else None
        if reply is not None and not reply.done():
            reply.set_result(message)

    def _greeting(self) -> str:
        log = f"logs to {self._log.path}" if self._log is not None else "keeps no log"
        return (
            f"imud {version()} listens on {', '.join(self._config.listen)}, {log}, "
            f"reads {', '.join(self._config.ports)}"
        )

    def _farewell(self) -> str:
        parts = []
        for watched in self._probes.values():
            counts: Any = watched.probe.account.counts()
            earlier = counts["earlier_boots"]
            received = counts["received"] + earlier["received"]
            lost = counts["lost"] + earlier["lost"]
            text = f"probe {watched.name}: {received} received, {lost} lost"
            twin = watched.twin
            if twin is not None:
                text += f", {twin.differed} of {twin.compared} poses differ"
            parts.append(text)
        log = f"; log {self._log.path}" if self._log is not None else ""
        return f"stopped; {'; '.join(parts) or 'no probe was heard'}{log}"


def run(config: Config) -> int:
    """Runs until SIGTERM or SIGINT; says what happens on stderr."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        asyncio.run(Daemon(config).run())
    finally:
        logger.removeHandler(handler)
    return 0
