# SPDX-License-Identifier: MIT
"""The status of a probe as one object of plain values. No I/O; time is an argument."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import msgspec

from imud.daemon.log_state import LogState
from imud.daemon.params_watch import summary
from imud.daemon.registry import ProbeEntry
from imud.daemon.sensor_watch import sensors_of
from imud.machine.utc import Sync
from imud.probes.balance import SinkCounts, balance
from imud.probes.record import plain
from imud.probes.timeline import Timeline
from imud.probes.withheld import sentences, withheld_of
from imud.published import POSE_NUMBERS
from imud.version import version

STATUS_S = 1.0  # between two statuses of a probe

# Of the last pose. By `number` a consumer knows what it missed though no more comes.
QUALITY = (
    *(*POSE_NUMBERS, "flags"),
    *("age_us", "t_bound_us", "number"),
)


class Delivered(msgspec.Struct, frozen=True):
    """The outcome of one probe's records at the sinks."""

    sinks: Mapping[str, SinkCounts]
    published: Mapping[str, int]  # by topic
    logged: Mapping[str, int]  # by topic
    log: LogState


def status_of(
    entry: ProbeEntry,
    delivered: Delivered,
    timeline: Timeline,
    sync: Sync,
    now_ns: int,
) -> dict[str, Any]:
    """All that the daemon knows about a probe at `now_ns`, the host's time."""
    hello = entry.other.hello.fields if entry.other is not None else entry.probe.hello
    session = entry.session
    return {
        "probe_id": entry.probe.probe_id,
        "t_ns": timeline.utc(now_ns),
        "state": _state(entry, timeline, now_ns),
        "port": entry.port.name if entry.port is not None else None,
        "pose_rate_hz": round(entry.pose_rate_hz, 1),
        "quality": _quality(entry),
        "ledger": _ledger(entry, delivered),
        "log": delivered.log,
        "link": session.counts() if session is not None else None,
        "clock": _clock(entry, timeline, now_ns) | _utc(sync),
        "params": summary(entry),
        "button": entry.button,
        "sensors": sensors_of(entry),
        "place": msgspec.to_builtins(entry.earth),
        **{stage.name: stage.status() for stage in entry.stages},
        "counters": entry.counters,
        "equipment": entry.equipment,
        "hello": {name: plain(value) for name, value in hello.items()},
        "imud": version(),
    }


def _quality(entry: ProbeEntry) -> dict[str, Any]:
    """How good the last pose is, and why what is not known is not."""
    withheld = withheld_of(entry.pose)
    return {
        **{key: entry.pose.get(key) for key in QUALITY},
        "withheld": {**withheld, "words": sentences(withheld)},
    }


def _state(entry: ProbeEntry, timeline: Timeline, now_ns: int) -> str:
    """The probe's own word, unless it can't be heard."""
    if entry.port is None:
        return "gone"
    if entry.other is not None:
        return "other schema"
    if timeline.silence(entry.heard_ns, now_ns) >= 3 * STATUS_S * 1e9:
        return "silent"
    return str(entry.counters.get("state", "unknown"))


def _ledger(entry: ProbeEntry, delivered: Delivered) -> dict[str, Any]:
    """Every message from the probe to each sink, and whether the counts add up."""
    counts = entry.probe.account.counts()
    return {
        **counts,
        "corrupt": entry.corrupt,
        "published": delivered.published,
        "logged": delivered.logged,
        "dropped": {sink: of.dropped for sink, of in delivered.sinks.items()},
        **balance(
            counts,
            entry.counters,
            entry.counters_sequence,
            entry.received,
            entry.put,
            delivered.sinks,
        ),
    }


def _utc(sync: Sync) -> dict[str, Any]:
    """Whose UTC it is, and how good."""
    return {
        "utc_host": sync.host,
        "utc_is_synchronised": sync.is_synchronised,
        "utc_bound_us": sync.bound_us,
    }


def _clock(entry: ProbeEntry, timeline: Timeline, now_ns: int) -> dict[str, Any]:
    """How well the probe's clock is known, and how the host's does."""
    clock, stamp, session = entry.probe.clock, entry.stamp, entry.session
    rate_ppm = clock.rate_ppm
    offset_ns = bound_us = None
    if stamp is not None and stamp.t_ns is not None:
        offset_ns = stamp.t_ns - 1000 * stamp.t_device_us
    if stamp is not None and stamp.t_bound_ns is not None:
        bound_us = round(stamp.t_bound_ns / 1000)
    skewed = Counter(entry.probe.account.skewed)
    if session is not None:
        skewed += session.headless
    return {
        "t_device_us": stamp.t_device_us if stamp is not None else 0,
        "t_ns": entry.last_heard_ns,
        "offset_ns": offset_ns,
        "skew_ppm": None if rate_ppm is None else round(rate_ppm, 2),
        "bound_us": bound_us,
        "exchanges": clock.exchanges,
        "restarts": clock.restarts,
        "host_steps": timeline.steps,
        "host_last_step_ns": timeline.last_step_ns,
        "host_timeline": timeline.number,
        "host_ahead_ns": timeline.ahead(now_ns, timeline.utc(now_ns)),
        "data_skew": dict(sorted(skewed.items())),
    }
