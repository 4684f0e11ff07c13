# SPDX-License-Identifier: MIT
"""A serial port of the daemon: a link, and a session for each time it is open.

The baud rate is found by listening only: nothing is written before a hello arrives.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Sequence

from imud.errors import LinkError, PortLost, PortNotFound
from imud.journal.output import Journal
from imud.journal.phrases import port_problem
from imud.ports.baud import Memory, Sound, Trial, TrialStep
from imud.ports.link import Link
from imud.ports.receiver import Claim, EventReceiver
from imud.probes.session import (
    NOISE_BYTES,
    Event,
    OnlyNoise,
    OtherSchema,
    ProbeFound,
    Session,
    Silent,
)
from imud.probes.timeline import host_ns

# How often the time is checked while a rate is tried.
LISTEN_S = 0.1

# A port that was found is tried again for LOST_NS after it vanished, and is closed
# for other programs when its probe is silent for SILENT_NS.
LOST_NS = 10_000_000_000
SILENT_NS = 30_000_000_000


class Port:
    """One port that is kept open, and the probe on it."""

    def __init__(
        self,
        name: str,
        probes: EventReceiver,
        journal: Journal,
        memory: Memory,
        *,
        rates: Sequence[int],
        also: Sequence[str] = (),
        is_named: bool = True,
        has_reset: bool = False,
        on_known: Callable[[str], None] = lambda _: None,
    ) -> None:
        """`on_known`: called with the id of the probe that was heard."""
        self.name = name
        self.is_named = is_named
        self._keys = (*also, name)
        self._rates = rates
        self._on_known = on_known
        self._probes = probes
        self._journal = journal
        self._memory = memory
        self._fault: type[LinkError] | None = None
        self._trial: Trial | None = None
        self._listening: asyncio.TimerHandle | None = None
        self._claim = Claim(probes, self)
        self._is_noise_told = False
        self._is_pty = False
        self._heard_ns = 0  # host's time of the latest good frame
        self._freed: asyncio.Event | None = None
        self.fault: LinkError | None = None  # why it was given up; None: no probe
        self.had_probe = False
        self.session: Session | None = None
        self._link = Link(
            name,
            self._order()[0],
            on_open=self._opened,
            on_data=self._heard,
            on_fault=self._failed,
            has_reset=has_reset,
        )

    @property
    def _is_left_out(self) -> bool:
        """Whether the probe here is on another port too, or is one too many."""
        probe = self.session.probe if self.session is not None else None
        return probe is not None and probe.probe_id not in self._claim

    @property
    def baud(self) -> int:
        return self._link.baud

    async def run(self) -> None:
        """Serves a named port until it is cancelled, others until they are given up."""
        self._freed = asyncio.Event()
        serving = asyncio.create_task(self._link.run())
        freed = asyncio.create_task(self._freed.wait())
        try:
            await asyncio.wait([serving, freed], return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (serving, freed):
                task.cancel()
            results = await asyncio.gather(serving, freed, return_exceptions=True)
            self.end()
        # A link should not end: one that does has failed, and its error is shown.
        for result in results:
            if isinstance(result, Exception):
                raise result

    def write(self, data: bytes) -> None:
        """Sends bytes to the probe; PortLost if there is none."""
        if self.session is None or self.session.probe is None or self._is_left_out:
            raise PortLost(f"{self.name}: no hello from a probe yet; wait for it")
        self._link.write(data)

    def check(self, t_ns: int) -> None:
        """Called once a second with the host's time: is anything good heard?"""
        if self.session is None or self._trial is not None:
            return
        if self._is_left_out and self.session.probe is not None:
            probe_id = self.session.probe.probe_id
            if not self._claim.is_held(probe_id, t_ns):
                self.listen_again()
            return
        events = self.session.check(t_ns)
        self._tell(events)
        has_many = len(self._order()) > 1
        if any(isinstance(event, OnlyNoise) for event in events) and has_many:
            self.listen_again()
        elif not self.is_named and self._silence_ns(t_ns) > SILENT_NS:
            self._free(None)

    def _silence_ns(self, t_ns: int) -> int:
        return self._probes.timeline.silence(self._heard_ns, t_ns)

    def end(self) -> None:
        """Ends the port's session, if there is one, and passes on its last events."""
        if self._listening is not None:
            self._listening.cancel()
        self._listening = self._trial = None
        session, self.session = self.session, None
        if session is None:
            return
        self._tell(session.close())
        self._probes.port_ended(session, self)
        self._claim.clear()

    def listen_again(self) -> None:
        """Begins a session and the search for the rate again."""
        self.end()
        if self._link.is_open:
            self._link.set_baud(self._order()[0])
            self._opened()

    def _order(self) -> tuple[int, ...]:
        missing = self._probes.missing()
        if len(self._rates) == 1:
            return tuple(self._rates)
        return self._memory.order(self._keys, missing, self._rates)

    def _opened(self) -> None:
        if self._fault is not None:
            self._journal.write(("open", self.name), f"{self.name}: open")
        self._fault = None
        self._is_pty = os.path.realpath(self.name).startswith("/dev/pts/")
        loop = asyncio.get_running_loop()
        self._trial = Trial((self._link.baud, *self._others()), loop.time())
        self._begin_session()
        self._listening = loop.call_later(LISTEN_S, self._listen)

    def _others(self) -> list[int]:
        return [rate for rate in self._order() if rate != self._link.baud]

    def _begin_session(self) -> None:
        self.session = Session(
            self._claim.find, host_ns(), timeline=self._probes.timeline
        )

    def _heard(self, data: bytes, t_ns: int) -> None:
        if self.session is None:
            return
        self._probes.follow_host(t_ns)
        # Ten bits a byte, with start and stop bit; a pty has no wire.
        self.session.byte_ns = 0 if self._is_pty else 10_000_000_000 // self.baud
        self._tell(self.session.receive(data, t_ns))
        if self._trial is not None:
            self._judge()

    def _listen(self) -> None:
        """Checks the time while a rate is tried."""
        self._judge()
        if self._trial is not None:
            loop = asyncio.get_running_loop()
            self._listening = loop.call_later(LISTEN_S, self._listen)

    def _judge(self) -> None:
        trial, session = self._trial, self.session
        if trial is None or session is None:
            return
        sound = Sound.of(session.counts())
        step = trial.judge(sound, asyncio.get_running_loop().time())
        if step is TrialStep.STAY:
            return
        if step is TrialStep.OVER and not self._go_on(trial):
            return
        if sound.bytes > 0:
            self._tell(session.close())
            self._begin_session()
        self._link.set_baud(trial.rate)

    def _go_on(self, trial: Trial) -> bool:
        """After a round of all rates without a hello: whether another one follows."""
        if not self.is_named:
            self._free(None)
            return False
        t_ns = host_ns()
        if trial.noise > NOISE_BYTES and not self._is_noise_told:
            self._is_noise_told = True
            self._tell_problem(OnlyNoise(trial.noise), trial.rates)
        elif self.session is not None and not trial.noise:
            self._tell(self.session.check(t_ns))
        return True

    def _free(self, fault: LinkError | None) -> None:
        self.fault = fault
        self.end()
        if self._freed is not None:
            self._freed.set()

    def _failed(self, error: LinkError) -> None:
        self.end()
        self._link.set_baud(self._order()[0])
        if not self.is_named:
            since_ns = self._silence_ns(host_ns())
            is_lost = isinstance(error, PortLost | PortNotFound)
            if not (is_lost and self.had_probe and since_ns < LOST_NS):
                self._free(error)
                return
        # A port that vanished does not exist then: that line was written already.
        is_known = self._fault is not None and (
            type(error) is self._fault or self._fault is PortLost
        )
        if not is_known:
            kind = ("fault", self.name, type(error))
            self._journal.write(kind, str(error), is_warning=True)
            self._fault = type(error)

    def _tell(self, events: list[Event]) -> None:
        for event in events:
            if isinstance(event, (OnlyNoise, Silent)):
                if self.is_named or self.had_probe:
                    self._tell_problem(event, (self.baud,))
                continue
            self._heard_ns = host_ns()
            if isinstance(event, (OtherSchema, ProbeFound)):
                self._know(event.probe_id)
            if isinstance(event, OtherSchema):
                if self._probes.has_room(event.probe_id):
                    self._probes.handle_other(event, self)
            elif event.probe_id in self._claim:
                self._probes.handle(event, self)

    def _know(self, probe_id: str) -> None:
        """A hello was heard, so this rate is right."""
        if self._trial is None:
            return
        self._trial = None
        if self._listening is not None:
            self._listening.cancel()
        self._is_noise_told = False
        self.had_probe = True
        self._memory.learn(self._keys, probe_id, self.baud)
        self._on_known(probe_id)

    def _tell_problem(self, event: OnlyNoise | Silent, rates: Sequence[int]) -> None:
        text = port_problem(self.name, event, rates)
        kind = ("problem", self.name, type(event))
        self._journal.write(kind, text, is_warning=True)
