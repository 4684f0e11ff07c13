# SPDX-License-Identifier: MIT
"""`imud info`: what a log holds, whether it is complete, and what was lost."""

from __future__ import annotations

import sys
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from imud.errors import FileError, told
from imud.log.parts import Damage
from imud.log.reader import (
    METADATA_OF_PROBES,
    Logged,
    LogHead,
    is_being_written,
    salvage,
    size_of,
)
from imud.probes.ledger import totals
from imud.probes.record import plain
from imud.probes.session import Probe, Session
from imud.progress import Progress
from imud.recordings.damage import DamageCount
from imud.recordings.source import log_of
from imud.wire import kept, messages
from imud.wire.messages import Message
from imud.wire.params import calibrated_by, digest_of

# Messages without a host's date have the probe's own time, from 1970 on: it lasts 50
# days.
DATED_NS = 365 * 86_400 * 10**9


class ProbeInfo:
    """The contents of a log for one probe."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.probe = Probe(name)
        self.session = Session(lambda _: self.probe, None, self.probe)
        self.hello: dict[str, Any] = {}
        self.first_ns: dict[str, int] = {}
        self.last_ns: dict[str, int] = {}
        self.counts: Counter[str] = Counter()
        self.digests: list[int] = []
        self.records: dict[int, bytes] = {0: b""}  # by digest

    def add(self, item: Logged, damage: DamageCount, *, is_read: bool) -> None:
        """Counts a record of the log. A readable frame goes into the ledger, and what
        is missing there by damage into `damage`.
        """
        if item.topic in METADATA_OF_PROBES.values():
            self._add_metadata(item, is_read=is_read)
            return
        topic = item.topic
        self.counts[topic] += 1
        self.first_ns[topic] = min(item.t_ns, self.first_ns.get(topic, item.t_ns))
        self.last_ns[topic] = max(item.t_ns, self.last_ns.get(topic, item.t_ns))
        if topic == "frame" and is_read:
            before = self.probe.account.lost
            self.session.receive_content(item.data, item.t_ns)
            damage.hear(self.name, self.probe.account.lost - before)

    def _add_metadata(self, item: Logged, *, is_read: bool) -> None:
        if item.topic == "params_records":
            self.records[digest_of(item.data)] = item.data
            return
        message = messages.decode(item.data) if is_read else None
        if isinstance(message, Message):
            self.hello = {name: plain(v) for name, v in message.fields.items()}
            digest = message.fields["params_digest"]
            if isinstance(digest, int) and digest not in self.digests:
                self.digests.append(digest)

    def params(self) -> list[dict[str, Any]]:
        """The params in force, in their order, and what each calibrates."""
        return [
            {
                "digest": f"{digest:#010x}",
                "bytes": len(self.records[digest]) if digest in self.records else None,
                "calibrated": calibrated_by(self.records.get(digest, b"")),
            }
            for digest in self.digests
        ]

    def rate_hz(self, topic: str) -> float | None:
        span_ns = self.last_ns[topic] - self.first_ns[topic]
        return (self.counts[topic] - 1) / span_ns * 1e9 if span_ns else None

    def as_dict(self, damaged: int) -> dict[str, Any]:
        """The probe as `imud info --json` prints it; `damaged`: messages lost by damage
        to the file.
        """
        self.session.close()
        counts: Any = self.probe.account.counts()
        total = totals(counts)
        return {
            "probe": self.name,
            "probe_id": self.hello.get("probe_id"),
            "board": self.hello.get("board"),
            "firmware": self.hello.get("firmware"),
            "sensor": self.hello.get("sensor"),
            "params": self.params(),
            "topics": {
                topic: {"messages": self.counts[topic], "rate_hz": self.rate_hz(topic)}
                for topic in sorted(self.counts)
            },
            "sent": total.sent,
            "received": total.received,
            "lost": total.lost - damaged,
            "damaged": damaged,
            "duplicated": total.duplicated,
            "boots": counts["boots"],
        }


def info_of(path: Path) -> dict[str, Any]:
    """The summary of one log, as an object for JSON."""
    head: LogHead | None = None
    probes: dict[str, ProbeInfo] = {}
    damage = DamageCount()
    bar = Progress("reading", size := size_of(path))
    try:
        for item in salvage(path, bar.update):
            if isinstance(item, LogHead):
                head = item
            elif isinstance(item, Damage):
                damage.add(item)
            else:
                if item.probe not in probes:
                    probes[item.probe] = ProbeInfo(item.probe)
                is_read = head is None or kept.find(head.fingerprint) is not None
                probes[item.probe].add(item, damage, is_read=is_read)
    finally:
        bar.end()
    begins = [t for each in probes.values() for t in each.first_ns.values()]
    ends = [t for each in probes.values() for t in each.last_ns.values()]
    return {
        "log": str(path),
        "bytes": size,
        "is_whole": not (damage.is_cut or damage.places),
        "is_cut": damage.is_cut,
        "is_being_written": damage.is_cut and is_being_written(path),
        "damaged_places": damage.places,
        "damage": damage.words(),
        "bytes_lost": damage.bytes,
        "imud": head.version if head else None,
        "schema": f"{head.fingerprint:#010x}" if head else None,
        "begin_ns": min(begins, default=None),
        "end_ns": max(ends, default=None),
        "probes": [probes[n].as_dict(damage.lost[n]) for n in sorted(probes)],
    }


def run(paths: list[Path], *, as_json: bool) -> int:
    """Prints what each log holds; returns 0.

    Raises FileError for logs that can't be read or are damaged, after all are done.
    """
    problems = []
    for path in paths:
        try:
            with log_of(path) as log:
                info = info_of(log) | {"log": str(path)}
        except FileError as error:
            problems.append(told(error))
            continue
        if info["damage"]:
            problems.append(f"{path} is {info['damage']}")
        text = msgspec.json.encode(info).decode() if as_json else _words(info)
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    if problems:
        raise FileError("; ".join(problems))
    return 0


def _words(info: dict[str, Any]) -> str:
    state = "whole" if info["is_whole"] else ""
    if info["is_being_written"]:
        state = "being written"
    elif info["is_cut"]:
        state = "truncated"
    if info["damaged_places"]:
        state += f"{', ' if state else ''}damaged in {info['damaged_places']} places"
    if not (info["is_whole"] or info["is_being_written"]):
        state += " (imud recover saves the intact part)"
    lines = [f"{info['log']}: {info['bytes'] / 1e6:.1f} MB, {state}"]
    if info["imud"] is not None:
        lines[0] += f"; by imud {info['imud']}, schema {info['schema']}"
    if info["begin_ns"] is not None:
        seconds = (info["end_ns"] - info["begin_ns"]) / 1e9
        lines.append(f"  {_span(info['begin_ns'], info['end_ns'])}, {seconds:.1f} s")
    for probe in info["probes"]:
        who = [f"  probe {probe['probe']}"]
        if probe["probe_id"] not in (None, probe["probe"]):
            who.append(f" ({probe['probe_id']})")
        if probe["board"] is not None:
            who.append(
                f": {probe['board']}, firmware {probe['firmware']}, {probe['sensor']}"
            )
        lines.append("".join(who))
        lines += [f"    params {_params(each)}" for each in probe["params"]]
        for topic, found in probe["topics"].items():
            rate = found["rate_hz"]
            at = f"{rate:10.1f} Hz" if rate is not None else ""
            lines.append(f"    {topic:<14} {found['messages']:>10}{at}")
        lines.append(
            f"    {probe['sent']} sent = {probe['received']} received + "
            f"{_skewed(probe)} skewed + {probe['lost']} lost{_damaged(probe)}; "
            f"{probe['duplicated']} duplicated, "
            f"{probe['boots']} {'boot' if probe['boots'] == 1 else 'boots'}"
        )
    return "\n".join(lines)


def _skewed(probe: dict[str, Any]) -> int:
    others = ("received", "lost", "damaged")
    return int(probe["sent"]) - sum(int(probe[name]) for name in others)


def _damaged(probe: dict[str, Any]) -> str:
    return f" + {probe['damaged']} damaged" if probe["damaged"] else ""


def _span(begin_ns: int, end_ns: int) -> str:
    if begin_ns < DATED_NS:
        return f"{begin_ns / 1e9:.1f} to {end_ns / 1e9:.1f} s of the probe's own time"
    return f"{_utc(begin_ns)} to {_utc(end_ns)} UTC"


def _params(each: dict[str, Any]) -> str:
    if each["bytes"] is None:
        return f"{each['digest']}, not in the log"
    if not each["bytes"]:
        return "none: uncalibrated"
    sensors = ", ".join(each["calibrated"]) or "nothing"
    return f"{each['digest']}: {each['bytes']} bytes, calibrate {sensors}"


def _utc(t_ns: int) -> str:
    return datetime.fromtimestamp(t_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S")
