# SPDX-License-Identifier: MIT
"""Which probes are known: by id and name, on which port, alive or not."""

from __future__ import annotations

import asyncio
import contextlib
import datetime
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

import msgspec

from imud.calibration.earth import Earth, earth_at
from imud.config.settings import BUTTON, GESTURES, Config, PlaceSettings
from imud.defaults import PROBES_MAX
from imud.errors import ParamsError
from imud.params.value import Params
from imud.probes.aim import Aim
from imud.probes.gestures import EVENTS, Gestures, PathCloser
from imud.probes.north import North
from imud.probes.path import scale_sigma
from imud.probes.record import Stamp
from imud.probes.sensors import SensorFinding
from imud.probes.session import OtherSchema, Probe, Session
from imud.probes.withheld import WithheldWatch
from imud.stages import Stage
from imud.stages.factory import stages_of

# A probe that is gone for so long makes room for another when there are PROBES_MAX.
FORGET_NS = 60_000_000_000
FEW_MESSAGES = 100

# Up to this many probes are listed one by one in the daemon's last line.
LISTED_MAX = 4

# So many failed transfers of samples, and a probe sets its sensor up again.
BURSTS_FAILED_MAX = 5

# By so much a temperature may differ from the one that is known: sensors are noisy.
TEMPERATURE_NOISE_DEGC = 1.0

MakeStages = Callable[[Config], list[Stage]]


class ProbePort(Protocol):
    """The interface of a probe's port for the daemon."""

    name: str
    session: Session | None

    @property
    def baud(self) -> int: ...
    def write(self, data: bytes) -> None: ...
    def listen_again(self) -> None: ...


class SensorFault(msgspec.Struct, frozen=True):
    """A probe's last report of its sensor, which may have failed since."""

    event: str
    cause: str
    detail: int

    @property
    def is_lasting(self) -> bool:
        """Whether the sensor is to be set up again: not for one failed transfer."""
        is_bus = self.event == "bus_fault" and self.cause != "stuck_bus"
        return not (is_bus and 0 < self.detail < BURSTS_FAILED_MAX)


class ProbeEntry:
    """The daemon's state of one probe, beside its account and its clock."""

    def __init__(self, probe_id: str, config: Config, stages: list[Stage]) -> None:
        self.probe = Probe(probe_id)
        self.name = config.name_of(probe_id)
        self.settings = config.settings_of(probe_id)
        self.is_logged = self.settings.log
        self.stages = stages
        # By kind of message: the last number heard, and by how much what was published
        # is ahead of it, where a stage computes what the probe sends, too.
        self._heard: dict[str, int] = {}
        self._ahead: dict[str, int] = {}
        self.port: ProbePort | None = None
        self.other: OtherSchema | None = None  # why its messages can't be read
        self.is_alive = False
        self.described = ""  # the journal's last words for who it is
        self.advised: str | None = None  # and for what its calibration needs
        self.withheld = WithheldWatch()  # and for why its errors are not known
        self.reported_boot = 0  # in which boot the findings were reported
        self.reported_findings: list[SensorFinding] = []  # about its sensors
        self.fault: SensorFault | None = None  # of its sensor, the latest
        self.host_flags: tuple[str, ...] = ()  # of its poses
        self.counters: dict[str, Any] = {}  # of its latest status message
        self.counters_sequence = 0  # number of that message
        self.received = 0  # good messages
        self.put = 0  # records given to the hub
        self.equipment: dict[str, Any] | None = None  # None: the board sends none
        self.pose: Mapping[str, Any] = {}
        self.pose_ns = -1  # when it was heard, host's time
        self.aim: Aim | None = None  # what it is to be brought to
        self.closer = PathCloser()
        self.gestures = Gestures()  # of its button
        self.temperature_c: float | None = None  # of the last raw sample, or status
        self.poses = 0
        self.poses_before = 0  # at the last tick
        self.pose_rate_hz = 0.0
        self.heard_ns = -1  # host's time of the latest message
        self.last_heard_ns = 0  # UTC
        self.stamp: Stamp | None = None  # of the latest message
        self.refits = 0  # of its clock that were told
        self.corrupt_before = 0  # on ports that it has left
        self.reported_losses: tuple[int, int, int, int] = (0, 0, 0, 0)
        self.commanding = asyncio.Lock()  # held while a command waits for its reply
        self.earth: Earth | None = None  # the field of its place
        self.north: North | None = None  # turns its poses to true north
        self._locate(config.place)

    def numbered(self, name: str, stamp: Stamp, *, is_published: bool) -> Stamp:
        """A message's stamp with the number under which it is published: these have no
        gaps, wherever poses are computed.
        """
        self._heard[name] = stamp.number
        ahead = self._ahead.get(name, 0)
        if not is_published:
            self._ahead[name] = ahead - 1
        if not ahead:
            return stamp
        return msgspec.structs.replace(stamp, number=stamp.number + ahead)

    def next_number(self, name: str) -> int:
        """Numbers a message of that kind that a stage has computed."""
        self._ahead[name] = self._ahead.get(name, 0) + 1
        return self._heard.get(name, 0) + self._ahead[name]

    def take_temperature(self, degc: float | None) -> None:
        """That of the sensor now; its noise leaves the one that is known."""
        known = self.temperature_c
        if known is None or degc is None or abs(degc - known) > TEMPERATURE_NOISE_DEGC:
            self.temperature_c = degc

    def take_pose(self, pose: Mapping[str, Any]) -> None:
        """The pose that has just been heard, or computed of what was."""
        self.pose, self.pose_ns = pose, self.heard_ns

    def configure(self, config: Config) -> None:
        self.name = config.name_of(self.probe.probe_id)
        self.settings = config.settings_of(self.probe.probe_id)
        self.is_logged = self.settings.log
        self._locate(config.place)
        for stage in self.stages:
            stage.configure(config)

    def _locate(self, place: PlaceSettings) -> None:
        self.earth, self.north = earth_of(place), None
        if self.earth is not None and place.north == "true":
            self.north = North(self.earth.declination_deg)

    @property
    def button(self) -> tuple[str, ...]:
        """What the gestures of its button ask for."""
        return self.settings.button or BUTTON

    @property
    def tells_button(self) -> bool:
        """Its button does nothing by itself, by its params."""
        with contextlib.suppress(ParamsError):
            return Params.decode(self.probe.params or b"").options.button_does == "tell"
        return False

    def gesture(self, name: str, stamp: Stamp) -> tuple[str, str] | None:
        """A gesture of its button, with an event of that name or by its time, and what
        that asks for.
        """
        found = self.gestures.look(stamp.t_device_us)
        if name in EVENTS:
            t_us, is_after_gap = stamp.t_device_us, stamp.missing > 0
            now = self.gestures.on_event(name, t_us, is_after_gap=is_after_gap)
            found = found or now
        if found is None:
            return None
        table = self.button if self.tells_button else BUTTON
        return found, table[GESTURES.index(found)]

    def closing(self, *, is_double: bool = False) -> dict[str, Any] | None:
        """The path of its strokes, closed, as PathCloser has it."""
        return_m, scale = self.settings.return_m, scale_sigma(self.probe.scales.params)
        return self.closer.closing(scale, return_m, is_double=is_double)

    @property
    def session(self) -> Session | None:
        """The session of its port."""
        return self.port.session if self.port is not None else None

    @property
    def lost(self) -> int:
        """Messages lost in all boots."""
        return self.probe.account.lost

    @property
    def corrupt(self) -> int:
        """Bad frames on all ports that it was on."""
        session = self.session
        return self.corrupt_before + (session.corrupt.total() if session else 0)

    def closing_line(self) -> str:
        """Its totals, for the daemon's last line."""
        text = f"probe {self.name}: {self.received} received, {self.lost} lost"
        return ", ".join(filter(None, (text, *(s.closing_line() for s in self.stages))))


def earth_of(place: PlaceSettings) -> Earth | None:
    """The magnetic field of the place, today; None: the place is not known."""
    if place.latitude_deg is None or place.longitude_deg is None:
        return None
    day = datetime.datetime.now(datetime.UTC).date()
    return earth_at(place.latitude_deg, place.longitude_deg, place.altitude_m, day)


class Registry:
    """All probes that were heard since the daemon started."""

    def __init__(self, config: Config, make_stages: MakeStages = stages_of) -> None:
        self._config = config
        self._make_stages = make_stages
        self._by_id: dict[str, ProbeEntry] = {}
        self._by_name: dict[str, ProbeEntry] = {}

    def __iter__(self) -> Iterator[ProbeEntry]:
        return iter(list(self._by_id.values()))

    def __getitem__(self, probe_id: str) -> ProbeEntry:
        """A probe that is known; KeyError if it is not."""
        return self._by_id[probe_id]

    def named(self, name: str) -> ProbeEntry | None:
        """The probe of that name or id: no name can be an id."""
        return self._by_name.get(name) or self._by_id.get(name)

    def id_of(self, name: str) -> str | None:
        """The id of the probe of that name. Any thread may ask."""
        entry = self._by_name.get(name)
        return entry.probe.probe_id if entry is not None else None

    def add(self, probe_id: str) -> ProbeEntry:
        """The probe of that id, which may be known."""
        entry = self._by_id.get(probe_id)
        if entry is None:
            stages = self._make_stages(self._config)
            entry = ProbeEntry(probe_id, self._config, stages)
            self._by_id[probe_id] = self._by_name[entry.name] = entry
        return entry

    def has_room(self, probe_id: str) -> bool:
        """Whether that probe is known or may be added."""
        return probe_id in self._by_id or len(self._by_id) < PROBES_MAX

    def forget(self, now_ns: int) -> ProbeEntry | None:
        """Drops the probe that is gone longest and returns it; None: none is gone for
        FORGET_NS (host's time). Those with few messages go first, so that invented ids
        can't fill the registry permanently.
        """
        gone = [
            entry
            for entry in self
            if entry.port is None and now_ns - entry.heard_ns > FORGET_NS
        ]
        if not gone:
            return None
        oldest = min(gone, key=lambda e: (e.received > FEW_MESSAGES, e.heard_ns))
        del self._by_id[oldest.probe.probe_id]
        del self._by_name[oldest.name]
        return oldest

    def on_port(self, port: ProbePort) -> list[ProbeEntry]:
        return [entry for entry in self if entry.port is port]

    def holder(self, probe_id: str, port: ProbePort, since_ns: int) -> ProbePort | None:
        """The other port on which that probe was heard since then (host's time)."""
        entry = self._by_id.get(probe_id)
        if entry is None or entry.port is None or entry.port is port:
            return None
        return entry.port if entry.heard_ns >= since_ns else None

    def missing(self) -> list[str]:
        """Ids of the probes that are on no port."""
        return [id_ for id_, entry in self._by_id.items() if entry.port is None]

    def configure(self, config: Config) -> dict[str, str]:
        """Takes up a new configuration. Returns the old and new names of the probes
        that it renames.
        """
        self._config = config
        renamed: dict[str, str] = {}
        for entry in self:
            before = entry.name
            entry.configure(config)
            if entry.name != before:
                renamed[before] = entry.name
        self._by_name = {entry.name: entry for entry in self}
        return renamed

    def closing_line(self) -> str:
        """The totals of all probes, for the daemon's last line."""
        entries = list(self)
        if len(entries) <= LISTED_MAX:
            text = "; ".join(entry.closing_line() for entry in entries)
            return text or "no probe was connected"
        received = sum(entry.received for entry in entries)
        lost = sum(entry.lost for entry in entries)
        return f"{len(entries)} probes: {received} received, {lost} lost"
