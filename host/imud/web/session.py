# SPDX-License-Identifier: MIT
"""The dialogue with one browser: who it is, what it watches, what it asks for."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from typing import Any, Protocol

import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.frames import CloseCode

from imud.errors import ImudError
from imud.flash.firmware import Firmware
from imud.web.browser import Browser
from imud.web.connections import Connections
from imud.web.feed import CALIBRATION, Feed
from imud.web.guide import GuideError, Guides
from imud.web.limbs import SEGMENTS
from imud.web.limbs import Limbs as SavedLimbs
from imud.web.logs import LogFolder, part_of
from imud.web.messages import (
    Adopt,
    Ask,
    Calibrate,
    Export,
    GoLive,
    Limb,
    Limbs,
    Login,
    Logs,
    Play,
    Ports,
    Read,
    Seek,
    Seen,
    Update,
    Virtual,
    Watch,
    decode,
)
from imud.web.playing import Players, Playing
from imud.web.tables import Tables
from imud.web.updater import UpdateError, Updates
from imud.web.users import NOTHING, Grant, Users
from imud.web.virtual import VirtualProbe

# Answers a command: JSON and no error, or an error.
Answer = Callable[[bytes, str], None]
# Carries out a command: probe, name, parameters, where the answer goes, and who asks.
OnAsk = Callable[[str, str, dict[str, str], Answer, str], None]

TOO_MUCH = "too many commands at once"
NO_COMMANDS = "your role may not send commands"
NO_LOGS = "your role may not read logs"
NO_UPDATES = "your role may not update firmware"
NO_PORTS = "your role may not change ports"
NO_LIMBS = "your role may not set up limbs"
NO_VIRTUAL = "your role may not start a virtual probe"
ASKS_MAX = 8  # commands of one browser that are not yet answered
LOGINS_MAX = 3
LOGIN_PAUSE_S = 0.5  # after a wrong password


class PortControl(Protocol):
    """The ports of the daemon's machine; each call may raise an ImudError."""

    def rows(self) -> Any: ...
    def adopt(self, name: str) -> bool: ...
    def release(self, name: str) -> bool: ...


class SessionContext(msgspec.Struct, frozen=True):
    """State shared by all sessions."""

    connections: Connections
    feed: Feed
    users: Users
    on_ask: OnAsk
    about: Mapping[str, Any]
    guides: Guides
    players: Players
    has_room: Callable[[], bool]  # for another user who has logged in
    virtual: VirtualProbe
    logs: LogFolder | None = None  # None: there are none here
    ports: PortControl | None = None  # None: they are another machine's
    updates: Updates | None = None  # None: so are its boards
    limbs: SavedLimbs | None = None  # None: so are their files


class BrowserSession:
    """Belongs to the server's loop."""

    def __init__(
        self,
        context: SessionContext,
        connection: ServerConnection,
        browser: Browser,
        number: int,
    ) -> None:
        """`number`: of the browser, by which others know it."""
        self._context = context
        self._connection = connection
        self._loop = asyncio.get_running_loop()
        self._grant = NOTHING
        self._failed_logins = 0
        self._asking = 0
        self._playing: Playing | None = None
        self._tables: Tables | None = None
        self._exporting: asyncio.Task[None] | None = None
        self._starting: set[asyncio.Task[None]] = set()
        self.browser = browser
        self._user = ""
        self._number = number
        self.is_admitted = False
        self.admit(context.users.at_first())

    def admit(self, grant: Grant) -> None:
        """Tells the browser what it may do, and what is known by now."""
        self._grant = grant
        self.is_admitted = bool(grant.role)
        self.browser.grant(grant.reads)
        self.describe()
        self.browser.put(self._context.feed.last())

    def describe(self) -> None:
        """Tells the browser what it may do."""
        grant = self._grant
        self.browser.say(
            {
                **self._context.about,
                "role": grant.role,
                "who": self._who,
                "reads": sorted(grant.reads),
                "commands": bool(grant.commands),
                "logs": self._has_logs(),
                "ports": self._has_ports(),
                "firmware": self._offered(),
                "virtual": self._context.virtual.standing if grant.commands else "",
                "limbs": self._limbs_standing(),
                "playing": self._playing.name if self._playing else None,
            }
        )

    @property
    def _who(self) -> str:
        """By what others are told whose command it was."""
        return f"{self._user or 'page'} ({self._number})"

    async def handle(self, message: str | bytes) -> None:
        """Acts on a message; MsgspecError if it is none of ours."""
        request = decode(message)
        if isinstance(request, Seen):
            self.browser.seen(request.n)
        elif isinstance(request, Watch):
            every = frozenset(request.every)
            self.browser.watch(every, request.rate_hz, request.probe or "")
        elif isinstance(request, Ask):
            self._ask(request)
        elif isinstance(request, Calibrate):
            await self._calibrate(request)
        elif isinstance(request, Update):
            self._update(request)
        elif isinstance(request, Login):
            await self._log_in(request)
        elif isinstance(request, Play):
            await self._play(request)
        elif isinstance(request, Seek):
            self._seek(request)
        elif isinstance(request, Export):
            self._begin_export(request)
        elif isinstance(request, GoLive):
            await self._go_live()
        elif isinstance(request, Ports | Adopt):
            await self._tell_ports(request)
        elif isinstance(request, Virtual):
            self._begin_virtual(request)
        elif isinstance(request, Limbs | Limb):
            self._begin(self._set_limb(request))
        else:
            await self._tell_logs(request)

    async def close(self) -> None:
        """The browser has left."""
        await self._stop_playing()
        if self._exporting is not None:
            self._exporting.cancel()
            await asyncio.wait([self._exporting])
        if self._tables is not None:
            self._tables.remove()

    async def _stop_playing(self) -> None:
        if self._playing is not None:
            await self._playing.stop()

    async def _play(self, request: Play) -> None:
        logs, players = self._context.logs, self._context.players
        reason = "" if logs is not None and self._has_logs() else "role"
        if self._playing is None and not reason and players.is_full:
            reason = "busy"
        if logs is None or reason:
            words = "too many logs are being played" if reason == "busy" else NO_LOGS
            self._refuse(request.id, reason, words)
            return
        try:
            path = await asyncio.to_thread(logs.path, request.name)
        except OSError as error:
            self._say_answer(request.id, b"", error.strerror or "it can't be read")
            return
        if self._playing is not None and self._playing.name == request.name:
            self._playing.set_speed(request.speed)
        else:
            await self._stop_playing()
            self._playing = Playing(path, request.speed, self.browser, players)
            self.browser.play(is_playing=True)
            self.admit(self._grant)
        self._say_answer(request.id, b"true", "")

    def _seek(self, request: Seek) -> None:
        if self._playing is None:
            self._say_answer(request.id, b"", "no log is being played")
        else:
            self._playing.seek(request.t_ms)
            self._say_answer(request.id, b"true", "")

    async def _go_live(self) -> None:
        await self._stop_playing()
        self._playing = None
        self.browser.play(is_playing=False)
        self.admit(self._grant)

    def _has_logs(self) -> bool:
        return self._context.logs is not None and self._grant.logs

    async def _tell_logs(self, request: Logs | Read) -> None:
        logs = self._context.logs
        if logs is None or not self._has_logs():
            self._refuse(request.id, "role", NO_LOGS)
            return
        if self.browser.answers >= ASKS_MAX:
            self._refuse(request.id, "busy", TOO_MUCH)
            return
        try:
            if isinstance(request, Logs):
                value: Any = await asyncio.to_thread(logs.files)
            else:  # bytes become base64 in JSON
                value = await asyncio.to_thread(
                    self._part, logs, request.name, request.offset
                )
        except OSError as error:
            self._say_answer(request.id, b"", error.strerror or "it can't be read")
        else:
            self._say_answer(request.id, msgspec.json.encode(value), "")

    def _part(self, logs: LogFolder, name: str, offset: int) -> bytes:
        tables = self._tables
        if tables is not None and tables.name == name and tables.path is not None:
            return part_of(tables.path, offset)
        return logs.read(name, offset)

    def _begin_export(self, request: Export) -> None:
        logs = self._context.logs
        is_busy = self._exporting is not None and not self._exporting.done()
        if logs is None or not self._has_logs():
            self._refuse(request.id, "role", NO_LOGS)
        elif is_busy or self._context.players.is_full:
            self._refuse(request.id, "busy", "tables are being made; try again later")
        else:
            self._exporting = self._loop.create_task(self._export(request, logs))

    async def _export(self, request: Export, logs: LogFolder) -> None:
        try:
            path = await asyncio.to_thread(logs.path, request.name)
            if self._tables is not None:
                self._tables.remove()
            self._tables = tables = Tables(path, self._context.players)
            value = {"name": tables.name, "bytes": await tables.make()}
        except OSError as error:
            self._say_answer(request.id, b"", error.strerror or "it can't be read")
        else:
            self._say_answer(request.id, msgspec.json.encode(value), "")

    def _offered(self) -> tuple[Firmware, ...]:
        """Images for the page's button; none where it can't be pressed."""
        updates = self._context.updates
        return updates.offered if updates and self._grant.may_update else ()

    def _has_ports(self) -> bool:
        return self._context.ports is not None and bool(self._grant.commands)

    async def _tell_ports(self, request: Ports | Adopt) -> None:
        ports = self._context.ports
        if ports is None or not self._has_ports():
            self._refuse(request.id, "role", NO_PORTS)
            return
        try:
            if isinstance(request, Ports):
                value: Any = await asyncio.to_thread(ports.rows)
            else:
                change = ports.adopt if request.ours else ports.release
                value = await asyncio.to_thread(change, request.port)
        except ImudError as error:
            self._say_answer(request.id, b"", str(error))
        else:
            self._say_answer(request.id, msgspec.json.encode(value), "")

    def _begin_virtual(self, request: Virtual) -> None:
        if not self._grant.commands:
            self._refuse(request.id, "role", NO_VIRTUAL)
        else:
            self._begin(self._set_virtual(request))

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        """What takes a while, beside other requests."""
        task = self._loop.create_task(work)
        self._starting.add(task)
        task.add_done_callback(self._starting.discard)

    async def _set_virtual(self, request: Virtual) -> None:
        virtual = self._context.virtual
        why = await virtual.begin() if request.on else await virtual.end()
        self._say_answer(request.id, b"true", why)

    def _limbs_standing(self) -> dict[str, str] | None:
        limbs = self._context.limbs
        if limbs is None or not self._grant.commands:
            return None
        return {"running": limbs.running, "why": limbs.why}

    async def _set_limb(self, request: Limbs | Limb) -> None:
        limbs = self._context.limbs
        if limbs is None or not self._grant.commands:
            self._refuse(request.id, "role", NO_LIMBS)
            return
        value: Any = True
        try:
            if isinstance(request, Limbs):
                saved = await asyncio.to_thread(limbs.saved)
                value = {"segments": [*SEGMENTS], "saved": saved}
            elif request.name is None:
                await limbs.end()
            else:
                if request.setup is not None:
                    await asyncio.to_thread(
                        limbs.save, request.name, request.setup, replace=request.replace
                    )
                await limbs.run(request.name)
        except ImudError as error:
            self._say_answer(request.id, b"", str(error))
        else:
            self._say_answer(request.id, msgspec.json.encode(value), "")

    async def _calibrate(self, request: Calibrate) -> None:
        if not (self._grant.commands and CALIBRATION in self._grant.reads):
            self._refuse(request.id, "role", "your role may not calibrate")
            return
        guides = self._context.guides
        try:
            if request.kind == "stop":
                await guides.stop(request.probe)
            elif request.kind == "end":
                guides.end(request.probe)
            else:
                guides.begin(request.probe, request.kind)
        except GuideError as error:
            self._say_answer(request.id, b"", str(error))
        else:
            self._say_answer(request.id, b"true", "")

    def _update(self, request: Update) -> None:
        updates = self._context.updates
        if updates is None or not self._grant.may_update:
            self._refuse(request.id, "role", NO_UPDATES)
            return
        try:
            updates.begin(request.probe)
        except UpdateError as error:
            self._say_answer(request.id, b"", str(error))
        else:
            self._say_answer(request.id, b"true", "")

    def _ask(self, asked: Ask) -> None:
        reason = "" if self._grant.may_send(asked.command) else "role"
        reason = reason or ("busy" if self._asking >= ASKS_MAX else "")
        if reason:
            words = TOO_MUCH if reason == "busy" else NO_COMMANDS
            self._refuse(asked.id, reason, words)
            return
        self._asking += 1

        def answer(payload: bytes, error: str) -> None:
            try:
                self._loop.call_soon_threadsafe(self._answered, asked, payload, error)
            except RuntimeError:
                return  # the server has ended

        self._context.on_ask(
            asked.probe, asked.command, dict(asked.parameters), answer, self._who
        )

    def _answered(self, asked: Ask, payload: bytes, error: str) -> None:
        self._asking -= 1
        self._say_answer(asked.id, payload, error)

    def _refuse(self, number: int, reason: str, words: str) -> None:
        """Counts a refusal, and answers request `number` with the reason in words."""
        self._context.connections.refuse(reason, self._connection)
        self._say_answer(number, b"", words)

    def _say_answer(self, number: int, payload: bytes, error: str) -> None:
        value = msgspec.Raw(payload) if payload else None
        reply = {"type": "answer", "id": number, "error": error, "answer": value}
        self.browser.say(reply)

    async def _log_in(self, request: Login) -> None:
        grant = self._context.users.log_in(request.user, request.secret)
        if grant is not None and not self._context.has_room():
            self._context.connections.refuse("browsers", self._connection)
            await self._connection.close(CloseCode.TRY_AGAIN_LATER)
            return
        if grant is not None:
            self._user = request.user
            self.admit(grant)
            return
        self._context.connections.refuse("login", self._connection)
        self._failed_logins += 1
        # Nothing else of this browser is read meanwhile.
        await asyncio.sleep(LOGIN_PAUSE_S)
        self.browser.say({"type": "login", "error": "wrong user or password"})
        if self._failed_logins >= LOGINS_MAX:
            await self._connection.close(CloseCode.POLICY_VIOLATION)
