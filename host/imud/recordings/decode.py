# SPDX-License-Identifier: MIT
"""`imud decode`: prints the messages of captures, logs and cards, as text or JSON."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from imud import rotation
from imud.card import disk
from imud.card.listing import plural
from imud.card.probe_log import MAGIC as CARD_MAGIC
from imud.card.probe_log import find_log
from imud.errors import FileError
from imud.log.parts import Damage
from imud.log.reader import Logged, LogHead, salvage
from imud.log.writer import MAGIC
from imud.probes.first_hello import first_hello, probe_in_file, probe_of
from imud.probes.ledger import totals
from imud.probes.record import HEAD, describe
from imud.probes.session import (
    Event,
    OtherSchema,
    Probe,
    Received,
    Session,
)
from imud.published import SinceOrigin
from imud.recordings.damage import DamageCount
from imud.recordings.foreign_log import log_of_foreign
from imud.recordings.foreign_table import is_foreign
from imud.recordings.source import chunks_of, local
from imud.wire import kept, messages, schema
from imud.wire.messages import Message, Value


class Tally:
    """Counts of what a file holds, printed at its end."""

    def __init__(self) -> None:
        self.messages = 0
        self.other: OtherSchema | None = None
        self.probes: dict[str, Probe] = {}
        self.links: list[dict[str, Any]] = []
        self.damage = DamageCount()  # of a log

    def probe(self, probe_id: str) -> Probe:
        return probe_of(self.probes, probe_id)

    def lines(self) -> Iterator[str]:
        """The balance of each probe and port, and whether the log is truncated."""
        for name, probe in self.probes.items():
            counts: Any = probe.account.counts()
            total = totals(counts)
            of_disk = self.damage.lost[name]
            damaged = f" + {of_disk} damaged" if of_disk else ""
            yield (
                f"{name}: {total.sent} sent = {total.received} received + "
                f"{total.skewed.total()} skewed{_kinds(total.skewed)} + "
                f"{total.lost - of_disk} lost{damaged}; {total.duplicated} duplicated, "
                f"{counts['strays']} stray, {plural(counts['boots'], 'boot')}"
            )
        for link in self.links:
            yield (
                f"{plural(link['bytes'], 'byte')}, "
                f"{plural(link['frames'], 'frame')}, "
                f"{link['corrupt']} corrupt{_kinds(link['corrupt_kinds'])}"
                + (", the first truncated" if link["partial"] else "")
            )
        if self.damage.is_cut and not self.damage.places:
            yield "the log is truncated: imud was killed, or is still writing it"


def decode_file(path: Path, tally: Tally) -> Iterator[dict[str, Any]]:
    """Yields each good message of a UART capture, a log or a PROBE.LOG, in order.

    Counts go to `tally`. Raises FileError if the file can't be read. Of a foreign
    recording those that it would be as a log.
    """
    if is_foreign(path):
        with log_of_foreign(path) as log:
            yield from _decode_log(log, tally)
        return
    try:
        with path.open("rb") as file:
            magic = file.read(8)
    except OSError as error:
        raise FileError(f"can't read {path}: {error.strerror}") from error
    known = {MAGIC: _decode_log, CARD_MAGIC: _decode_card}
    yield from known.get(magic, _decode_capture)(path, tally)


def _decode_capture(path: Path, tally: Tally) -> Iterator[dict[str, Any]]:
    probe = probe_in_file(first_hello(chunks_of(path)), tally.probe)
    session = Session(tally.probe, presumed=probe)
    for data in chunks_of(path):
        yield from _described(session.receive(data, None), tally)
    yield from _described(session.close(), tally)
    tally.links.append(session.counts())


def _decode_card(path: Path, tally: Tally) -> Iterator[dict[str, Any]]:
    """Each recording starts its sequence at 0, as each boot does."""
    with disk.opened(path) as file:
        log = find_log(file)
        for recording in log.recordings():
            probe = probe_in_file(first_hello(log.frames(recording)), Probe)
            name = f"recording {recording.number} of {probe.probe_id}"
            tally.probes[name] = probe
            session = Session(partial(_same, probe), None, probe)
            for data in log.frames(recording):
                yield from _described(session.receive(data, None), tally)
            yield from _described(session.close(), tally)
            tally.links.append(session.counts())


def _described(
    events: Iterable[Event], tally: Tally, name: str | None = None
) -> Iterator[dict[str, Any]]:
    for event in events:
        if isinstance(event, Received):
            tally.messages += 1
            yield describe(
                event.message,
                event.content,
                name or event.probe.probe_id,
                event.stamp,
                event.scales,
                event.probe.references,
            )
        elif isinstance(event, OtherSchema):
            tally.other = event


def _decode_log(path: Path, tally: Tally) -> Iterator[dict[str, Any]]:
    for name, events in events_of_log(path, tally, salvage(path)):
        yield from _described(events, tally, name)


def events_of_log(
    path: Path, tally: Tally, records: Iterable[LogHead | Logged | Damage]
) -> Iterator[tuple[str, Iterable[Event]]]:
    """What the frames of a log tell, which hold all that the probes said: names of
    probes, and events. FileError for another schema.

    They passed the daemon's checks when they came; the same checks are made again.
    """
    sessions = LogSessions(path, tally)
    for record in records:
        yield from sessions.receive(record)
    yield from sessions.close()


class LogSessions:
    """The sessions of the probes in a log."""

    def __init__(self, path: Path, tally: Tally) -> None:
        self._path, self._tally = path, tally
        self._sessions: dict[str, Session] = {}

    def receive(
        self, record: LogHead | Logged | Damage
    ) -> Iterator[tuple[str, Iterable[Event]]]:
        """The events of a frame, and whose they are; of other records there are none.
        FileError for another schema.
        """
        if isinstance(record, LogHead):
            _check_schema(self._path, record)
            return
        if isinstance(record, Damage):
            self._tally.damage.add(record)
            return
        probe = self._tally.probe(record.probe)
        session = self._sessions.get(record.probe)
        if session is None:
            session = Session(partial(_same, probe), None, probe)
            self._sessions[record.probe] = session
        if record.topic in _INTRODUCE:
            _INTRODUCE[record.topic](probe, record.data)
        elif record.topic == "frame":
            before = probe.account.lost
            events = session.receive_content(
                record.data, record.t_ns, record.t_sample_ns
            )
            self._tally.damage.hear(record.probe, probe.account.lost - before)
            yield record.probe, events

    def close(self) -> Iterator[tuple[str, Iterable[Event]]]:
        """The events of what waited."""
        for name, session in self._sessions.items():
            yield name, session.close()


def _introduce(probe: Probe, hello: bytes) -> None:
    """The hello of the messages ahead of the first that is logged. Metadata of later
    ones come ahead of the messages before them, and say nothing that is not logged.
    """
    message = messages.decode(hello)
    if isinstance(message, Message) and not probe.hello:
        probe.update(message, hello)


# What metadata say of a probe, by their topic.
_INTRODUCE = {"hello": _introduce, "params_records": Probe.add_params}


def _same(probe: Probe, _: str) -> Probe:
    """The name of a probe in a log, which is not always its id."""
    return probe


def _check_schema(path: Path, head: LogHead) -> None:
    if kept.find(head.fingerprint) is None:
        raise FileError(
            f"{path} holds schema {head.fingerprint:#010x} (imud {head.version}), "
            f"this imud reads {schema.FINGERPRINT:#010x}: use the version that wrote "
            "it"
        )


def run(path: Path, *, as_json: bool) -> int:
    """Prints messages to stdout and counts to stderr; returns 0. FileError if the file
    has none, or is damaged, after all others.
    """
    tally = Tally()
    encoder = msgspec.json.Encoder()
    with local(path) as file:
        for item in decode_file(file, tally):
            line = encoder.encode(item).decode() if as_json else words(item)
            sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
    if tally.other is not None:
        raise FileError(f"{path}: {_other(tally.other)}")
    words_ = tally.damage.words()
    if not tally.messages and not words_:
        raise FileError(
            f"{path} has no message of a probe; give a log, a capture of a UART or a "
            "card's PROBE.LOG"
        )
    for line in tally.lines():
        sys.stderr.write(f"{line}\n")
    if words_:
        raise FileError(f"{path} is {words_}")
    return 0


def _other(found: OtherSchema) -> str:
    return (
        f"probe {found.probe_id} has schema {found.fingerprint:#010x} (firmware "
        f"{found.firmware}), this imud has {schema.FINGERPRINT:#010x}: use the "
        "version that wrote it"
    )


# The keys of a pose that its line of text has words for; others go by their names.
_IN_LINE = frozenset(
    {
        *(*HEAD, "q", "position_m", "normal", "tilt_sigma_deg", "heading_sigma_deg"),
        *("flags", "since_origin"),
    }
)


def words(item: dict[str, Any]) -> str:
    """One message as a line of text."""
    head = f"{item['t_device_us'] / 1e6:12.6f} s  #{item['seq']:<7} {item['type']:<7}"
    if item["type"] == "pose":
        yaw, pitch, roll = rotation.angles_deg(item["q"], "nautical")
        text = f"yaw {yaw:7.2f}  pitch {pitch:6.2f}  roll {roll:7.2f} deg"
        text += f"  tilt {_sigma(item['tilt_sigma_deg'])}"
        text += f"  heading {_sigma(item['heading_sigma_deg'])}"
        if item["position_m"] is not None:
            text += "  at " + _vector(item["position_m"], "m", 4)
        since: SinceOrigin | None = item["since_origin"]
        if since is not None:
            text += f"  since the origin: tilt {_sigma(since.tilt_sigma_deg)}"
            text += f"  heading {_sigma(since.heading_sigma_deg)}"
        others = (f"  {key} {_shown(item[key])}" for key in item if key not in _IN_LINE)
        return f"{head} {text}{''.join(others)}  {' '.join(item['flags'])}".rstrip()
    if item["type"] == "raw":
        parts = [
            "acc " + _vector(item["acc_m_s2"], "m/s2", 3),
            "gyr " + _vector(item["gyr_rad_s"], "rad/s", 4),
            "mag " + _vector(item["mag_uT"], "uT", 1),
            f"{item['temperature_c']:.1f} degC" if item["temperature_c"] else "",
            " ".join(item["flags"]),
        ]
        return f"{head} {'  '.join(part for part in parts if part)}"
    shown = [f"{n} {_shown(value)}" for n, value in item.items() if n not in HEAD]
    return f"{head} {', '.join(shown)}"


def _sigma(sigma: float | None) -> str:
    return "   ?   " if sigma is None else f"±{sigma:6.2f}"


def _vector(values: list[float] | None, unit: str, digits: int) -> str:
    if values is None:
        return "-"
    return "(" + ", ".join(f"{v:.{digits}f}" for v in values) + f") {unit}"


def _shown(value: Value | dict[str, str]) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, dict):
        return "; ".join(f"{key} {each}" for key, each in value.items()) or "none"
    if isinstance(value, tuple | list):
        return " ".join(str(part) for part in value) or "none"
    return str(value)


def _kinds(skews: dict[str, int]) -> str:
    if not skews:
        return ""
    return " (" + ", ".join(f"{count} {kind}" for kind, count in skews.items()) + ")"
