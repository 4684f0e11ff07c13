# SPDX-License-Identifier: MIT
"""Recordings of other programs, as a log like any other: the wire's messages of a probe
whose firmware is called `import`.

Gaps, jitter and missing readings stay what they are: each row keeps its time, and a
magnetometer that repeats a reading had nothing new.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import multiprocessing
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, cast

import msgspec
import numpy as np

from imud.errors import FileError, reason
from imud.log.file import LogFile, Settings
from imud.probes.probe import Probe
from imud.probes.record import Record, Stamp, record_of
from imud.probes.scales import Scales
from imud.progress import Progress
from imud.recordings import foreign_map, foreign_table
from imud.recordings.foreign_map import SENSORS, ForeignMap
from imud.recordings.foreign_text import ForeignTable
from imud.rotation import FloatArray
from imud.wire import messages, raws, schema
from imud.wire.messages import Message

Times = np.ndarray[Any, np.dtype[np.int64]]
Contents = Iterator[tuple[int, bytes]]

FIRMWARE = "import"
COUNTS_MAX = 32000.0  # of 16 bits
# 16 g, 2,000 deg/s, and what iron about a probe adds to the Earth's field.
RANGES = {"acc": 160.0, "gyr": 35.0, "mag": 400.0}
LEAST_LSB = {"acc": 1e-6, "gyr": 1e-7, "mag": 1e-3}
CLIPPED = {"acc": "ACC_CLIPPED", "gyr": "GYR_CLIPPED"}
HELLO_S = 1.0
FIRST_US = 1000  # of the first row
PAUSE_US = 1_800_000_000  # without a message
REPEATED_MIN = 0.2  # a share of readings alike that no noise makes
BESIDE, OFTEN = 8, 5  # values below an extreme, and how many times as often it comes
SAMPLES_MIN = 20
LEFT_OUT_MAX = 0.05  # a share of rows

_ENCODER = msgspec.json.Encoder()


@dataclass(slots=True)
class Counts:
    """Of the rows so far."""

    samples: int = 0
    has_mag: bool = False
    gaps: int = 0
    even_us: int = 0  # without gaps
    first_s: float = -np.inf  # of the first sample, as foreign_map tells times
    last_s: float = -np.inf
    left_out: int = 0  # rows that lack a number, or go back in time
    why: str = ""  # about the first of them
    clipped: Counter[str] = field(default_factory=Counter)  # by sensor

    def add(self, t_us: Times, last_us: int | None) -> None:
        """Takes samples behind one."""
        steps = np.diff(t_us, prepend=t_us[:1] if last_us is None else last_us)
        is_even = steps <= 3 * np.median(steps)
        self.samples += len(t_us)
        self.gaps += int((~is_even).sum())
        self.even_us += int(steps[is_even].sum())

    @property
    def loss(self) -> str:
        rows = "row" if self.left_out == 1 else "rows"
        return f"{self.left_out} {rows} left out ({self.why})"


@dataclass(frozen=True, slots=True)
class Imported:
    """Samples, in SI units and uT in the body frame: all, or a part that follows
    another one and has its `counts` and units of counts.
    """

    t_us: Times
    acc: FloatArray
    gyr: FloatArray
    mag: FloatArray  # NaN where there was nothing new
    told: ForeignMap
    lsbs: dict[str, float]
    clipped: dict[str, np.ndarray[Any, np.dtype[np.bool_]]]
    counts: Counts
    texts: tuple[str, ...]  # columns without numbers
    began_s: float | None  # UTC of the first sample of all, if it is known
    before_us: int = 0  # the last time of the part before
    end: int = 0  # bytes of the file that were read; 0: not known

    @property
    def has_mag(self) -> bool:
        return self.counts.has_mag

    @property
    def rate_hz(self) -> float:
        """Rows over time, without gaps."""
        steps = self.counts.samples - 1 - self.counts.gaps
        return 1e6 * steps / self.counts.even_us

    def words(self) -> str:
        """On one line, with the parts before."""
        counts = self.counts
        parts = [f"{counts.samples:,} samples at {self.rate_hz:.1f} Hz"]
        parts += [f"{counts.gaps} gaps"] if counts.gaps else []
        parts += [counts.loss] if counts.left_out else []
        parts += [f"{n} of {name} clipped" for name, n in counts.clipped.items() if n]
        if not self.has_mag:
            parts.append("no magnetometer")
        if self.texts:
            parts.append(f"without columns {', '.join(self.texts)}")
        return ", ".join(parts)

    def check_complete(self, source: Path) -> None:
        """FileError if more was left out than a file may lack."""
        rows = self.counts.left_out + self.counts.samples
        if self.counts.left_out > LEFT_OUT_MAX * rows:
            raise FileError(f"{source}: {self.counts.loss} of {rows}: correct the file")


def read(path: Path, told: ForeignMap | None = None) -> Imported:
    """The first part of a recording, which is all of one that is not long. FileError
    with what is wrong, or has to be told.
    """
    return next(parts(path, told))


def parts(path: Path, told: ForeignMap | None = None) -> Iterator[Imported]:
    """A foreign recording, in parts that take little memory. FileError with what is
    wrong, or has to be told.
    """
    told = told or ForeignMap()
    last: Imported | None = None
    for table in foreign_table.parts(path, told.only, told.topics):
        if len(table) or not table.has_more:
            found = _part(path, table, told, last)
            if len(found.t_us):
                last = found
                yield found


@np.errstate(over="ignore", invalid="ignore")  # of numbers that are none of a sensor
def _part(
    path: Path, table: ForeignTable, told: ForeignMap, last: Imported | None
) -> Imported:
    row = 1 + told.rows
    counts = Counts() if last is None else last.counts
    t_s = foreign_map.completed(table, told)
    acc, gyr = (foreign_map.vector(table, told, name) for name in ("acc", "gyr"))
    mag = np.full_like(acc, np.nan)
    if "mag" in told.columns:
        mag = _fresh(foreign_map.vector(table, told, "mag"))
    is_full = np.isfinite(t_s) & np.isfinite(np.hstack([acc, gyr])).all(axis=1)
    latest = np.maximum.accumulate(np.where(is_full, t_s, counts.last_s))
    is_whole = is_full & (np.diff(latest, prepend=counts.last_s) > 0.0)
    counts.why = counts.why or table.why
    if not counts.why and not is_whole.all():
        at = int(np.argmin(is_whole))
        lack = "its time is not later" if is_full[at] else "a number is missing"
        counts.why = f"row {row + at}: {lack}"
    counts.left_out += table.unread + len(table) - int(is_whole.sum())
    if last is None and is_whole.sum() < SAMPLES_MIN:
        why = f"; {counts.why}" * bool(counts.why)
        raise FileError(f"{path}: {is_whole.sum()} samples are too few{why}")
    t_s = t_s[is_whole]
    if last is None:
        counts.first_s = float(t_s[0])
    t_us = np.rint(1e6 * (t_s - counts.first_s)).astype(np.int64) + FIRST_US
    if len(t_us):
        counts.add(t_us, None if last is None else last.t_us[-1])
        counts.last_s = float(t_s[-1])
    rows = dict(zip(SENSORS, (each[is_whole] for each in (acc, gyr, mag)), strict=True))
    counts.has_mag |= bool(np.isfinite(rows["mag"]).any())
    lsbs = {} if last is None else last.lsbs
    for name in () if lsbs else SENSORS:
        lsbs[name] = _lsb(name, rows[name], is_all=not table.has_more)
    clipped = {name: _is_clipped(rows[name], lsbs[name]) for name in SENSORS}
    counts.clipped.update({name: int(is_it.sum()) for name, is_it in clipped.items()})
    return Imported(
        t_us,
        **rows,
        told=told,
        lsbs=lsbs,
        clipped=clipped,
        counts=counts,
        texts=table.texts,
        began_s=None if told.began_s is None else told.began_s + counts.first_s,
        before_us=0 if last is None else int(last.t_us[-1]),
        end=table.end,
    )


def _fresh(mag: FloatArray) -> FloatArray:
    """Without what a slower magnetometer repeats."""
    is_same = np.concatenate([[False], (np.diff(mag, axis=0) == 0.0).all(axis=1)])
    if is_same.mean() < REPEATED_MIN:
        return mag
    return np.where(is_same[:, None], np.nan, mag)


def contents(found: Imported, hello: dict[str, Any], first: int) -> Contents:
    """Times and contents of the messages that the probe would have sent, from that
    sequence number on.
    """
    t_us, count = found.t_us, len(found.t_us)
    rows = raws.blank(count)
    rows["time_us"] = t_us & 0xFFFFFFFF
    for name in SENSORS:
        counts = _counts(getattr(found, name), found.lsbs[name])
        is_there = np.isfinite(counts).all(axis=1)
        rows[name][is_there] = counts[is_there]
    for name, flag in CLIPPED.items():
        rows["sample_flags"][found.clipped[name]] |= np.uint8(schema.SampleFlags[flag])
    hellos = _hellos(t_us, found.before_us)
    places = np.array([at for at, _ in hellos], np.int64)
    sent = np.arange(count) + np.searchsorted(places, np.arange(count), "right")
    rows["sequence"] = first + sent
    data, times_us, size = rows.tobytes(), t_us.tolist(), raws.SIZE
    for number, (begin, hello_us) in enumerate(hellos):
        end = hellos[number + 1][0] if number + 1 < len(hellos) else count
        yield (
            hello_us,
            messages.encode("hello", hello, first + begin + number, hello_us),
        )
        for at in range(begin, end):
            yield times_us[at], data[at * size : (at + 1) * size]


def _hellos(t_us: Times, before_us: int) -> list[tuple[int, int]]:
    """Before which row a hello comes, and when: with the first one, after a second,
    and in pauses that the wire's 32 bits of us do not hold.
    """
    found, at = [], 0
    while at < len(t_us):
        before, now = before_us if at == 0 else int(t_us[at - 1]), int(t_us[at])
        found += [(at, us) for us in range(before + PAUSE_US, now, PAUSE_US)]
        found.append((at, now))
        at = int(np.searchsorted(t_us, now + round(HELLO_S * 1e6)))
    return found


def _counts(rows: FloatArray, lsb: float) -> FloatArray:
    """A clipped reading has one more than all others."""
    return np.clip(np.rint(rows / lsb), -COUNTS_MAX - 1.0, COUNTS_MAX + 1.0)


def _is_clipped(rows: FloatArray, lsb: float) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Beyond all counts, or where the sensor was: at an extreme that comes far more
    often than the values next to it.
    """
    is_it = np.asarray((np.abs(_counts(rows, lsb)) > COUNTS_MAX).any(axis=1))
    for column in rows.T:
        values, counts = np.unique(column[np.isfinite(column)], return_counts=True)
        if len(values) <= BESIDE:
            continue
        # At rest some say 0.
        if values[-1] > 0.0 and counts[-1] >= OFTEN * counts[-1 - BESIDE : -1].max():
            is_it |= column == values[-1]
        if values[0] < 0.0 and counts[0] >= OFTEN * counts[1 : 1 + BESIDE].max():
            is_it |= column == values[0]
    return is_it


def _lsb(name: str, rows: FloatArray, *, is_all: bool) -> float:
    """The value of a count, so that 16 bits hold the largest reading, but for a few
    that are far above all others and above a sensor's range; of a part at least that
    range.
    """
    sizes = np.abs(rows[np.isfinite(rows)])
    most = float(sizes.max(initial=0.0))
    if most > RANGES[name]:
        most = min(most, max(RANGES[name], 4.0 * float(np.percentile(sizes, 99.5))))
    if not is_all:
        most = max(most, RANGES[name])
    return max(LEAST_LSB[name], most / COUNTS_MAX)


def hello_of(found: Imported, probe_id: bytes) -> dict[str, Any]:
    rate_hz = min(65535, max(1, round(found.rate_hz)))
    return {
        "protocol_version": schema.PROTOCOL_VERSION,
        "schema_fingerprint": schema.FINGERPRINT,
        "firmware": FIRMWARE,
        "board": "micropython",  # any board
        "probe_id": probe_id,
        # Nine axes, or six: which chip it was is not known.
        "sensor": "mpu9250" if found.has_mag else "mpu6500",
        "who_am_i": (0, 0),
        "mag_adjust": (0, 0, 0),
        "self_test": (),
        "sample_rate": rate_hz,
        "pose_rate": 0,
        "raw_rate": rate_hz,
        **{f"{name}_lsb": found.lsbs[name] for name in SENSORS},
        "boot_count": 1,
        "reset_cause": (),
        "filter": "none",
        "reset_address": 0,
        "params_digest": 0,
        "own_field": (0.0, 0.0, 0.0),
        "own_sigma": 0.0,
    }


def write(found: Iterator[Imported], source: Path, log: Path) -> tuple[str, Imported]:
    """Writes the log of all parts; returns the probe's id, made of the file's name and
    the first samples, and the last part. There is no log if that fails.
    """
    part = log.with_name(f"{log.name}.part")  # of one that was killed, too
    bar = Progress("importing", source.stat().st_size if source.exists() else 0)
    try:
        with part.open("wb") as file:
            out = LogFile(file, Settings())
            probe, last = _write(found, source, out, bar)
            out.finish()
        part.replace(log)
    except BaseException as error:
        part.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise FileError(f"can't write {log}: {reason(error)}") from error
        raise
    finally:
        bar.end()
    return probe.probe_id, last


def _ahead(path: Path, found: Iterator[Imported]) -> Iterator[Imported]:
    """The same parts: those behind the first are read by another process, while this
    one writes.
    """
    yield from itertools.islice(found, 1)
    if sys.platform != "linux":
        yield from found
        return
    fork = multiprocessing.get_context("fork")  # what is read from stays open in it
    here, there = fork.Pipe(duplex=False)
    reader = fork.Process(target=_send, args=(found, there), daemon=True)
    reader.start()
    there.close()
    try:
        while (part := here.recv()) is not None:
            if isinstance(part, FileError):
                raise part
            yield part
    except EOFError as error:
        raise FileError(f"{path}: the process that read it was ended") from error
    finally:
        reader.kill()
        reader.join()


def _send(found: Iterator[Imported], to: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other one ends both
    try:
        for part in found:
            to.send(part)
        to.send(None)
    except FileError as error:
        to.send(error)


class _Raws:
    """Writes samples behind a first one, whose record differs in a few values."""

    def __init__(self, first: Record, scales: Scales, out: LogFile) -> None:
        self._first, self._scales, self._out = first, scales, out
        self._values = dict(first.values)

    def add(
        self, raw: Message, content: bytes, number: int, t_us: int, t_ns: int
    ) -> None:
        fields, values = raw.fields, self._values
        values["seq"], values["number"] = raw.sequence, number
        values["t_device_us"], values["t_ns"] = t_us, t_ns
        measured = self._scales.measure(content)
        values["acc_m_s2"], values["gyr_rad_s"], values["mag_uT"] = measured
        values["acc_counts"], values["gyr_counts"] = fields["acc"], fields["gyr"]
        values["mag_counts"], values["flags"] = fields["mag"], fields["sample_flags"]
        self._out.add_like(
            self._first, _ENCODER.encode(values), content, raw.sequence, t_ns
        )


def _write(
    found: Iterator[Imported], source: Path, out: LogFile, bar: Progress
) -> tuple[Probe, Imported]:
    sent, numbers, probe, hello = 0, Counter[str](), None, dict[str, Any]()
    samples: _Raws | None = None
    for part in _ahead(source, found):
        if probe is None:
            digest = hashlib.sha256(source.name.encode())
            for rows in (part.t_us, part.acc, part.gyr):
                digest.update(rows.tobytes())
            probe = Probe(digest.hexdigest()[:16])
            hello = hello_of(part, bytes.fromhex(probe.probe_id))
        started_ns = 0
        if part.began_s is not None:
            started_ns = 1000 * (round(1e6 * part.began_s) - FIRST_US)
        for t_us, content in contents(part, hello, sent):
            message = cast(Message, messages.decode(content))
            number = numbers[message.name] = numbers[message.name] + 1
            sent += 1
            t_ns = max(0, 1000 * t_us + started_ns)
            if message.name == "raw" and samples is not None:
                samples.add(message, content, number, t_us, t_ns)
                continue
            probe.update(message, content)
            stamp, scales = Stamp(number, 0, t_us, t_ns, None, t_ns), probe.scales
            record = record_of(message, content, probe.probe_id, stamp, scales)
            out.add(record)
            samples = _Raws(record, scales, out) if message.name == "raw" else None
        bar.update(part.end)
    if probe is None:
        raise FileError(f"{source}: no rows could be written")
    return probe, part


@contextlib.contextmanager
def log_of_foreign(path: Path) -> Iterator[Path]:
    """A log of a foreign recording, for as long as it is used; all that is needed to
    know of it is guessed.
    """
    with tempfile.TemporaryDirectory(prefix="imud-") as folder:
        log = Path(folder) / f"{path.stem}.mcap"
        write(parts(path), path, log)[1].check_complete(path)
        yield log
