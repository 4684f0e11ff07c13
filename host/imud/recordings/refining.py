# SPDX-License-Identifier: MIT
"""`imud refine`: poses of a whole recording, with what came later, beside those that
were computed on line: in a copy of its log, as those of a probe NAME-refined.
"""

from __future__ import annotations

import datetime
import math
import os
import sys
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import merge
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from imud import rotation
from imud.calibration.recording import Scale
from imud.errors import ConfigError, FileError
from imud.log.copy import copy_good
from imud.log.file import Channels
from imud.log.reader import size_of
from imud.log.writer import LogWriter
from imud.params import file
from imud.params.value import SENSORS, Params
from imud.probes.record import Record
from imud.progress import Progress
from imud.published import SinceOrigin
from imud.recordings import refined_strokes
from imud.recordings.damage import DamageCount
from imud.recordings.raw_samples import LEAST_S, SUFFIX, Stretch, stretches_of
from imud.recordings.refined_strokes import Refound
from imud.recordings.source import beside
from imud.refine.found import found_by, proposed
from imud.refine.known import priors_of
from imud.refine.model import SHOP, Priors, Recording
from imud.refine.reach import settled
from imud.refine.rests import find_rests
from imud.refine.whole import Part, parts_of
from imud.refine.window import Window
from imud.rotation import FloatArray

FIRST_REST = "first-rest"
YEAR_LEAST = 2000  # a time before it is since a start
BLOCK = 4096  # poses of which there are objects at once
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
    is_proposing: bool = False  # the calibration that was found


@dataclass
class Refined:
    """A stretch and its poses, as far as they have been estimated: one for each raw
    message, in its order.
    """

    stretch: Stretch
    poses: Part
    strokes: Sequence[Refound] = ()
    is_whole: bool = True
    params: Params | None = None  # that it found

    def lines(self) -> Iterator[str]:
        """What was found, for people."""
        t_us, poses = self.stretch.t_us, self.poses
        seconds = (t_us[len(poses.quats) - 1] - t_us[0]) * 1e-6
        tilt, heading, change = map(
            _words, (poses.tilt_deg, poses.heading_deg, poses.change_deg)
        )
        yield (
            f"{self.stretch.probe}: {seconds:.0f} s; 1-sigma errors: tilt {tilt}, "
            f"heading {heading}, changes of heading {change}"
        )
        if self.strokes:
            yield f"  {refined_strokes.words(self.strokes)}"
        yield from (f"  {doubt.words}" for doubt in poses.doubts)


def joined(parts: Sequence[Part], index: np.ndarray[Any, Any]) -> Part:
    """The poses of all parts, by messages: which sample each is."""
    known = index[index < sum(len(part.quats) for part in parts)]

    def rows(name: str) -> Any:
        return np.concatenate([getattr(part, name) for part in parts])

    doubts = dict.fromkeys(doubt for part in parts for doubt in part.doubts)
    by_sample = ("quats", "tilt_deg", "heading_deg", "change_deg", "is_rest")
    found: dict[str, Any] = {name: rows(name)[known] for name in by_sample}
    return Part(**found, fields=rows("fields"), doubts=tuple(doubts))


def _words(sigmas: FloatArray) -> str:
    known = sigmas[np.isfinite(sigmas)]
    return f"{np.median(known):.2f} deg" if len(known) else "withheld"


def refined(stretch: Stretch, how: How, bar: Progress, done_s: float) -> Refined:
    """An estimate; Ctrl-C ends it with what is done."""
    recording, index = stretch.recording()
    priors: Priors = SHOP if how.is_module else priors_of(stretch.params)
    if how.is_simple:
        recording = at_rest_alone(recording)
    parts: list[Part] = []
    strokes: list[Refound] = []
    window: Window | None = None
    is_whole, done = True, 0
    try:
        for part, window in parts_of(
            recording,
            priors,
            stretch.delay_s,
            lambda share: bar.update(done_s + share * stretch.seconds),
        ):
            strokes += refined_strokes.of_part(stretch, index, part, window, done)
            parts.append(part)
            done += len(part.quats)
            if not how.is_proposing or part.doubts:
                window = None  # it is large
    except KeyboardInterrupt:
        if not parts:
            raise
        is_whole = False
    if how.north != FIRST_REST:
        turn = to_north(parts, how.north, recording.node_s)
        parts = [
            replace(each, quats=rotation.multiply(turn, each.quats)) for each in parts
        ]
        strokes = [each.turned(turn) for each in strokes]
    stretch.values = array("f")
    found = Refined(stretch, joined(parts, index), strokes, is_whole)
    if window is not None:
        found.params = _proposed(stretch, window)
    return found


def to_north(parts: Sequence[Part], north: float | str, node_s: float) -> FloatArray:
    """Turns to where north is as the field points at a time, or on the average."""
    fields = np.concatenate([part.fields for part in parts])
    if isinstance(north, float):
        at = round(north / node_s)
        if not 0 <= at < len(fields):
            raise ConfigError(f"--north {north:g}: the recording is shorter")
        fields = fields[at : at + 1]
    east, ahead, _ = fields.mean(axis=0).tolist()
    return rotation.from_rotation_vector(np.array([0.0, 0.0, math.atan2(east, ahead)]))


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
    found: list[Refined] = []
    done_s = 0.0
    try:
        for stretch in stretches:
            if found and not found[-1].is_whole:
                break
            found.append(refined(stretch, how, bar, done_s))
            done_s += stretch.seconds
    except KeyboardInterrupt:
        if not found:
            raise
        found[-1].is_whole = False
    finally:
        bar.end()
    if not found[-1].is_whole:
        bar.say("stopped: what is done is kept")
    return found, damage


def run(
    path: Path, source: Path, to: Path | None, params: Path | None, how: How
) -> int:
    """Writes the log, and to `params` the calibration that was found, and says what
    that is; 0. FileError where it can't.
    """
    to = beside(source, to, f"{SUFFIX}.mcap")
    if os.path.lexists(to):
        raise FileError(f"{to} already exists; choose another file with --to")
    how = replace(how, is_proposing=params is not None)
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


def _proposed(stretch: Stretch, window: Window) -> Params:
    """The params with the calibration that its last window has told."""
    acc, gyr, mag = (float(stretch.hello[f"{name}_lsb"]) for name in SENSORS)
    scale = Scale(acc, gyr, mag, window.recording.rate_hz)
    t_s = int(stretch.t_ns[-1, 0]) / 1e9
    day = datetime.datetime.fromtimestamp(t_s, datetime.UTC).date()
    made = {"day": day} if day.year >= YEAR_LEAST else {}
    window = settled(window)
    found = found_by(window)
    return proposed(found, window.priors, stretch.params, scale, made)


def _propose(found: Sequence[Refined], to: Path) -> None:
    """Writes the calibration that the last stretch of a probe has told."""
    last, *others = {each.stretch.probe: each for each in found}.values()
    if others:
        raise FileError("params are those of one probe; choose it with --probe")
    stretch = last.stretch
    params = last.params or stretch.params
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
        due = (
            records
            for each in found
            for records in (_records(each), refined_strokes.records(each.strokes))
        )
        self._due = merge(*due, key=lambda record: record.t_received_ns)
        self._next: Record | None = next(self._due, None)
        self._channels: Channels | None = None
        self._prefixes = {
            each.stretch.probe + SUFFIX: each.stretch.prefix for each in found
        }

    def add(self, writer: LogWriter, until_ns: int) -> None:
        channels = self._channels = self._channels or Channels(writer)
        while self._next is not None and self._next.t_received_ns <= until_ns:
            channels.add(self._prefixes[self._next.probe], self._next)
            self._next = next(self._due, None)


def _records(of: Refined) -> Iterator[Record]:
    count = len(of.poses.quats)
    for start in range(0, count, BLOCK):
        yield from _some_records(of, slice(start, min(start + BLOCK, count)))


def _some_records(of: Refined, some: slice) -> Iterator[Record]:
    poses, stretch = of.poses, of.stretch
    columns = (poses.tilt_deg, poses.heading_deg, poses.change_deg)
    sigmas = np.stack([column[some] for column in columns], axis=1)
    rows = np.where(np.isfinite(sigmas), sigmas, -1.0).tolist()
    quats, times = poses.quats[some].tolist(), stretch.t_ns[some].tolist()
    t_us, is_rest = stretch.t_us[some], poses.is_rest[some].tolist()
    name = stretch.probe + SUFFIX
    for at, (q, row) in enumerate(zip(quats, rows, strict=True)):
        t_ns, received_ns, _ = times[at]
        tilt, heading, change = (None if sigma < 0.0 else sigma for sigma in row)
        flags = ("at_rest",) * is_rest[at] + ("heading_free",) * (heading is None)
        age_s = (t_us[at] - stretch.t_us[0]) * 1e-6
        number = some.start + at
        values: dict[str, Any] = {
            "type": "pose",
            "probe": name,
            "seq": number,
            "number": number,
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
        yield Record(
            name, "pose", payload, b"", number, t_ns, received_ns, values=values
        )
