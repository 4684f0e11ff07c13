# SPDX-License-Identifier: MIT
"""A probe as its messages tell it: what was received of it, its time, its params."""

from __future__ import annotations

from collections import Counter

from imud.probes.boot import DecodedFrame
from imud.probes.clock import ProbeClock
from imud.probes.ledger import Account
from imud.probes.record import Stamp
from imud.probes.references import References
from imud.probes.scales import UNKNOWN, Scales
from imud.probes.self_test import Responses, SensorVerdict, verdicts_of
from imud.probes.timeline import Timeline
from imud.wire.messages import Message, Value
from imud.wire.params import ParamsParts

# Messages that say what others mean.
TELLING = frozenset({"hello", "params", "event", "self_test"})

# Boards that do without a data-ready wire, and messages that have the time of a sample:
# a poll of the sensor takes 0.1 ms, and tells the edge no better (core/probe/polled.h).
POLLING = frozenset({"pico", "mega", "micropython"})
SAMPLED = frozenset({"pose", "raw", "stroke"})
POLL_NS = 100_000


class Probe:
    """One probe: its account, clock, latest hello and params, on whichever port it is
    and whichever boot.
    """

    def __init__(self, probe_id: str) -> None:
        self.probe_id = probe_id
        self.account = Account()
        self.clock = ProbeClock()
        self.hello: dict[str, Value] = {}
        self.hello_content = b""
        self.params_parts = ParamsParts()
        self.params_digest: int | None = None  # of those in force, as it last said
        self.scales = UNKNOWN
        self.references = References()
        self.responses: Responses | None = None  # to its self-test, of this boot
        self._numbers = Counter[str]()
        self._lost: dict[str, int] = {}
        self._boot = 0

    def stamp(
        self, frame: DecodedFrame, message: Message, timeline: Timeline, byte_ns: int
    ) -> Stamp:
        """The number and the time of a good message; a byte takes `byte_ns`."""
        name = message.name
        self._numbers[name] += 1
        lost = self.account.lost
        # A late message takes back a loss.
        missing = max(0, lost - self._lost.get(name, 0))
        self._lost[name] = lost
        number = self._numbers[name]
        device_us = self.clock.unroll(frame.time_us, frame.t_ns)
        if frame.t_ns is None:
            return Stamp(number, missing, device_us, boot=self._boot)
        if frame.t_sample_ns is not None:
            times = frame.t_sample_ns, None, frame.t_ns
            return Stamp(number, missing, device_us, *times, boot=self._boot)
        # It was on the wire for so long at least.
        on_wire_ns = len(frame.content) * byte_ns
        host_ns, bound_ns = self.clock.date(device_us, frame.t_ns - on_wire_ns)
        t_ns = timeline.utc(host_ns)
        if bound_ns is not None:
            bound_ns += timeline.doubt(host_ns, bound_ns, t_ns)
            if name in SAMPLED and self.hello.get("board") in POLLING:
                bound_ns += POLL_NS
        return Stamp(
            number,
            missing,
            device_us,
            t_ns,
            bound_ns,
            timeline.utc(frame.t_ns),
            timeline.whose,
            self._boot,
        )

    @property
    def params(self) -> bytes | None:
        """The records in force; None while not all of their parts were heard."""
        digest = self.params_digest
        return None if digest is None else self.params_parts.get(digest)

    @property
    def verdicts(self) -> tuple[SensorVerdict, ...]:
        """On its sensors, of this boot; empty before the first hello."""
        return verdicts_of(self.hello, self.responses)

    def begin_boot(self) -> None:
        """Forgets what is of the boot before."""
        self.clock = ProbeClock(self.clock.rate)
        self.responses = None
        self._boot += 1

    def update(self, message: Message, content: bytes) -> None:
        """Takes up what a good message, in order, says of the probe itself."""
        if message.name not in TELLING:
            return
        digest: Value = None
        if message.name == "params":
            self.params_parts.add_part(message)
        elif message.name == "hello":
            self.hello, self.hello_content = dict(message.fields), content
            digest = message.fields["params_digest"]
        elif message.name == "self_test":
            self.responses = Responses.of(message.fields)
        elif message.fields["event"] == "params_changed":
            digest = message.fields["detail"]
        if isinstance(digest, int):
            self.params_digest = digest & 0xFFFFFFFF
        self._scale()

    def add_params(self, records: bytes) -> None:
        """Params that are known otherwise, as from the metadata of a log."""
        self.params_parts.add_whole(records)
        self._scale()

    def _scale(self) -> None:
        hello, params, scales = self.hello_content, self.params, self.scales
        if hello != scales.hello or params != scales.params:
            self.scales = Scales(hello, params)
