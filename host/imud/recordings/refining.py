# SPDX-License-Identifier: MIT
"""`imud refine`: poses of a whole recording, with what came later, beside those that
were computed on line: in a copy of its log, as those of a probe NAME-refined.
"""

from __future__ import annotations

import datetime
import math
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from imud import rotation
from imud.calibration.recording import Scale
from imud.errors import ConfigError, FileError
from imud.log.channels import pose_in_frame
from imud.log.copy import copy_good
from imud.log.reader import size_of
from imud.log.schemas import schema_of
from imud.log.writer import LogWriter
from imud.params import file
from imud.params.value import SENSORS
from imud.probes.record import Record
from imud.progress import Progress
from imud.published import SinceOrigin
from imud.recordings.damage import DamageCount
from imud.recordings.raw_samples import LEAST_S, SUFFIX, Stretch, stretches_of
from imud.refine.found import proposed
from imud.refine.known import priors_of
from imud.refine.model import FIELD, SHOP, Priors, Recording
from imud.refine.rests import find_rests
from imud.refine.whole import Part, parts_of
from imud.rotation import FloatArray

FIRST_REST = "first-rest"
YEAR_LEAST = 2000  # a time before it is since a start
_ENCODER = msgspec.json.Encoder()


@dataclass(frozen=True, slots=True)
class How:
    """What the caller knows and wants."""

    is_module: bool = False  # as shops sell it, whatever its params say
    is_simple: bool = False  # the field at rest alone
    # Where the field points at its first rest, on the average ("place"), or at a time,
    # in seconds.
    north: float | str = FIRST_REST
    probe: str | None = None


@dataclass
class Refined:
    """A stretch and its poses, as far as they have been estimated."""

    stretch: Stretch
    recording: Recording
    index: np.ndarray[Any, Any]  # which sample each message is
    parts: list[Part] = field(default_factory=list)

    def joined(self, name: str) -> FloatArray:
        """A field of all parts, by messages."""
        rows = np.concatenate([getattr(part, name) for part in self.parts])
        return np.asarray(rows[self.index[self.index < len(rows)]])

    @property
    def doubts(self) -> list[str]:
        """Why something is withheld, each once."""
        words = (doubt.words for part in self.parts for doubt in part.doubts)
        return list(dict.fromkeys(words))

    def lines(self) -> Iterator[str]:
        """What was found, for people."""
        seconds = len(self.joined("tilt_deg")) / self.recording.rate_hz
        tilt, heading, change = (
            _words(self.joined(name))
            for name in ("tilt_deg", "heading_deg", "change_deg")
        )
        yield (
            f"{self.stretch.probe}: {seconds:.0f} s; 1-sigma errors: tilt {tilt}, "
            f"heading {heading}, changes of heading {change}"
        )
        yield from (f"  {words}" for words in self.doubts)


def _words(sigmas: FloatArray) -> str:
    known = sigmas[np.isfinite(sigmas)]
    return f"{np.median(known):.2f} deg" if len(known) else "withheld"


def refined(stretch: Stretch, how: How, bar: Progress, done_s: float) -> Refined:
    """An estimate; Ctrl-C ends it with what is done."""
    recording, index = stretch.recording()
    priors: Priors = SHOP if how.is_module else priors_of(stretch.params)
    if how.is_simple:
        recording = at_rest_alone(recording)
    found = Refined(stretch, recording, index)
    parts = parts_of(
        recording,
        priors,
        stretch.delay_s,
        lambda share: bar.update(done_s + share * stretch.seconds),
    )
    try:
        for part in parts:
            found.parts.append(part)
    except KeyboardInterrupt:
        if not found.parts:
            raise
        bar.say("stopped: what is done is kept")
    if how.north != FIRST_REST:
        found.parts = turned(found.parts, how.north)
    return found


def turned(parts: Sequence[Part], north: float | str) -> list[Part]:
    """The same with north where the field points at a time, or on the average."""
    node_s = parts[0].window.recording.node_s
    fields = np.concatenate(
        [
            part.window.estimate.states[
                : round(len(part.quats) / part.window.recording.each), FIELD
            ]
            for part in parts
        ]
    )
    if isinstance(north, float):
        at = round(north / node_s)
        if not 0 <= at < len(fields):
            raise ConfigError(f"--north {north:g}: the recording is shorter")
        fields = fields[at : at + 1]
    east, ahead, _ = fields.mean(axis=0).tolist()
    to_north = rotation.from_rotation_vector(
        np.array([0.0, 0.0, math.atan2(east, ahead)])
    )
    return [
        replace(each, quats=rotation.multiply(to_north, each.quats)) for each in parts
    ]


def at_rest_alone(recording: Recording) -> Recording:
    """Without the field that was read in motion."""
    is_rest = np.zeros(len(recording.gyr), bool)
    at = np.repeat(find_rests(recording), recording.each)
    is_rest[: len(at)] = at
    mag = np.where(is_rest[:, None], recording.mag, np.nan)
    return Recording(
        recording.rate_hz, recording.gyr, recording.acc, mag, recording.is_bad
    )


def all_refined(path: Path, how: How) -> tuple[list[Refined], DamageCount]:
    """Of all stretches of a log. FileError where there is none that can be."""
    damage = DamageCount()
    stretches = stretches_of(path, damage, how.probe)
    if not stretches:
        raise FileError(
            f"{path} has no raw samples of {LEAST_S:.0f} s and more: let the probe "
            "send all of them (raw_rate in its configuration) while it is logged"
        )
    bar = Progress("refining", sum(each.seconds for each in stretches))
    found, done_s = [], 0.0
    try:
        for stretch in stretches:
            found.append(refined(stretch, how, bar, done_s))
            done_s += stretch.seconds
    except KeyboardInterrupt:
        if not found:
            raise
    finally:
        bar.end()
    return found, damage


def run(
    path: Path, source: Path, to: Path | None, params: Path | None, how: How
) -> int:
    """Writes the log, and to `params` the calibration that was found, and says what
    that is; 0. FileError where it can't.
    """
    to = to or source.with_name(f"{source.stem}{SUFFIX}.mcap")
    if os.path.lexists(to):
        raise FileError(f"{to} already exists; choose another file with --to")
    found, damage = all_refined(path, how)
    part = to.with_name(f"{to.name}.part")
    bar = Progress("writing", size_of(path))
    try:
        copy_good(path, part, bar.update, Beside(found).add)
        part.rename(to)
    except OSError as error:
        raise FileError(f"can't write {to}: {error.strerror}") from error
    finally:
        bar.end()
        part.unlink(missing_ok=True)
    for each in found:
        sys.stdout.writelines(f"{line}\n" for line in each.lines())
    if params is not None:
        _propose(found, params)
    sys.stdout.write(f"{to}: imud export {to}, or play it on the page\n")
    if words := damage.words():
        raise FileError(f"{path} is {words}")
    return 0


def _propose(found: Sequence[Refined], to: Path) -> None:
    """Writes the calibration that the last stretch of a probe has told."""
    last, *others = {each.stretch.probe: each for each in found}.values()
    if others:
        raise FileError("params are those of one probe; choose it with --probe")
    stretch = last.stretch
    acc, gyr, mag = (float(stretch.hello[f"{name}_lsb"]) for name in SENSORS)
    scale = Scale(acc, gyr, mag, last.recording.rate_hz)
    t_s = int(stretch.t_ns[-1, 0]) / 1e9
    day = datetime.datetime.fromtimestamp(t_s, datetime.UTC).date()
    made = {"day": day} if day.year >= YEAR_LEAST else {}
    part = last.parts[-1]
    params = stretch.params
    if not part.doubts:
        params = proposed(part.window, stretch.params, scale, made)
    told = [
        name
        for name in SENSORS
        if getattr(params, name) != getattr(stretch.params, name)
    ]
    if not told:
        sys.stdout.write(f"{to} not written: it tells no calibration better\n")
        return
    file.write(to, params, stretch.hello["probe_id"].hex())
    sys.stdout.write(
        f"{to}: found {', '.join(told)}; imud params load {stretch.probe} {to}\n"
    )


class Beside:
    """The refined poses, added to the copy of a log as their samples come."""

    def __init__(self, found: Sequence[Refined]) -> None:
        self._due = chain.from_iterable(map(_records, found))
        self._next: Record | None = next(self._due, None)
        self._channels: dict[tuple[str, str], int] = {}
        self._prefixes = {each.stretch.probe: each.stretch.prefix for each in found}

    def add(self, writer: LogWriter, until_ns: int) -> None:
        while self._next is not None and self._next.t_received_ns <= until_ns:
            record = self._next
            for topic, data in (
                ("pose", record.payload),
                ("pose_in_frame", pose_in_frame(record)),
            ):
                channel = self._channels.get((record.probe, topic))
                if channel is None:
                    channel = self._channel(writer, record.probe, topic)
                writer.add_message(
                    channel, record.t_received_ns, data, record.t_ns, record.sequence
                )
            self._next = next(self._due, None)

    def _channel(self, writer: LogWriter, probe: str, topic: str) -> int:
        name, body = schema_of(topic)
        schema = writer.register_schema(name, "jsonschema", _ENCODER.encode(body))
        prefix = self._prefixes[probe.removesuffix(SUFFIX)]
        channel = writer.register_channel(f"{prefix}/{probe}/{topic}", "json", schema)
        self._channels[probe, topic] = channel
        return channel


def _records(of: Refined) -> Iterator[Record]:
    quats, is_rest = of.joined("quats"), of.joined("is_rest").tolist()
    sigmas = np.stack(
        [of.joined(name) for name in ("tilt_deg", "heading_deg", "change_deg")], axis=1
    )
    rows = np.where(np.isfinite(sigmas), sigmas, -1.0).tolist()
    times, t_us = of.stretch.t_ns.tolist(), of.stretch.t_us
    name = of.stretch.probe + SUFFIX
    for at, (q, row) in enumerate(zip(quats.tolist(), rows, strict=True)):
        t_ns, received_ns, _ = times[at]
        tilt, heading, change = (None if sigma < 0.0 else sigma for sigma in row)
        flags = ("at_rest",) * is_rest[at] + ("heading_free",) * (heading is None)
        age_s = (t_us[at] - t_us[0]) * 1e-6
        values: dict[str, Any] = {
            "type": "pose",
            "probe": name,
            "seq": at,
            "number": at,
            "missing": 0,
            "t_device_us": round(t_us[at]),
            "t_ns": t_ns,
            "t_bound_us": None,
            "age_us": None,
            "q": q,
            "position_m": None,
            "normal": None,
            "tilt_sigma_deg": tilt,
            "heading_sigma_deg": heading,
            "flags": flags,
            "since_origin": SinceOrigin(change, tilt, age_s),
        }
        payload = _ENCODER.encode(values)
        yield Record(name, "pose", payload, b"", at, t_ns, received_ns, values=values)
