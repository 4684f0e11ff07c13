# SPDX-License-Identifier: MIT
"""Turns the bytes of one opening of a port into events. No I/O; time is an argument.

A message is passed on once its probe is known, which takes a hello; messages before it
wait. Everything that is not passed on is counted, here or in the account.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable
from typing import Any

import msgspec

from imud.probes.boot import DecodedFrame
from imud.probes.clock import Clock
from imud.probes.ledger import Account, Judged, Verdict
from imud.probes.record import Stamp
from imud.probes.timeline import Timeline
from imud.wire import messages, schema
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message, Skew, Value
from imud.wire.params import ParamsParts

# Messages that may wait for a hello, which comes every second: two seconds of 760 raw
# messages and as many poses.
WAITING_MAX = 3072

# A hello and a status come every second: so long without a good frame is a fault.
SILENT_NS = 3_000_000_000

NOBODY = "unknown"  # id of the probe in a capture without a hello

# Up to so many bytes without a good frame may be part of one, or noise at power-on;
# more mean another baud rate or another device.
NOISE_BYTES = 256


class ProbeFound(msgspec.Struct, frozen=True):
    """The first hello of a probe on this port, or of another boot."""

    probe_id: str
    hello: Message
    is_restart: bool


class Received(msgspec.Struct, frozen=True):
    """A good message, in order."""

    probe: Probe
    message: Message
    content: bytes
    stamp: Stamp

    @property
    def probe_id(self) -> str:
        return self.probe.probe_id


class Refused(msgspec.Struct, frozen=True):
    """A frame that passed its CRC and is not passed on."""

    probe_id: str
    verdict: Verdict
    skew: Skew | None


class OtherSchema(msgspec.Struct, frozen=True):
    """A hello of a probe whose other messages this imud can't read."""

    probe_id: str
    fingerprint: int
    firmware: str
    hello: Message


class OnlyNoise(msgspec.Struct, frozen=True):
    """Bytes come, but no frames."""

    count: int


class Silent(msgspec.Struct, frozen=True):
    """A port is open and nothing is frame."""

    seconds: float


Event = ProbeFound | Received | Refused | OtherSchema | OnlyNoise | Silent


class Probe:
    """One probe: its account, clock and latest hello, on whichever port it is."""

    def __init__(self, probe_id: str) -> None:
        self.probe_id = probe_id
        self.account = Account()
        self.clock = Clock()
        self.hello: dict[str, Value] = {}
        self.hello_content = b""
        self.params_parts = ParamsParts()
        self._numbers = Counter[str]()
        self._lost: dict[str, int] = {}

    def stamp(
        self, frame: DecodedFrame, message: Message, timeline: Timeline, byte_ns: int
    ) -> Stamp:
        """The number and the time of a good message; a byte takes `byte_ns`."""
        name, lost = message.name, self.account.lost
        self._numbers[name] += 1
        # A late message takes back a loss.
        missing = max(0, lost - self._lost.get(name, 0))
        self._lost[name] = lost
        number = self._numbers[name]
        device_us = self.clock.unroll(frame.time_us, frame.t_ns)
        if frame.t_ns is None:
            return Stamp(number, missing, device_us)
        # It was on the wire for so long at least.
        self.clock.arrived(device_us, frame.t_ns - len(frame.content) * byte_ns)
        moment = self.clock.moment(device_us)
        t_ns, bound_ns = timeline.utc(moment.host_ns), moment.bound_ns
        if bound_ns is not None:
            bound_ns += timeline.doubt(moment.host_ns, bound_ns, t_ns)
        received_ns = timeline.utc(frame.t_ns)
        return Stamp(number, missing, device_us, t_ns, bound_ns, received_ns)

    @property
    def params(self) -> bytes | None:
        """The records in force, by the digest of its hello; None: not known yet."""
        digest = self.hello.get("params_digest")
        return self.params_parts.get(digest) if isinstance(digest, int) else None

    def learn(self, hello: Message, content: bytes) -> None:
        self.hello, self.hello_content = dict(hello.fields), content


def first_hello(chunks: Iterable[bytes]) -> Message | None:
    """The first hello of our schema in these bytes; None: there is none."""
    decoder = FrameDecoder()
    for data in chunks:
        for content in decoder.feed(data):
            decoded = messages.decode(content)
            if (
                isinstance(decoded, Message)
                and decoded.name == "hello"
                and decoded.fields["schema_fingerprint"] == schema.FINGERPRINT
            ):
                return decoded
    return None


def speaker_of(hello: Message | None, name: Callable[[str], Probe]) -> Probe:
    """The probe of a capture, known before its first hello is reached."""
    probe_id = hello.fields["probe_id"] if hello is not None else None
    probe = name(probe_id.hex() if isinstance(probe_id, bytes) else NOBODY)
    if hello is not None:
        probe.learn(hello, b"")
    return probe


class Session:
    """One opening of one port. `probes` finds the probe of an id, for all sessions.

    Times are the host's in ns, which `timeline` turns into UTC; without one they are
    UTC. `byte_ns` is the least time of a byte on the wire; who knows the port sets it.
    """

    def __init__(
        self,
        probes: Callable[[str], Probe],
        t_ns: int | None = None,
        presumed: Probe | None = None,
        timeline: Timeline | None = None,
    ) -> None:
        self._find = probes
        self._timeline = Timeline() if timeline is None else timeline
        self.byte_ns = 0
        self._decoder = FrameDecoder()
        self._has_delimiter = False
        self._waiting: deque[DecodedFrame] = deque()
        self._is_foreign = False
        self._tallied = Counter[str]()
        self._bad = 0
        self._heard_ns = self._good_ns = t_ns
        self._bytes_since_good = 0
        self._told: set[type[Event]] = set()  # since the last good frame
        self.probe = presumed
        self.bytes = 0
        self.corrupt = Counter[str]()  # bad frames, without those counted below
        self.partial = 0  # frames cut off by opening the port
        self.foreign = 0  # frames of a probe with another schema
        self.unnamed = 0  # good messages for which no hello came in time
        self.headless: Counter[str] = Counter()  # skewed, without a sequence number

    def counts(self) -> dict[str, Any]:
        return {
            "bytes": self.bytes,
            "frames": self._decoder.stats.ok,
            "corrupt": self.corrupt.total(),
            "corrupt_kinds": dict(sorted(self.corrupt.items())),
            "partial": self.partial,
            "foreign": self.foreign,
            "unnamed": self.unnamed,
            "headless": dict(sorted(self.headless.items())),
        }

    def receive(self, data: bytes, t_ns: int | None) -> list[Event]:
        events: list[Event] = []
        self.bytes += len(data)
        self._heard_ns = t_ns
        if not self._has_delimiter:
            end = data.find(0) + 1
            head, data = (data[:end], data[end:]) if end else (data, b"")
            self._feed(head, t_ns, events)
            self._has_delimiter = end > 0
            self.partial += self._newly_bad().total()
        self._feed(data, t_ns, events)
        if self._decoder.bad == self._bad:
            return events
        if self._is_foreign:
            self.foreign += self._newly_bad().total()
        else:
            self.corrupt += self._newly_bad()
        return events

    def _newly_bad(self) -> Counter[str]:
        self._bad = self._decoder.bad
        bad = Counter(self._decoder.stats.bad)
        fresh, self._tallied = bad - self._tallied, bad
        return fresh

    def check(self, t_ns: int) -> list[Event]:
        """Whether only noise or nothing has come. To be called about every second."""
        if self._heard_ns is None or self._good_ns is None:
            return []
        silence_ns = t_ns - self._heard_ns
        is_noise = self._bytes_since_good > NOISE_BYTES
        event: Event
        if is_noise and t_ns - self._good_ns > SILENT_NS:
            event = OnlyNoise(self._bytes_since_good)
        elif silence_ns > SILENT_NS:
            event = Silent(silence_ns / 1e9)
        else:
            return []
        if type(event) in self._told:
            return []
        self._told.add(type(event))
        return [event]

    def close(self) -> list[Event]:
        """Ends the session: judges or counts what waits."""
        events: list[Event] = []
        if self.probe is not None:
            for judged in self.probe.account.close():
                self._tell(self.probe, judged, events)
        self.unnamed += len(self._waiting)
        self._waiting.clear()
        return events

    def _feed(self, data: bytes, t_ns: int | None, events: list[Event]) -> None:
        self._bytes_since_good += len(data)
        for content in self._decoder.feed(data):
            self._bytes_since_good = 0
            self._good_ns = t_ns
            self._told.clear()
            events.extend(self.take(content, t_ns))

    def take(self, content: bytes, t_ns: int | None) -> list[Event]:
        """Takes the content of one frame whose CRC is right."""
        events: list[Event] = []
        decoded = messages.decode(content)
        if isinstance(decoded, Message) and not decoded.is_from_probe:
            detail = f"{decoded.name} comes from the wrong side"
            decoded = Skew("unknown_message", detail, decoded.sequence, decoded.time_us)
        if decoded.sequence is None or decoded.time_us is None:
            if isinstance(decoded, Skew):
                self.headless[decoded.kind] += 1
            return events
        frame = DecodedFrame(content, decoded, decoded.sequence, decoded.time_us, t_ns)
        if isinstance(decoded, Message) and decoded.name == "hello":
            self._take_hello(frame, decoded, events)
        elif self.probe is None:
            if len(self._waiting) == WAITING_MAX:
                self._waiting.popleft()
                self.unnamed += 1
            self._waiting.append(frame)
        else:
            self._note(self.probe, frame, events)
        return events

    def _take_hello(
        self, frame: DecodedFrame, hello: Message, events: list[Event]
    ) -> None:
        probe_id = hello.fields["probe_id"]
        fingerprint = hello.fields["schema_fingerprint"]
        if not isinstance(probe_id, bytes) or not isinstance(fingerprint, int):
            self.headless["impossible_value"] += 1
            return
        if fingerprint != schema.FINGERPRINT:
            if not self._is_foreign:
                self._is_foreign = True
                if self.probe is None:
                    # The bad frames so far were of this probe.
                    self.foreign += self.corrupt.total()
                    self.corrupt.clear()
                firmware = str(hello.fields["firmware"])
                events.append(OtherSchema(probe_id.hex(), fingerprint, firmware, hello))
            return
        self._is_foreign = False
        is_first = self.probe is None or self.probe.probe_id != probe_id.hex()
        if is_first:
            if self.probe is not None:
                events.extend(self.close())
            self.probe = self._find(probe_id.hex())
        probe = self.probe
        if probe is None:
            return
        if not probe.hello:
            probe.learn(hello, frame.content)
        waiting = [*self._waiting, frame]
        self._waiting.clear()
        boots = probe.account.boots
        told: list[Event] = []
        for each in waiting:
            self._note(probe, each, told)
        is_restart = boots > 0 and probe.account.boots > boots
        is_heard = any(isinstance(e, Received) and e.message is hello for e in told)
        if is_heard:
            probe.learn(hello, frame.content)
        if is_first or is_restart:
            events.append(ProbeFound(probe.probe_id, hello, is_restart))
        events.extend(told)

    def _note(self, probe: Probe, frame: DecodedFrame, events: list[Event]) -> None:
        for judged in probe.account.note(frame):
            self._tell(probe, judged, events)

    def _tell(self, probe: Probe, judged: Judged, events: list[Event]) -> None:
        frame = judged.frame
        if judged.begins_boot:
            probe.clock = Clock(probe.clock.rate)
        if judged.verdict is Verdict.GOOD and isinstance(frame.decoded, Message):
            if frame.decoded.name == "params":
                probe.params_parts.take(frame.decoded)
            stamp = probe.stamp(frame, frame.decoded, self._timeline, self.byte_ns)
            events.append(Received(probe, frame.decoded, frame.content, stamp))
        else:
            skew = frame.decoded if isinstance(frame.decoded, Skew) else None
            events.append(Refused(probe.probe_id, judged.verdict, skew))
