# SPDX-License-Identifier: MIT
"""Sends commands to probes, and asks each for its time."""

from __future__ import annotations

import asyncio
import contextlib
import random
import re
import secrets
import time
from collections.abc import Callable, Mapping
from operator import itemgetter
from typing import Any

from imud.commands import COMMANDS, STREAMS, Argument
from imud.config.settings import ProbeSettings
from imud.daemon.registry import ProbeEntry, Registry
from imud.errors import (
    CommandRefused,
    DeviceError,
    NoReply,
    PortLost,
    ProbeUnknown,
    VersionMismatch,
)
from imud.probes.record import Stamp, plain
from imud.probes.session import Received
from imud.probes.timeline import host_ns
from imud.wire import kept, messages
from imud.wire.frame import encode_frame
from imud.wire.messages import Message, Value

# A probe replies within milliseconds; three tries outlast a burst of noise.
REPLY_TIMEOUT_S = 1.0
TRIES = 3

# How often a probe is asked for its time: the first FIRST times, while the bound of its
# clock is wider than TIME_BOUND_NS, and from then on. After UNANSWERED commands without
# a reply the pause doubles each time, up to TIME_LATE_S.
FIRST, TIME_FIRST_S, TIME_WIDE_S, TIME_S, TIME_LATE_S = 200, 0.05, 0.2, 1.0, 60.0
TIME_BOUND_NS = 1_000_000
UNANSWERED = 20
ASKED_MAX = 16  # commands whose reply may still come
TIME_STEP_S = 0.03  # how often the probes are looked through
TIME_MAX = 3  # probes asked at a time: many wide bounds must not keep the loop busy

SHOWN_MAX = 40  # characters of a command from the network in a reply


def shown(text: str) -> str:
    """Untrusted text for a line: short, without control characters."""
    return "".join(c if c.isprintable() else "?" for c in text[:SHOWN_MAX])


def _integer(text: str) -> int:
    """ASCII digits only: int() also takes 1_0 and digits of other scripts."""
    if not re.fullmatch(r"-?[0-9]{1,20}", text):
        raise ValueError(text)
    return int(text)


def _number_of(argument: Argument, parameters: Mapping[str, str]) -> int:
    """The value of an argument for the probe; KeyError or ValueError if it is wrong."""
    if argument.is_optional and argument.name not in parameters:
        return 0
    text = parameters[argument.name]
    if argument.type == "integer":
        return _integer(text)
    if argument.type == "list":
        words = {word for word in text.split(",") if word}
        return sum(1 << argument.choices[word] for word in words)
    return argument.choices[text]


def refuse_unknown(name: str, parameters: Mapping[str, str]) -> None:
    """CommandRefused if the command has no such argument."""
    unknown = parameters.keys() - COMMANDS[name].argument_names
    if unknown:
        raise CommandRefused(f"{name} has no parameter {shown(min(unknown))}")


def arguments_of(name: str, parameters: Mapping[str, str]) -> tuple[int, int]:
    """The two numbers that a probe gets; CommandRefused if the parameters are wrong."""
    command = COMMANDS[name]
    refuse_unknown(name, parameters)
    try:
        numbers = [_number_of(each, parameters) for each in command.arguments]
    except (KeyError, ValueError) as error:
        raise CommandRefused(command.usage) from error
    first, second, *_ = *numbers, 0, 0
    return first, second


def orders_of(
    settings: ProbeSettings, hello: Mapping[str, Value]
) -> list[tuple[str, dict[str, str]]]:
    """The commands that bring a probe to its settings, as far as they differ."""
    orders = []
    for stream in STREAMS:
        hz = getattr(settings, f"{stream}_rate")
        if hz is not None and hz != hello.get(f"{stream}_rate"):
            orders.append(("rate", {"stream": stream, "hz": str(hz)}))
    if settings.streams is not None:
        orders.append(("fields", {"streams": ",".join(settings.streams)}))
    if settings.start:
        orders.append(("start", {}))
    return orders


class Asking:
    """When one probe is asked for its time, and what it was asked."""

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance
        self.asked_s = -TIME_LATE_S  # loop's time of the last one
        self._share = 1.0  # of the usual pause
        self.unanswered = 0
        self.count = 0
        self.asked: dict[int, int] = {}  # token: host's ns when it was written
        self.size = 0  # bytes of the command

    def due_s(self, stamp: Stamp | None) -> float:
        """The loop's time at which it is asked again, by what is known now."""
        bound_ns = stamp.t_bound_ns if stamp is not None else None
        is_known = bound_ns is not None and bound_ns < TIME_BOUND_NS
        wait_s = TIME_FIRST_S if self.count < FIRST else TIME_WIDE_S
        if is_known:
            wait_s = TIME_S
        if self.unanswered > UNANSWERED:
            wait_s = min(TIME_S * 2.0 ** (self.unanswered - UNANSWERED), TIME_LATE_S)
        return self.asked_s + wait_s * self._share

    def put_off(self, now_s: float) -> None:
        """It is asked now."""
        self.unanswered += 1
        self.count += 1
        self.asked_s = now_s
        # At random, so as not to keep in step with what delays the replies.
        self._share = self._chance.uniform(0.7, 1.3)


class Commander:
    """Sends commands, one at a time to each probe, until there is a reply."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self._sequence = 0
        # At random: a probe does not carry out the same token twice in a row, and a
        # daemon that ran before may have sent the last one.
        self._token = secrets.randbelow(0xFFFF)
        self._replies: dict[int, asyncio.Future[Message]] = {}
        self._chance = random.SystemRandom()
        self._asking: dict[ProbeEntry, Asking] = {}

    async def command(
        self, name: str, command: str, parameters: Mapping[str, str]
    ) -> Any:
        """Sends a command until there is a reply, and returns its value. Raises
        DeviceError if there is none or the probe refuses.
        """
        entry = self.entry_of(name)
        row = COMMANDS.get(command)
        if row is None or row.by_daemon:
            names = sorted(each.name for each in COMMANDS.values() if not each.topic)
            raise CommandRefused(
                f"there is no command {shown(command)!r}, only {', '.join(names)}"
            )
        message = await self.ask(entry, command, arguments_of(command, parameters))
        result = message.fields["result"]
        if result == "bad_argument" and "filter" in parameters:
            raise CommandRefused(
                f"probe {name} has no filter {parameters['filter']}: its firmware "
                f"does not include it and runs {plain(entry.probe.hello['filter'])}"
            )
        if result != "ok":
            raise CommandRefused(
                f"probe {name} refused {command}: {str(result).replace('_', ' ')}"
            )
        return message.fields["value"]

    def entry_of(self, name: str) -> ProbeEntry:
        """The probe of that name; DeviceError if it can't be sent a command."""
        entry = self.heard(name)
        if entry.other is not None:
            raise VersionMismatch(
                f"probe {name} has another schema (firmware {entry.other.firmware}); "
                "update it with imud flash, or update imud"
            )
        return entry

    def heard(self, name: str) -> ProbeEntry:
        """The probe of that name, whatever it speaks; ProbeUnknown if there is none."""
        entry = self._registry.named(name)
        if entry is None:
            raise ProbeUnknown(f"no probe {name}; imud list shows the probes")
        return entry

    async def ask(
        self, entry: ProbeEntry, command: str, arguments: tuple[int, int]
    ) -> Message:
        """Sends a command until there is a reply, and returns it, whatever it says."""
        async with entry.commanding:
            return await self._ask(entry, command, arguments)

    async def set_up(self, name: str, settings: ProbeSettings) -> None:
        """Applies the settings of a probe; DeviceError if it refuses one."""
        entry = self._registry.named(name)
        if entry is not None:
            for command, parameters in orders_of(settings, entry.probe.hello):
                await self.command(name, command, parameters)
                if command == "rate":
                    # As its next hello will say; the settings may change before.
                    key = f"{parameters['stream']}_rate"
                    entry.probe.hello[key] = int(parameters["hz"])

    async def keep_time(self, look: Callable[[], None]) -> None:
        """Asks all probes for their time until it is cancelled; calls `look` each time
        that it looks which are due.
        """
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(TIME_STEP_S * self._chance.uniform(0.5, 1.5))
            look()
            now_s = loop.time()
            due = []
            for entry in self._registry:
                asking = self._asking.setdefault(entry, Asking(self._chance))
                due_s = asking.due_s(entry.stamp)
                if now_s >= due_s and self._may_ask(entry):
                    due.append((due_s, entry, asking))
            due.sort(key=itemgetter(0))
            for _, entry, asking in due[:TIME_MAX]:
                self._ask_time(entry, asking, now_s)

    def _may_ask(self, entry: ProbeEntry) -> bool:
        # Not between two tries of a command: a probe remembers the last token only, and
        # would carry out the command twice.
        is_readable = entry.is_alive and entry.other is None
        return is_readable and not entry.commanding.locked()

    def _ask_time(self, entry: ProbeEntry, asking: Asking, now_s: float) -> None:
        if entry.port is None:
            return
        token = self._next_token()
        asking.asked[token] = host_ns()
        while len(asking.asked) > ASKED_MAX:
            del asking.asked[next(iter(asking.asked))]
        asking.put_off(now_s)
        # The link tells itself what is wrong with its port.
        with contextlib.suppress(PortLost, CommandRefused):
            asking.size = self._send(entry, "time", token, (0, 0))

    def handle_reply(self, entry: ProbeEntry, event: Received) -> None:
        """Gives a reply to the command that waits for its token. Of a request for the
        time, it also tells the probe's clock when the device read it, in the host's ns.
        """
        message = event.message
        token = message.fields["replied_token"]
        asking = self._asking.get(entry)
        if asking is not None and token in asking.asked and isinstance(token, int):
            session = entry.session
            wire_ns = asking.size * (session.byte_ns if session is not None else 0)
            heard_ns = asking.asked.pop(token) + wire_ns
            entry.probe.clock.heard(event.stamp.t_device_us, heard_ns)
            asking.unanswered = 0
        reply = self._replies.get(token) if isinstance(token, int) else None
        if reply is not None and not reply.done():
            reply.set_result(message)

    async def _ask(
        self, entry: ProbeEntry, command: str, arguments: tuple[int, int]
    ) -> Message:
        token = self._next_token()
        reply: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        self._replies[token] = reply
        try:
            for _ in range(TRIES):
                try:
                    self._send(entry, command, token, arguments)
                except PortLost as error:
                    raise DeviceError(str(error)) from error
                except ValueError as error:
                    raise CommandRefused(str(error)) from error
                done, _ = await asyncio.wait([reply], timeout=REPLY_TIMEOUT_S)
                if done:
                    return reply.result()
        finally:
            del self._replies[token]
        raise NoReply(
            f"probe {entry.name} did not answer {command}, {TRIES} times; check with "
            "imud list"
        )

    def _send(
        self, entry: ProbeEntry, name: str, token: int, arguments: tuple[int, int]
    ) -> int:
        """Returns how many bytes it wrote."""
        if entry.port is None:
            raise ProbeUnknown(f"probe {entry.name} is disconnected; plug it in")
        fields = {"command": name, "token": token, "arguments": arguments}
        self._sequence += 1
        time_us = time.monotonic_ns() // 1000
        content = messages.encode("command", fields, self._sequence, time_us)
        speaks = kept.find(entry.probe.hello.get("schema_fingerprint")) or kept.OURS
        if not speaks.takes(content):
            raise CommandRefused(f"{entry.name} has old firmware; run imud flash")
        # A delimiter first, to end a partial frame that the probe may hold.
        data = b"\0" + encode_frame(content, speaks)
        entry.port.write(data)
        return len(data)

    def _next_token(self) -> int:
        self._token = self._token % 0xFFFF + 1
        return self._token
