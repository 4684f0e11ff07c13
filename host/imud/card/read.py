# SPDX-License-Identifier: MIT
"""`imud card read`: writes the recordings of a card as the MCAP files that a live log
has.
"""

from __future__ import annotations

import contextlib
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from imud.card import disk
from imud.card.listing import bar, duration, end, plural, summary
from imud.card.probe_log import CardLog, CardRecording, find_log
from imud.errors import ConfigError, FileError
from imud.log.file import LogFile, Settings
from imud.log.undated import record_by_device
from imud.probes.first_hello import first_hello, probe_in_file
from imud.probes.ledger import totals
from imud.probes.session import (
    OtherSchema,
    Probe,
    Received,
    Session,
)
from imud.progress import Progress
from imud.wire import schema


@dataclass(slots=True)
class _Copied:
    """The result of reading a recording."""

    messages: Counter[str] = field(default_factory=Counter)
    first_sequence: int = 0
    first_us: int = 0
    last_us: int = 0
    corrupt: int = 0
    other: OtherSchema | None = None


def read(
    path: Path,
    *,
    to: Path,
    prefix: str,
    number: int | None,
    started_ns: int | None,
) -> int:
    """`imud card read`: writes each recording as an MCAP file into `to`; returns 0.

    `number`: only that recording. `started_ns`: its start in UTC; without it, times are
    the device's, from 1970 on. Raises FileError if a recording can't be read.
    """
    with disk.opened(path) as card:
        log = find_log(card)
        recordings = log.recordings()
        sys.stdout.write(summary(log, recordings))
        if number is not None:
            there = ", ".join(str(each.number) for each in recordings) or "none"
            recordings = [each for each in recordings if each.number == number]
            if not recordings:
                raise FileError(f"{path} has no recording {number}; it has {there}")
        if started_ns is not None and len(recordings) > 1:
            raise ConfigError("--started applies to one recording: add --recording N")
        with disk.as_file_error(
            f"write to {to}", "; choose another folder with --to DIR"
        ):
            to.mkdir(parents=True, exist_ok=True)
        progress = bar(recordings)
        writer = _LogWriter(log, to, prefix, started_ns, progress)
        try:
            lines = [writer.write(recording) for recording in recordings]
        finally:
            progress.end()
    if started_ns is None and any(line.is_written for line in lines):
        sys.stdout.write(
            "times are the device's, from 1970 on; --started UTC --recording N sets "
            "them right\n"
        )
    unread = sum(line.is_unread for line in lines)
    if unread:
        raise FileError(f"{plural(unread, 'recording')} of {path} can't be read")
    return 0


@dataclass(frozen=True, slots=True)
class _Outcome:
    is_written: bool = False
    is_unread: bool = False


class _LogWriter:
    """Writes recordings as MCAP files, each whole or not at all."""

    def __init__(
        self,
        log: CardLog,
        to: Path,
        prefix: str,
        started_ns: int | None,
        progress: Progress,
    ) -> None:
        self._log = log
        self._to = to
        self._prefix = prefix
        self._started_ns = started_ns
        self._progress = progress

    def write(self, recording: CardRecording) -> _Outcome:
        name = f"recording {recording.number}"
        known = first_hello(self._log.frames(recording))
        probes: dict[str, Probe] = {}

        def find(probe_id: str) -> Probe:
            return probes.setdefault(probe_id, Probe(probe_id))

        probe = probe_in_file(known, find)
        stem = f"card-{self._log.card_id:08x}-{probe.probe_id}-{recording.number}"
        path = self._to / f"{stem}.mcap"
        if path.exists():
            self._say(f"{name}: {path} already exists")
            return _Outcome()
        part = path.with_name(f"{path.name}.part")
        with disk.as_file_error(
            f"write {path}", "; choose another folder with --to DIR"
        ):
            file = part.open("wb")
            log = LogFile(file, Settings(prefix=self._prefix))
            try:
                found = self._copy(recording, Session(find, None, probe), log)
                log.finish()
                log.close()
                if found.messages and found.other is None:
                    part.rename(path)
                else:
                    part.unlink()
            except BaseException:
                with contextlib.suppress(OSError):
                    log.close()
                part.unlink(missing_ok=True)
                raise
        if found.other is not None:
            self._say(
                f"{name}: probe {found.other.probe_id} has schema "
                f"{found.other.fingerprint:#010x} (firmware {found.other.firmware}), "
                f"this imud has {schema.FINGERPRINT:#010x}: use the version that "
                "wrote it"
            )
            return _Outcome(is_unread=True)
        if not found.messages:
            self._say(f"{name}: no message in it")
            return _Outcome()
        self._say(f"{name}: {_account(recording, probe, found)}: {path}")
        return _Outcome(is_written=True)

    def _copy(
        self, recording: CardRecording, session: Session, log: LogFile
    ) -> _Copied:
        found = _Copied()
        for data in self._log.frames(recording):
            for event in session.receive(data, None):
                if isinstance(event, OtherSchema):
                    found.other = event
                elif isinstance(event, Received):
                    self._write(event, found, log)
            self._progress.advance(len(data))
        for event in session.close():
            if isinstance(event, Received):
                self._write(event, found, log)
        found.corrupt = session.corrupt.total() + session.partial
        return found

    def _write(self, event: Received, found: _Copied, log: LogFile) -> None:
        t_device_us = event.stamp.t_device_us
        if not found.messages:
            found.first_us = found.last_us = t_device_us
            found.first_sequence = event.message.sequence
        found.messages[event.message.name] += 1
        found.last_us = max(found.last_us, t_device_us)
        started_ns = 0
        if self._started_ns is not None:
            started_ns = self._started_ns - found.first_us * 1000
        log.add(record_by_device(event, started_ns))

    def _say(self, text: str) -> None:
        self._progress.wipe()
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()


def _account(recording: CardRecording, probe: Probe, found: _Copied) -> str:
    counts: Any = probe.account.counts()
    total = totals(counts)
    # Numbers begin with 0 in each recording: those before the first heard are lost.
    before = found.first_sequence
    parts = [
        f"probe {probe.probe_id}",
        duration(found.last_us - found.first_us),
        f"{found.messages['raw']} raw, {found.messages['pose']} pose",
        f"{before + total.sent} sent = {total.received} received + "
        f"{total.skewed.total()} skewed + {before + total.lost} lost",
    ]
    if total.duplicated:
        parts.append(f"{total.duplicated} duplicated")
    if counts["strays"]:
        parts.append(f"{counts['strays']} stray")
    if recording.bad:
        parts.append(f"{plural(recording.bad, 'block')} torn or worn")
    if found.corrupt:
        parts.append(f"{plural(found.corrupt, 'frame')} torn")
    return ", ".join([*parts, end(recording)])
