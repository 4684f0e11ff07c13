# SPDX-License-Identifier: MIT
"""Everything received from a probe during its check: live, or in a log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from imud.calibration.earth import Earth
from imud.calibration.poses import StaticPose
from imud.probes.ledger import totals
from imud.probes.record import equipment_of
from imud.probes.self_test import Responses, SelfTestOutcome, SensorVerdict, verdicts_of
from imud.rotation import FloatArray

NAN3 = (np.nan, np.nan, np.nan)


class ProbeEvent(NamedTuple):
    """An event of the probe."""

    event: str
    cause: str
    detail: int


class BootRecord(NamedTuple):
    """A start of the probe, by its hello."""

    number: int
    causes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Wire:
    """The link that carries the probe's bytes. None: unknown."""

    kind: str  # in words, without the port's name
    baud: int | None = None
    latency_timer_ms: int | None = None  # of an FTDI adapter


@dataclass(frozen=True, slots=True)
class Posed:
    """The mean acceleration while the probe was laid in a pose, m/s2. None: it was left
    out, or it was not laid still in time.
    """

    pose: StaticPose
    acc_m_s2: tuple[float, float, float] | None


@dataclass(frozen=True)
class Samples:
    """The raw samples, one row each; NaN where there was no reading."""

    t_us: FloatArray
    acc: FloatArray  # counts
    gyr: FloatArray  # counts
    mag: FloatArray  # counts
    mag_ut: FloatArray  # calibrated with the active params
    temperature_c: FloatArray
    age_us: FloatArray
    t_ns: FloatArray
    bound_us: FloatArray
    clipped: FloatArray  # whether a sensor reached the end of its range
    is_posed: FloatArray  # it was turned, as requested
    flags: Counter[str]

    def __len__(self) -> int:
        return len(self.t_us)

    def first_pose(self) -> Samples:
        """The samples before it was turned."""
        kept = self.is_posed == 0
        columns = {
            each.name: getattr(self, each.name)[kept]
            for each in fields(self)
            if each.name != "flags"
        }
        return replace(self, **columns)

    @cached_property
    def steps_us(self) -> FloatArray:
        """From one sample to the next, without the pause of a restart."""
        steps = np.diff(self.t_us)
        return steps[(steps > 0) & (steps < 2e6)]

    @cached_property
    def period_us(self) -> float:
        """Between two samples; NaN where there are fewer."""
        return float(np.median(self.steps_us)) if len(self.steps_us) else float("nan")


@dataclass
class Evidence:
    """Filled by add_message() and add_status()."""

    hello: dict[str, Any] = field(default_factory=dict)
    boots: list[BootRecord] = field(default_factory=list)
    first: dict[str, Any] = field(default_factory=dict)  # of the counters
    counters: dict[str, Any] = field(default_factory=dict)
    equipment: dict[str, Any] | None = None
    events: list[ProbeEvent] = field(default_factory=list)
    responses: Responses | None = None
    outcomes: dict[str, dict[str, str]] = field(default_factory=dict)  # by the daemon
    wire: Wire | None = None
    link: dict[str, Any] | None = None  # counts of the bytes and frames
    lost: int = 0  # messages between the probe and us
    other_schema: bool = False
    earth: Earth | None = None
    params: bytes | None = None  # the active records, if they are known
    poses: list[Posed] = field(default_factory=list)
    button: bool | None = None  # whether it was pressed in time; None: not asked
    led: bool | None = None  # whether it shows the state, by the user's answer
    is_live: bool = False
    is_posing: bool = False
    _rows: list[tuple[float, ...]] = field(default_factory=list)
    _flags: Counter[str] = field(default_factory=Counter)
    _begun_lost: int | None = None

    @property
    def count(self) -> int:
        """Samples so far."""
        return len(self._rows)

    def add_message(self, item: Mapping[str, Any]) -> None:
        """A message as `imud.probes.record.describe` makes it."""
        kind = item["type"]
        if kind == "raw":
            self._add_raw(item)
        elif kind == "event":
            self.events.append(ProbeEvent(item["event"], item["cause"], item["detail"]))
        elif kind == "hello":
            self._add_hello(item)
        elif kind == "status":
            self._add_counters(item)
        elif kind == "self_test":
            self.responses = Responses.of(item)
        elif kind == "equipment":
            self.equipment = equipment_of(item)

    def add_status(self, status: Mapping[str, Any]) -> None:
        """The daemon's status of the probe."""
        self._add_hello(status["hello"])
        self.other_schema = status["state"] == "other schema"
        if status["counters"]:
            self._add_counters(status["counters"])
        self.equipment = status.get("equipment")
        self.outcomes = (status.get("sensors") or {}).get("self_test") or {}
        self.link = status.get("link")
        lost = totals(status.get("ledger") or {}).lost
        if self._begun_lost is None:
            self._begun_lost = lost
        self.lost = lost - self._begun_lost

    def _add_hello(self, hello: Mapping[str, Any]) -> None:
        if not hello:
            return
        self.hello = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in hello.items()
        }
        boot = BootRecord(hello["boot_count"], tuple(hello["reset_cause"]))
        if not self.boots or self.boots[-1].number != boot.number:
            self.boots.append(boot)

    def _add_counters(self, counters: Mapping[str, Any]) -> None:
        self.counters = dict(counters)
        if not self.first or counters["uptime"] < self.first["uptime"]:
            self.first = self.counters

    def _add_raw(self, item: Mapping[str, Any]) -> None:
        flags = item["flags"]
        self._flags.update(flags)
        self._rows.append(
            (
                item["t_device_us"],
                *item["acc_counts"],
                *item["gyr_counts"],
                *(item["mag_counts"] or NAN3),
                *(item["mag_uT"] or NAN3),
                _or_nan(item["temperature_c"]),
                _or_nan(item.get("age_us")),
                _or_nan(item.get("t_ns")),
                _or_nan(item.get("t_bound_us")),
                float("acc_clipped" in flags or "gyr_clipped" in flags),
                float(self.is_posing),
            )
        )

    def samples(self) -> Samples:
        """All samples so far."""
        table = np.array(self._rows, dtype=float).reshape(-1, 19)
        return Samples(
            t_us=table[:, 0],
            acc=table[:, 1:4],
            gyr=table[:, 4:7],
            mag=table[:, 7:10],
            mag_ut=table[:, 10:13],
            temperature_c=table[:, 13],
            age_us=table[:, 14],
            t_ns=table[:, 15],
            bound_us=table[:, 16],
            clipped=table[:, 17],
            is_posed=table[:, 18],
            flags=self._flags,
        )

    def verdicts(self) -> tuple[SensorVerdict, ...]:
        """The verdicts of the self-test by its responses, which the daemon sends to
        recorders only; without these the verdicts of the daemon.
        """
        if self.responses is None and self.outcomes:
            return tuple(
                SensorVerdict(
                    sensor, SelfTestOutcome(result["outcome"]), result["reason"]
                )
                for sensor, result in self.outcomes.items()
            )
        return verdicts_of(self.hello, self.responses)

    def causes_of(self, *events: str) -> Counter[str]:
        """How often each cause was given for these events."""
        return Counter(each.cause for each in self.events if each.event in events)

    def rise(self, counter: str) -> int:
        """The rise of a counter of the probe during the check."""
        after, before = self.counters.get(counter), self.first.get(counter)
        if not isinstance(after, int) or not isinstance(before, int):
            return 0
        return max(0, after - before)


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else float(value)
