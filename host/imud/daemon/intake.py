# SPDX-License-Identifier: MIT
"""Events from all ports: good messages go to the hub and to the stages, losses and
faults to the journal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from imud.config.settings import Config
from imud.daemon.host_clock import HostClock
from imud.daemon.hub import Hub
from imud.daemon.lines import ProbeLines
from imud.daemon.log_state import LogWatch
from imud.daemon.params_watch import ParamsWatch
from imud.daemon.publisher import COMMAND, MARK, RecordPublisher
from imud.daemon.registry import MakeStages, ProbeEntry, ProbePort, Registry
from imud.daemon.reports import Reports
from imud.daemon.sensor_watch import follow_event, follow_status, sensor_findings
from imud.daemon.stage_runner import StageRunner
from imud.errors import CommandRefused
from imud.journal.output import Journal
from imud.probes.gestures import Gestures
from imud.probes.mark import MARKS, MarkBook
from imud.probes.record import equipment_of, record_of
from imud.probes.session import (
    Event,
    OtherSchema,
    Probe,
    ProbeFound,
    Received,
    Rejected,
    Session,
)
from imud.probes.timeline import Timeline, host_ns
from imud.stages import COMPUTED
from imud.stages.factory import stages_of

Values = Mapping[str, Any]

# The state of a probe from an event on.
STREAMING = {"stream_started": "streaming", "stream_stopped": "idle"}
SHORT = 60  # characters of a parameter in what is told of a command


class Intake:
    """The listener of all ports. Answers to commands go to `on_reply`; `on_found` hears
    the name of each probe that appears or restarts, `on_gesture` what the button of one
    is to do.
    """

    def __init__(
        self,
        config: Config,
        hub: Hub,
        journal: Journal,
        make_stages: MakeStages = stages_of,
    ) -> None:
        self.registry = Registry(config, make_stages)
        self._publisher = RecordPublisher(hub)
        self._lines = ProbeLines(journal)
        self._clock = HostClock(self.registry, self._publisher, self._lines)
        log = LogWatch(self.registry, hub, self._publisher, is_on=config.log.enabled)
        self.reports = Reports(
            self.registry, hub, self._publisher, self._lines, self._clock, log
        )
        self.stages = StageRunner(self._publisher, self._lines)
        self.params = ParamsWatch(self.registry, self._publisher)
        self.marks = MarkBook()
        self._read_ns = host_ns()  # when the last bytes came, of whichever probe
        self.on_reply: Callable[[ProbeEntry, Received], None] = lambda *_: None
        self.on_found: Callable[[str], None] = lambda _: None
        self.on_gesture: Callable[[ProbeEntry, str], None] = lambda *_: None
        # What a message of each name changes here, beside being published.
        self._takers: dict[str, Callable[[ProbeEntry, Received, Values], None]] = {
            "pose": self._pose,
            "raw": self._raw,
            "status": self._status,
            "equipment": self._equipment,
            "event": self._event,
            "reply": self._reply,
            "hello": self._hello,
            "self_test": self._self_test,
            "params": self._params,
        }

    @property
    def timeline(self) -> Timeline:
        return self._clock.timeline

    def follow_host(self, read_ns: int) -> None:
        """Called with the host's time of a read, before what it brought is dated."""
        self._read_ns = read_ns
        self._clock.follow()

    def look(self) -> None:
        """Whether imud could run, and the host's clock was set; often, also if nothing
        is read.
        """
        self._clock.follow()

    def _follow_clock(self, entry: ProbeEntry) -> None:
        clock = entry.probe.clock
        entry.refits = clock.refits
        if clock.refits:  # not of a boot that has just begun
            self._clock.notice_refit(entry, clock.refit)

    def probe(self, probe_id: str) -> Probe:
        """The one of that id, whichever port it speaks on."""
        entry = self.registry.add(probe_id)
        if entry.heard_ns < 0:
            entry.heard_ns = self._read_ns  # what has just come is from it
        return entry.probe

    def holder(self, probe_id: str, port: ProbePort, since_ns: int) -> ProbePort | None:
        """The other port on which that probe was heard since then (host's time)."""
        return self.registry.holder(probe_id, port, since_ns)

    def has_room(self, probe_id: str) -> bool:
        """Whether that probe may be taken up; told where it may not."""
        has_room = self.registry.has_room(probe_id)
        if not has_room and (gone := self.registry.forget(self._read_ns)) is not None:
            self._publisher.forget(gone)
            self.reports.on_forgotten(gone.probe.probe_id)
            has_room = True
        if not has_room:
            self._lines.no_room(probe_id)
        return has_room

    def missing(self) -> list[str]:
        return self.registry.missing()

    def on_double(self, probe_id: str, holder: ProbePort, port: ProbePort) -> None:
        self._lines.twice(self.registry[probe_id], holder, port)

    def port_ended(self, session: Session, port: ProbePort) -> None:
        for entry in self.registry.on_port(port):
            entry.corrupt_before += session.corrupt.total()
        self._leave(port)

    def handle_other(self, event: OtherSchema, port: ProbePort) -> None:
        """A probe on that port speaks another schema."""
        self._leave(port, event.probe_id)
        entry = self.registry.add(event.probe_id)
        entry.port = port
        entry.other = event
        self._lines.other_schema(event, port)

    def close_path(self, entry: ProbeEntry) -> dict[str, Any]:
        """Publishes the path of its strokes, closed, and returns it; CommandRefused if
        there is none.
        """
        closing = entry.closing()
        if closing is None:
            raise CommandRefused(
                "there is no path to close: its origin is unknown, or its last stroke "
                "has no length; set an origin first"
            )
        self._publisher.say_closing(entry, closing, "command", self._clock.now_ns())
        return closing

    def tell_command(
        self,
        entry: ProbeEntry,
        command: str,
        parameters: Mapping[str, str],
        by: str,
        refused: str | None = None,
    ) -> None:
        """Publishes a command that was carried out, or `refused`, and who gave it."""
        t_ns = self._clock.now_ns()
        short = {name: value[:SHORT] for name, value in parameters.items()}
        told = {"t_ns": t_ns, "command": command, "parameters": short, "by": by}
        told["refused"] = refused
        self._publisher.say(entry, COMMAND, told, t_ns)

    def mark(self, entry: ProbeEntry, values: Mapping[str, Any]) -> dict[str, Any]:
        """Publishes a mark that was made or changed now, and returns it."""
        t_ns = self._clock.now_ns()
        about = {"id": str(t_ns), "probe_id": entry.probe.probe_id}
        told = {**about, **values, "t_ns": t_ns}
        published = self._publisher.say(entry, MARK, told, t_ns)
        self.marks.take(told)
        self._tell_marks(entry)
        return published

    def recall(self, marks: Iterable[Mapping[str, Any]]) -> None:
        """Marks of earlier logs, the oldest first."""
        for mark in marks:
            self.marks.take({k: v for k, v in mark.items() if k != "probe"})
        self.announce_marks()

    def announce_marks(self) -> None:
        """Says all marks again, for sinks that have just been opened."""
        for entry in self.registry:
            self._tell_marks(entry)

    def _tell_marks(self, entry: ProbeEntry) -> None:
        if marks := self.marks.of(entry.probe.probe_id):
            t_ns = self._clock.now_ns()
            self._publisher.say(entry, MARKS, {"t_ns": t_ns, "marks": marks}, t_ns)

    def handle(self, event: Event, port: ProbePort) -> None:
        if isinstance(event, Received):
            self._received(event)
        elif isinstance(event, ProbeFound):
            self._found(event, port)
        elif isinstance(event, Rejected):
            self._lines.rejected(self.registry[event.probe_id], event)

    def _leave(self, port: ProbePort, stays: str | None = None) -> None:
        """All probes on that port are gone, but the one of that id."""
        for entry in self.registry.on_port(port):
            if entry.probe.probe_id != stays:
                entry.port = None
                self._publisher.set_alive(entry, is_alive=False)
                self.reports.publish(entry)

    def _found(self, event: ProbeFound, port: ProbePort) -> None:
        self._leave(port, event.probe_id)
        entry = self.registry[event.probe_id]
        entry.port = port
        entry.other = None
        entry.fault = None
        entry.gestures = Gestures()
        self.stages.on_probe_found(entry, event)
        self._lines.found(entry, event, port)
        # Its status first: who sees that it is there may ask for that at once.
        self.reports.publish(entry)
        self._publisher.set_alive(entry, is_alive=True)
        self._tell_marks(entry)
        self.on_found(entry.name)

    def _received(self, event: Received) -> None:
        probe, message, stamp = event.probe, event.message, event.stamp
        entry = self.registry[probe.probe_id]
        entry.heard_ns = self._read_ns
        entry.last_heard_ns = stamp.t_received_ns or self._clock.now_ns()
        entry.stamp = stamp
        entry.received += 1
        is_replaced = self.stages.replaces(entry, message.name)
        if message.name in COMPUTED:
            stamp = entry.numbered(message.name, stamp, is_published=not is_replaced)
        record = record_of(
            message,
            event.content,
            entry.name,
            stamp,
            event.scales,
            entry.north,
            entry.host_flags,
            probe.references,
            is_frame_only=is_replaced,
        )
        self._publisher.put(entry, record)
        if probe.clock.refits != entry.refits:
            self._follow_clock(entry)
        take = self._takers.get(message.name)
        if take is not None and not is_replaced:
            take(entry, event, record.values)
        if not entry.is_alive:
            self._publisher.set_alive(entry, is_alive=True)
        self.stages.on_message(entry, event)
        if message.name != "event" and entry.gestures.clicked_us is None:
            return
        gesture = entry.gesture(str(message.fields.get("event")), event.stamp)
        if gesture == ("double", "path"):
            closing = entry.closing(is_double=True)
            if closing is not None:
                self._publisher.say_closing(entry, closing, "button", record.t_ns)
        elif gesture is not None:
            self.on_gesture(entry, gesture[1])

    def _pose(self, entry: ProbeEntry, _: Received, values: Values) -> None:
        entry.poses += 1
        entry.take_pose(values)

    def _raw(self, entry: ProbeEntry, _: Received, values: Values) -> None:
        entry.take_temperature(values["temperature_c"])

    def _status(self, entry: ProbeEntry, event: Received, _: Values) -> None:
        fields = event.message.fields
        entry.counters = dict(fields)
        warmth = fields["temperature"]
        entry.take_temperature(warmth if isinstance(warmth, float) else None)
        entry.counters_sequence = event.message.sequence
        follow_status(entry)

    def _equipment(self, entry: ProbeEntry, event: Received, _: Values) -> None:
        entry.equipment = equipment_of(event.message.fields)

    def _event(self, entry: ProbeEntry, event: Received, _: Values) -> None:
        follow_event(entry, event.message)
        if (name := event.message.fields["event"]) in STREAMING:
            entry.counters["state"] = STREAMING[str(name)]  # until its next status
        self._lines.event(entry, event.message)

    def _reply(self, entry: ProbeEntry, event: Received, _: Values) -> None:
        self.on_reply(entry, event)

    def _hello(self, entry: ProbeEntry, event: Received, values: Values) -> None:
        self._lines.described(entry, event.message)
        self._self_test(entry, event, values)
        self._params(entry, event, values)

    def _self_test(self, entry: ProbeEntry, _: Received, __: Values) -> None:
        self._lines.sensors(entry, sensor_findings(entry))

    def _params(self, entry: ProbeEntry, _: Received, __: Values) -> None:
        self.params.follow(entry, self._clock.now_ns())
