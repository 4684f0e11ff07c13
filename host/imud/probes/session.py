# SPDX-License-Identifier: MIT
"""Turns the bytes of one opening of a port into events. No I/O; time is an argument.

A message is passed on once its probe is known, which takes a hello; messages before it
wait. Everything that is not passed on is counted, here or in the account.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from enum import Enum, auto
from typing import Any

import msgspec

from imud.probes.boot import DecodedFrame
from imud.probes.ledger import FrameVerdict, Judged
from imud.probes.probe import TELLING
from imud.probes.probe import Probe as Probe  # of whom all events are
from imud.probes.record import Stamp
from imud.probes.scales import UNKNOWN, Scales
from imud.probes.timeline import Timeline
from imud.wire import kept, messages
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message, Skew

# Messages that may wait for a hello, which comes every second: two seconds of 760 raw
# messages and as many poses.
WAITING_MAX = 3072

# A hello and a status come every second: so long without a good frame is a fault.
SILENT_NS = 3_000_000_000

# Up to this many bytes without a good frame may be part of one, or noise at power-on;
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
    scales: Scales = UNKNOWN  # of that moment

    @property
    def probe_id(self) -> str:
        return self.probe.probe_id

    @property
    def params(self) -> bytes | None:
        """The records in force when it was sent; None: not known."""
        return self.scales.params


class Rejected(msgspec.Struct, frozen=True):
    """A frame that passed its CRC and is not passed on."""

    probe_id: str
    verdict: FrameVerdict
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
    """A port is open, and no bytes come."""

    seconds: float


Event = ProbeFound | Received | Rejected | OtherSchema | OnlyNoise | Silent


class Speaking(Enum):
    """The probe on the port, as far as known from its hellos.

                  a hello of a kept schema
    UNNAMED ---------------------------------> OURS
       |                                       |  ^
       |     a hello of another schema         v  |  a hello of a kept schema
       +------------------------------------> FOREIGN
    """

    UNNAMED = auto()  # no hello yet: messages wait for one
    OURS = auto()  # the session's `probe`
    FOREIGN = auto()  # bad frames are those of a probe with a schema that is not kept


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
        hello = presumed.hello if presumed is not None else {}
        self._decoder = FrameDecoder(hello.get("schema_fingerprint"))
        self._has_delimiter = False
        self._waiting: deque[DecodedFrame] = deque()
        self._speaking = Speaking.UNNAMED if presumed is None else Speaking.OURS
        self._tallied = Counter[str]()
        self._bad = 0
        self._heard_ns = self._good_ns = t_ns
        self._bytes_since_good = 0
        self._reported: set[type[Event]] = set()  # since the last good frame
        self.probe = presumed
        self.bytes = 0
        self.corrupt = Counter[str]()  # bad frames, without those counted below
        self.partial = 0  # frames cut off by opening the port
        self.foreign = 0  # frames of a probe with another schema
        self.unnamed = 0  # good messages for which no hello came in time
        self.headless: Counter[str] = Counter()  # skewed, without a sequence number

    def counts(self) -> dict[str, Any]:
        """What came through the port so far, as the status has it."""
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
        """Takes bytes that arrived at `t_ns`, in any chunks; returns what happened, in
        order. Damage is counted and never raised; None: the time is not known, as in a
        capture.
        """
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
        if self._speaking is Speaking.FOREIGN:
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
        silence_ns = self._timeline.silence(self._heard_ns, t_ns)
        is_noise = self._bytes_since_good > NOISE_BYTES
        event: Event
        bad_ns = self._timeline.silence(self._good_ns, t_ns)
        if is_noise and bad_ns > SILENT_NS:
            event = OnlyNoise(self._bytes_since_good)
        elif silence_ns > SILENT_NS:
            event = Silent(silence_ns / 1e9)
        else:
            return []
        if type(event) in self._reported:
            return []
        self._reported.add(type(event))
        return [event]

    def close(self) -> list[Event]:
        """Ends the session: judges or counts what waits."""
        events: list[Event] = []
        if self.probe is not None:
            for judged in self.probe.account.close():
                self._emit(self.probe, judged, events)
        self.unnamed += len(self._waiting)
        self._waiting.clear()
        return events

    def _feed(self, data: bytes, t_ns: int | None, events: list[Event]) -> None:
        self._bytes_since_good += len(data)
        for content in self._decoder.feed(data):
            self._bytes_since_good = 0
            self._good_ns = t_ns
            if self._reported:
                self._reported.clear()
            self._on_content(content, t_ns, events)

    def receive_content(
        self, content: bytes, t_ns: int | None, t_sample_ns: int | None = None
    ) -> list[Event]:
        """Takes the content of one frame whose CRC is right; `t_sample_ns`: UTC of its
        sample, if it is known and not to be computed.
        """
        events: list[Event] = []
        self._on_content(content, t_ns, events, t_sample_ns)
        return events

    def _on_content(
        self,
        content: bytes,
        t_ns: int | None,
        events: list[Event],
        t_sample_ns: int | None = None,
    ) -> None:
        decoded = messages.decode(content)
        name = decoded.name if isinstance(decoded, Message) else ""
        if name in messages.FROM_HOST:
            detail = f"{name} has the wrong direction"
            decoded = Skew("unknown_message", detail, decoded.sequence, decoded.time_us)
        if decoded.sequence is None or decoded.time_us is None:
            if isinstance(decoded, Skew):
                self.headless[decoded.kind] += 1
            return
        frame = DecodedFrame(
            content, decoded, decoded.sequence, decoded.time_us, t_ns, t_sample_ns
        )
        if name == "hello" and isinstance(decoded, Message):
            self._on_hello(frame, decoded, events)
        elif self.probe is None:
            if len(self._waiting) == WAITING_MAX:
                self._waiting.popleft()
                self.unnamed += 1
            self._waiting.append(frame)
        else:
            self._note(self.probe, frame, events)

    def _on_hello(
        self, frame: DecodedFrame, hello: Message, events: list[Event]
    ) -> None:
        probe_id = hello.fields["probe_id"]
        fingerprint = hello.fields["schema_fingerprint"]
        if not isinstance(probe_id, bytes) or not isinstance(fingerprint, int):
            self.headless["impossible_value"] += 1
            return
        if kept.find(fingerprint) is None:
            before, self._speaking = self._speaking, Speaking.FOREIGN
            if before is not Speaking.FOREIGN:
                if before is Speaking.UNNAMED:
                    # The bad frames so far were of this probe.
                    self.foreign += self.corrupt.total()
                    self.corrupt.clear()
                firmware = str(hello.fields["firmware"])
                events.append(OtherSchema(probe_id.hex(), fingerprint, firmware, hello))
            return
        self._speaking = Speaking.OURS
        found = self.probe
        if found is None or found.probe_id != probe_id.hex():
            found = self._find(probe_id.hex())  # in a log it has a name as its id
        is_first = self.probe is None or self.probe is not found
        if is_first:
            if self.probe is not None:
                events.extend(self.close())
            self.probe = found
        probe = self.probe
        if probe is None:
            return
        if not probe.hello:
            probe.update(hello, frame.content)
        waiting = [*self._waiting, frame]
        self._waiting.clear()
        boots = probe.account.boots
        after: list[Event] = []
        for each in waiting:
            self._note(probe, each, after)
        is_restart = boots > 0 and probe.account.boots > boots
        if is_first or is_restart:
            events.append(ProbeFound(probe.probe_id, hello, is_restart))
        events.extend(after)

    def _note(self, probe: Probe, frame: DecodedFrame, events: list[Event]) -> None:
        for judged in probe.account.note(frame):
            self._emit(probe, judged, events)

    def _emit(self, probe: Probe, judged: Judged, events: list[Event]) -> None:
        frame = judged.frame
        if judged.begins_boot:
            probe.begin_boot()
        if judged.verdict is FrameVerdict.GOOD and isinstance(frame.decoded, Message):
            message = frame.decoded
            if message.name in TELLING:
                probe.update(message, frame.content)
            stamp = probe.stamp(frame, message, self._timeline, self.byte_ns)
            events.append(Received(probe, message, frame.content, stamp, probe.scales))
        else:
            skew = frame.decoded if isinstance(frame.decoded, Skew) else None
            events.append(Rejected(probe.probe_id, judged.verdict, skew))
