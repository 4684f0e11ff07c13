# SPDX-License-Identifier: MIT
"""Which params the probes have: published when they change, asked for when they are not
known, kept as history.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator
from typing import Any

from imud.calibration.earth import Earth, with_field
from imud.daemon.publisher import RecordPublisher
from imud.daemon.registry import ProbeEntry, Registry
from imud.daemon.sensor_watch import is_working
from imud.errors import ParamsError
from imud.params.condition import (
    Condition,
    advice,
    condition_of,
    done_words,
    flags_of,
    moved_words,
)
from imud.params.value import SENSORS, Params, payload_of
from imud.probes.sensors import has_magnetometer
from imud.wire.params import calibrated_by, is_mag_off, parts_of

PARAMS = "params"  # the topic

# How often a probe is asked to tell its params, while they are not known.
ASK_S = 5.0

Keep = Callable[[str, Params, int], None]


class ParamsWatch:
    """Knows what was published of the params of each probe."""

    def __init__(self, registry: Registry, publisher: RecordPublisher) -> None:
        self._registry = registry
        self._publisher = publisher
        self._published: dict[ProbeEntry, int] = {}  # digests
        self._ask_s: dict[ProbeEntry, float] = {}  # when to ask
        self._placed: dict[ProbeEntry, tuple[bytes, Earth | None]] = {}
        self._has_asked = False
        self.keep: Keep = lambda *_: None

    def follow(self, entry: ProbeEntry, t_ns: int) -> None:
        """Called after each hello and each part of params, at `t_ns` UTC."""
        digest = entry.probe.hello.get("params_digest")
        records = entry.probe.params
        if not isinstance(digest, int) or records is None:
            return
        if self._published.get(entry) == digest:
            return
        self._published[entry] = digest
        self._publish(entry, records, t_ns)
        try:
            params = Params.decode(records)
        except ParamsError:
            return
        if params.records:
            self.keep(entry.probe.probe_id, params, t_ns)

    def announce(self, t_ns: int) -> None:
        """Says all params again, for sinks that have just been opened."""
        for entry in self._registry:
            records = entry.probe.params
            if entry in self._published and records is not None:
                self._publish(entry, records, t_ns)

    def due(self, now_s: float) -> Iterator[ProbeEntry]:
        """Probes that are to be asked for their params at `now_s`, the loop's time."""
        for entry in self._registry:
            is_readable = entry.is_alive and entry.other is None
            is_known = not entry.probe.hello or entry.probe.params is not None
            if not is_readable or is_known or entry.commanding.locked():
                continue
            # Most come unasked, right after the hello.
            due_s = self._ask_s.setdefault(entry, now_s + 1.0)
            if now_s >= due_s:
                self._ask_s[entry] = now_s + ASK_S
                yield entry

    def unplaced(self) -> Iterator[tuple[ProbeEntry, bytes]]:
        """Probes whose filter does not know the field of the place, each once, and the
        params that state it; one, and none, if the configuration has no place.
        """
        for entry in self._registry:
            records, earth = entry.probe.params, entry.earth
            is_ready = entry.is_alive and not entry.commanding.locked()
            if records is None or not is_ready:
                continue
            if not has_magnetometer(entry.probe.hello, records):
                continue
            before = self._placed.get(entry)
            self._placed[entry] = records, earth
            if before == (records, earth):
                continue
            if earth is not None:
                located = with_field(records, earth)
                if located != records:
                    yield entry, located
            elif not self._has_asked and "mag" not in parts_of(records):
                self._has_asked = True
                yield entry, b""

    def _publish(self, entry: ProbeEntry, records: bytes, t_ns: int) -> None:
        values = {"probe_id": entry.probe.probe_id, "t_ns": t_ns, **payload_of(records)}
        self._publisher.say(entry, PARAMS, values, t_ns)


def summary(entry: ProbeEntry) -> dict[str, Any]:
    """The params in a probe's status."""
    digest = entry.probe.hello.get("params_digest")
    records = entry.probe.params if isinstance(digest, int) else None
    summed: dict[str, Any] = {
        "digest": f"{digest:08x}" if isinstance(digest, int) else None,
        "is_known": records is not None,
    }
    if records is None:
        return summed
    try:
        params = Params.decode(records)
    except ParamsError:
        return summed
    described = params.described()
    conditions = conditions_of(entry, params)
    cared_for = conditions if is_working(entry) else {}
    if cared_for and not has_magnetometer(entry.probe.hello, records):
        cared_for = {name: of for name, of in conditions.items() if name != "mag"}
    for name in SENSORS:
        summed[name] = {"is_calibrated": name in calibrated_by(records)}
        summed[name]["condition"] = conditions[name].value
    if not entry.counters:  # its temperature comes with its first status
        unknown = Condition.UNKNOWN_TEMPERATURE
        cared_for = {name: of for name, of in cared_for.items() if of != unknown}
    moved = ""
    if cared_for.get("acc") is Condition.OTHER_TEMPERATURE:
        moved = moved_words(params.plain("acc"), entry.temperature_c)
    off = ("mag_off",) if is_mag_off(records) else ()
    flags = (*flags_of(cared_for), *off)
    summed |= {"advice": advice(cared_for, moved), "flags": flags}
    for name in (*SENSORS, "tip"):
        values = described[name] or {}
        kept = {
            key: value
            for key, value in values.items()
            if key in ("method", "day") or key.startswith("sigma")
        }
        summed[name] = summed.get(name, {}) | kept
    summed["done"] = done_words({name: params.plain(name) for name in SENSORS})
    return summed | {"options": described["options"], "own_field": own_field(entry)}


def conditions_of(entry: ProbeEntry, params: Params) -> dict[str, Condition]:
    """The current quality of each sensor's calibration."""
    seconds = entry.last_heard_ns * 1e-9
    today = datetime.datetime.fromtimestamp(seconds, datetime.UTC).date()
    return {
        name: condition_of(params.plain(name), today, entry.temperature_c)
        for name in SENSORS
    }


def own_field(entry: ProbeEntry) -> dict[str, Any] | None:
    """The magnetic field of its own that the probe kept; None: it kept none."""
    hello = entry.probe.hello
    if not hello.get("own_sigma"):
        return None
    return {"field_uT": hello["own_field"], "sigma_uT": hello["own_sigma"]}
