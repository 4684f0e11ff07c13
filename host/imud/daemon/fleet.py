# SPDX-License-Identifier: MIT
"""The probes: what each has said, on which port, and its status, out to the hub."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

import msgspec

from imud.config.settings import Config
from imud.daemon.hub import Hub
from imud.journal.phrases import FAULTS, event_words, port_problem, who
from imud.journal.speaker import Speaker
from imud.probes.balance import balance
from imud.probes.ledger import Verdict, totals
from imud.probes.record import Presence, Record, Stamp, equipment_of, plain, record_of
from imud.probes.session import (
    Event,
    OtherSchema,
    Probe,
    ProbeFound,
    Received,
    Refused,
    Session,
)
from imud.probes.timeline import Timeline, host_ns
from imud.stages.twin import Began, Differs, Lost, Twin, WantsRaw, WantsRestart
from imud.version import version
from imud.wire.messages import Message

STATUS_S = 1.0

# More are a device that makes up ids: 64 at 200 Hz fill a core.
PROBES_MAX = 256

# As many are told of one by one at the end.
TOLD_MAX = 4

# Names of the sinks whose counts are in the status.
NETWORK, LOG = "zenoh", "log"

Want = WantsRaw | WantsRestart

logger = logging.getLogger("imud")


class Wire(Protocol):
    """What is known here of a port."""

    name: str
    session: Session | None

    @property
    def baud(self) -> int: ...
    def write(self, data: bytes) -> None: ...
    def listen_again(self) -> None: ...


def _twin(watched: Watched) -> dict[str, Any]:
    """How the twin of a probe does."""
    twin = watched.twin
    return {
        "state": twin.state.value if twin is not None else "off",
        "compared": twin.compared if twin is not None else 0,
        "differed": twin.differed if twin is not None else 0,
        "lost": watched.twin_lost,
        "first_difference": watched.first_difference,
    }


class LogState(msgspec.Struct, frozen=True):
    """Whether there is a log: on, paused or off; and why it pauses."""

    state: str
    reason: str | None = None


class Watched:
    """What the daemon keeps of one probe beside its account."""

    def __init__(self, probe: Probe, name: str, *, has_twin: bool) -> None:
        self.probe = probe
        self.name = name
        self.twin = Twin() if has_twin else None
        self.twin_lost: dict[str, Any] | None = None
        self.first_difference: dict[str, Any] | None = None
        self.port: Wire | None = None
        self.other: OtherSchema | None = None  # why it can't be read
        self.is_alive = False
        self.told_who = ""
        self.counters: dict[str, Any] = {}
        self.numbered = 0  # the sequence number that they came with
        self.received = 0
        self.put = 0  # records to the hub
        self.equipment: dict[str, Any] | None = None  # a board may have none
        self.pose: Mapping[str, Any] = {}
        self.poses = 0
        self.poses_before = 0
        self.pose_rate_hz = 0.0
        self.heard_ns = -1  # host's time of the latest message
        self.last_heard_ns = 0  # UTC
        self.stamp: Stamp | None = None  # of the latest message
        self.corrupt_before = 0
        self.told: tuple[int, int, int, int] = (0, 0, 0, 0)
        self.commanding = asyncio.Lock()

    def farewell(self) -> str:
        """What came of it, on one line."""
        text = f"probe {self.name}: {self.received} received, {self.lost} lost"
        if self.twin is not None:
            text += f", {self.twin.differed} of {self.twin.compared} poses differ"
        return text

    @property
    def lost(self) -> int:
        """Of all boots."""
        return self.probe.account.lost


class Fleet:
    """All probes that were heard. What they say goes to the hub; answers to commands
    and what a twin needs go to whoever commands.
    """

    def __init__(self, config: Config, hub: Hub, speaker: Speaker) -> None:
        self._config = config
        self._hub = hub
        self._speaker = speaker
        self._encoder = msgspec.json.Encoder()
        self._probes: dict[str, Watched] = {}
        self._names: dict[str, Watched] = {}
        self._told_others: set[tuple[object, ...]] = set()
        self._logging = LogState("on" if config.log.enabled else "off")
        # Of several readings the one with the least between both.
        self.timeline = Timeline(max(time.time_ns() - host_ns() for _ in range(5)))
        self._read_ns = host_ns()  # when the last bytes came, of whichever probe
        self.on_reply: Callable[[Watched, Received], None] = lambda *_: None
        self.on_want: Callable[[str, Want], None] = lambda *_: None
        self.on_found: Callable[[str], None] = lambda _: None
        self.on_status: Callable[[Mapping[str, Any]], None] = lambda _: None

    def __iter__(self) -> Iterator[Watched]:
        return iter(self._probes.values())

    def named(self, name: str) -> Watched | None:
        return self._names.get(name)

    def configure(self, config: Config) -> dict[str, str]:
        """Takes up what was changed; the old and new names of who is called otherwise.

        What was put under an old name must not come after this: see `announce`.
        """
        has_twin = config.twin
        if has_twin != self._config.twin:
            for watched in self:
                watched.twin = Twin() if has_twin else None
        self._config = config
        renamed: dict[str, str] = {}
        for watched in self:
            name = config.name_of(watched.probe.probe_id)
            if name != watched.name:
                renamed[watched.name] = name
                watched.name = name
        self._names = {watched.name: watched for watched in self}
        return renamed

    def announce(self) -> None:
        """Says who is there, for sinks that have just been opened."""
        for watched in self:
            self._hub.put(Presence(watched.name, watched.is_alive))
            self._publish_status(watched)

    def probe(self, probe_id: str) -> Probe:
        """The one of that id, whichever port it speaks on."""
        watched = self._probes.get(probe_id)
        if watched is None:
            name = self._config.name_of(probe_id)
            watched = Watched(Probe(probe_id), name, has_twin=self._config.twin)
            self._probes[probe_id] = self._names[name] = watched
        return watched.probe

    def holder(self, probe_id: str, port: Wire, since_ns: int) -> Wire | None:
        """The other port on which that probe was heard since then."""
        watched = self._probes.get(probe_id)
        if watched is None or watched.port is None or watched.port is port:
            return None
        return watched.port if watched.heard_ns >= since_ns else None

    def has_room(self, probe_id: str) -> bool:
        """For that probe, which may be known; told where there is none."""
        if probe_id in self._probes or len(self._probes) < PROBES_MAX:
            return True
        self._speaker.say(
            "full",
            f"{PROBES_MAX} probes were heard, and probe {probe_id} is left out; is "
            "there a device that makes up ids? Unplug it, and start imud run anew",
            is_warning=True,
        )
        return False

    def farewell(self) -> str:
        """What came of them, on one line."""
        if len(self._probes) <= TOLD_MAX:
            said = "; ".join(watched.farewell() for watched in self)
            return said or "no probe was heard"
        received = sum(watched.received for watched in self)
        lost = sum(watched.lost for watched in self)
        return f"{len(self._probes)} probes: {received} received, {lost} lost"

    def missing(self) -> list[str]:
        """Ids of the probes that were heard and are on no port."""
        return [id_ for id_, watched in self._probes.items() if watched.port is None]

    def tell_double(self, probe_id: str, holder: Wire, port: Wire) -> None:
        self._speaker.say(
            ("twice", probe_id),
            f"probe {self._probes[probe_id].name} is on {holder.name} and on "
            f"{port.name}, which is left out; are there two with one id?",
            is_warning=True,
        )

    def _put(self, watched: Watched, record: Record) -> None:
        watched.put += 1
        self._hub.put(record)

    def port_ended(self, session: Session, port: Wire) -> None:
        for watched in self._probes.values():
            if watched.port is port:
                watched.corrupt_before += session.corrupt.total()
        self._leave(port)

    def _leave(self, port: Wire, stays: str | None = None) -> None:
        """Who was on that port is on it no longer; only the one of that id is."""
        for probe_id, watched in self._probes.items():
            if watched.port is port and probe_id != stays:
                watched.port = None
                self._set_alive(watched, is_alive=False)
                self._publish_status(watched)

    def take_other(self, event: OtherSchema, port: Wire) -> None:
        self._leave(port, event.probe_id)
        self.probe(event.probe_id)
        watched = self._probes[event.probe_id]
        watched.port = port
        watched.other = event
        # Said once for each build of its firmware, however often its port is opened.
        kind = ("schema", event.probe_id, event.firmware, event.fingerprint)
        if kind not in self._told_others:
            self._told_others.add(kind)
            logger.warning("%s", port_problem(port.name, event, (port.baud,)))

    def take(self, event: Event, port: Wire) -> None:
        if isinstance(event, ProbeFound):
            self._found(event, port)
        elif isinstance(event, Received):
            self._received(event)
        elif isinstance(event, Refused):
            self._refused(event)

    def _found(self, event: ProbeFound, port: Wire) -> None:
        self._leave(port, event.probe_id)
        watched = self._probes[event.probe_id]
        watched.port = port
        watched.other = None
        watched.told_who = who(event.hello)
        if watched.twin is not None:
            watched.twin.appear()
        what = "restarted" if event.is_restart else "found"
        text = f"probe {watched.name} {what} on {port.name}: {watched.told_who}"
        self._speaker.say(
            ("found", event.probe_id, what), text, is_warning=event.is_restart
        )
        self._set_alive(watched, is_alive=True)
        self._publish_status(watched)
        self.on_found(watched.name)

    def _received(self, event: Received) -> None:
        watched = self._probes[event.probe.probe_id]
        message = event.message
        stamp = event.stamp
        watched.heard_ns = self._read_ns
        watched.last_heard_ns = stamp.t_received_ns or self._now_ns()
        watched.stamp = stamp
        record = record_of(
            message,
            event.content,
            watched.name,
            stamp,
            event.probe.hello,
            event.probe.hello_content,
        )
        watched.received += 1
        self._put(watched, record)
        if message.name == "pose":
            watched.poses += 1
            watched.pose = record.said
        if message.name == "status":
            watched.counters = dict(message.fields)
            watched.numbered = message.sequence
        elif message.name == "equipment":
            watched.equipment = equipment_of(message.fields)
        elif message.name == "event":
            self._tell_event(watched, message)
        elif message.name == "reply":
            self.on_reply(watched, event)
        elif message.name == "hello" and who(message) != watched.told_who:
            watched.told_who = who(message)
            text = f"probe {watched.name} is {watched.told_who}"
            self._speaker.say(("who", watched.name), text)
        if not watched.is_alive:
            self._set_alive(watched, is_alive=True)
        if watched.twin is not None:
            self._compare(watched, watched.twin, event)

    def _compare(self, watched: Watched, twin: Twin, event: Received) -> None:
        """What the twin makes of a message."""
        state = twin.state
        outcome = twin.take(event.message, event.content)
        name = watched.name
        place = {
            "seq": event.message.sequence,
            "t_device_us": event.stamp.t_device_us,
            "t_ns": event.stamp.t_ns,
        }
        if isinstance(outcome, WantsRaw | WantsRestart):
            self.on_want(name, outcome)
        elif isinstance(outcome, Began):
            watched.twin_lost = None
            self._speaker.say(
                ("twin", name, Began),
                f"probe {name}: its twin follows from #{outcome.sequence} on",
            )
        elif isinstance(outcome, Lost):
            watched.twin_lost = place | {
                "seq": outcome.sequence,
                "reason": outcome.reason,
            }
            self._speaker.say(
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
            self._speaker.say(
                ("twin", name, Differs),
                f"probe {name}: pose #{outcome.sequence} is not what its samples give: "
                f"{', '.join(outcome.fields)} differ",
                is_warning=True,
            )
        if twin.state is not state:
            described = {"type": "twin", "probe": name, **place, **_twin(watched)}
            payload = self._encoder.encode(described)
            sequence, t_ns = event.message.sequence, watched.last_heard_ns
            self._put(watched, Record(name, "twin", payload, b"", sequence, t_ns, t_ns))

    def _refused(self, event: Refused) -> None:
        watched = self._probes[event.probe_id]
        if event.skew is not None:
            self._speaker.say(
                ("skew", event.probe_id, event.skew.kind),
                f"probe {watched.name}: skewed message ({event.skew.kind}): "
                f"{event.skew.detail}",
                is_warning=True,
            )
        elif event.verdict is not Verdict.DUPLICATE:
            self._speaker.say(
                ("stray", event.probe_id),
                f"probe {watched.name}: a message out of its order is left out",
                is_warning=True,
            )

    def _tell_event(self, watched: Watched, message: Message) -> None:
        fields = {name: plain(value) for name, value in message.fields.items()}
        name, cause = str(fields["event"]), str(fields["cause"])
        words = event_words(name, cause, int(fields["detail"]))
        text = f"probe {watched.name}: {words}"
        self._speaker.say(
            ("event", watched.name, name, cause), text, is_warning=name in FAULTS
        )

    def _set_alive(self, watched: Watched, *, is_alive: bool) -> None:
        if watched.is_alive != is_alive:
            watched.is_alive = is_alive
            self._hub.put(Presence(watched.name, is_alive))

    def tick(self, elapsed_s: float) -> Iterator[None]:
        """Once a second: rates, the status of each probe, what was lost. A step takes
        about a millisecond, between which others may do something.
        """
        self.follow_host()
        self._follow_log()
        for watched in list(self._probes.values()):
            poses = watched.poses - watched.poses_before
            watched.poses_before = watched.poses
            watched.pose_rate_hz = poses / elapsed_s
            self._publish_status(watched)
            self._tell_losses(watched)
            yield

    def follow_host(self, read_ns: int | None = None) -> None:
        """Whether the host's clock was set; called before what came is dated."""
        if read_ns is not None:
            self._read_ns = read_ns
        before_ns, utc_ns = host_ns(), time.time_ns()
        step_ns = self.timeline.follow(before_ns, utc_ns, host_ns())
        if step_ns == 0:
            return
        self._speaker.say(
            "host clock",
            f"this machine's clock was set by {step_ns / 1e9:+.3f} s"
            + (", which is made up slowly" if step_ns < 0 else ""),
            is_warning=True,
        )
        t_ns = self._now_ns()
        for watched in self._probes.values():
            name = watched.name
            said = {"type": "clock", "probe": name, "t_ns": t_ns, "step_ns": step_ns}
            payload = self._encoder.encode(said)
            record = Record(name, "clock", payload, b"", 0, t_ns, t_ns, said=said)
            self._put(watched, record)

    def _follow_log(self) -> None:
        """Whether records are logged; the hub says why not, in the journal."""
        reason = self._hub.trouble(LOG)
        state = "off" if reason is None else "paused" if reason else "on"
        before, self._logging = self._logging, LogState(state, reason or None)
        if state == before.state:
            return
        t_ns = self._now_ns()
        for watched in self._probes.values():
            if not self._is_logged(watched):
                continue
            name = watched.name
            said = {"type": LOG, "probe": name, "t_ns": t_ns}
            said |= msgspec.structs.asdict(self._logging)
            said["dropped"] = self._hub.dropped(name).get(LOG, 0)
            payload = self._encoder.encode(said)
            self._put(watched, Record(name, LOG, payload, b"", 0, t_ns, t_ns))

    def _is_logged(self, watched: Watched) -> bool:
        return self._config.settings_of(watched.probe.probe_id).log

    def _now_ns(self) -> int:
        return self.timeline.utc(host_ns())

    def _clock(self, watched: Watched, session: Session | None) -> dict[str, Any]:
        """How a probe's clock is known."""
        clock, stamp, timeline = watched.probe.clock, watched.stamp, self.timeline
        rate_ppm, now_ns = clock.rate_ppm, host_ns()
        offset_ns = None
        if stamp is not None and stamp.t_ns is not None:
            offset_ns = stamp.t_ns - 1000 * stamp.t_device_us
        skewed = Counter(watched.probe.account.skewed)
        if session is not None:
            skewed += session.headless
        return {
            "t_device_us": stamp.t_device_us if stamp is not None else 0,
            "t_ns": watched.last_heard_ns,
            "offset_ns": offset_ns,
            "skew_ppm": None if rate_ppm is None else round(rate_ppm, 2),
            "bound_us": None
            if stamp is None or stamp.t_bound_ns is None
            else round(stamp.t_bound_ns / 1000),
            "exchanges": clock.exchanges,
            "restarts": clock.restarts,
            "host_steps": timeline.steps,
            "host_last_step_ns": timeline.last_step_ns,
            "host_ahead_ns": timeline.ahead(now_ns, timeline.utc(now_ns)),
            "data_skew": dict(sorted(skewed.items())),
        }

    def _corrupt(self, watched: Watched) -> int:
        session = watched.port.session if watched.port is not None else None
        return watched.corrupt_before + (session.corrupt.total() if session else 0)

    def _tell_losses(self, watched: Watched) -> None:
        total = totals(watched.probe.account.counts())
        told = (
            total.lost,
            self._corrupt(watched),
            total.duplicated,
            sum(self._hub.dropped(watched.name).values()),
        )
        fresh = [now - then for now, then in zip(told, watched.told, strict=True)]
        words = ("lost", "corrupt", "duplicated", "dropped by a slow or failing sink")
        text = ", ".join(
            f"{n} {word}" for n, word in zip(fresh, words, strict=True) if n > 0
        )
        if text:
            kind, line = ("losses", watched.name), f"probe {watched.name}: {text}"
            if self._speaker.say(kind, line, is_warning=True, is_total=True):
                watched.told = told

    def _publish_status(self, watched: Watched) -> None:
        t_ns = self._now_ns()
        probe = watched.probe
        hello = probe.hello
        if watched.other is not None:
            hello = dict(watched.other.hello.fields)
        port = watched.port
        session = port.session if port is not None else None
        state = watched.counters.get("state", "unknown")
        is_heard = host_ns() - watched.heard_ns < 3 * STATUS_S * 1e9
        if port is None:
            state = "gone"
        elif watched.other is not None:
            state = "other schema"
        elif not is_heard:
            state = "silent"
        counts: Any = probe.account.counts()
        sinks = self._hub.counts(watched.name)
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
                for key in (
                    *("tilt_sigma_deg", "heading_sigma_deg", "flags"),
                    *("age_us", "t_bound_us"),
                )
            },
            "ledger": {
                **counts,
                "corrupt": self._corrupt(watched),
                "published": self._hub.taken(watched.name, NETWORK),
                "logged": self._hub.taken(watched.name, LOG)
                if self._is_logged(watched)
                else {},
                "dropped": {sink: of.dropped for sink, of in sinks.items()},
                **balance(
                    counts,
                    watched.counters,
                    watched.numbered,
                    watched.received,
                    watched.put,
                    sinks,
                ),
            },
            "log": self._logging if self._is_logged(watched) else LogState("off"),
            "link": session.counts() if session is not None else None,
            "clock": self._clock(watched, session),
            "twin": _twin(watched),
            "counters": watched.counters,
            "equipment": watched.equipment,
            "hello": {name: plain(value) for name, value in hello.items()},
            "imud": version(),
        }
        self.on_status(status)
        payload = self._encoder.encode(status)
        record = Record(watched.name, "status", payload, b"", 0, t_ns, t_ns)
        self._put(watched, record)
