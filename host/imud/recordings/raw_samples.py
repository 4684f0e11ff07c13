# SPDX-License-Identifier: MIT
"""The raw samples in a log, equally spaced, with the poses computed on line."""

from __future__ import annotations

import contextlib
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from imud.errors import FileError, ProbeUnknown
from imud.log.parts import Damage
from imud.log.reader import Logged, LogHead, salvage, size_of
from imud.params.value import Params
from imud.probes.session import ProbeFound, Received
from imud.progress import Progress
from imud.published import Stroke
from imud.recordings.damage import DamageCount
from imud.recordings.decode import Tally, events_of_log
from imud.refine.model import Recording
from imud.rotation import FloatArray
from imud.wire import messages
from imud.wire.messages import Message

SUFFIX = "-refined"  # of the names of probes with refined poses
PAUSE_US = 5_000_000  # longer ones begin another stretch
LEAST_S, RATE_LEAST_HZ = 10.0, 20.0
FULL_SHARE = 0.9  # of a probe's samples that have to be there
NAN = float("nan")
NOTHING = (NAN, NAN, NAN)
# What was with a pose, by its flags; the first one counts.
CAUSES = (
    *("starting", "gap", "clipped", "force_impossible", "field_impossible"),
    *("field_unlike", "mag_disturbed", "mag_absent", "heading_free", "uncalibrated"),
    *("at_rest", "in motion"),
)


@dataclass
class Stretch:
    """What one probe has sent without a boot, a pause or a change of its params."""

    probe: str
    prefix: str  # of its keys in the log
    hello: dict[str, Any]
    params: Params
    gyr_delay_s: float = 0.0  # 0: not known
    t_us: array[float] = field(default_factory=lambda: array("d"))  # of the device
    times: array[int] = field(default_factory=lambda: array("q"))  # see `t_ns`
    values: array[float] = field(default_factory=lambda: array("f"))
    is_bad: array[int] = field(default_factory=lambda: array("b"))
    poses_us: array[float] = field(default_factory=lambda: array("d"))
    poses: array[float] = field(default_factory=lambda: array("f"))
    strokes: list[tuple[Stroke, int]] = field(default_factory=list)  # received, ns
    digest: int | None = None

    def add(self, event: Received) -> None:
        """A raw sample."""
        stamp, fields = event.stamp, event.message.fields
        acc, gyr, mag = event.scales.measure(event.content)
        if acc is None or gyr is None:
            return
        self.t_us.append(stamp.t_device_us)
        self.times.extend((stamp.t_ns or 0, stamp.t_received_ns or 0, stamp.number))
        self.values.extend((*gyr, *acc, *(mag or NOTHING)))
        self.is_bad.append(bool(fields["sample_flags"]))

    def add_pose(self, event: Received) -> None:
        """A pose that was computed on line."""
        fields: Mapping[str, Any] = event.message.fields
        sigmas = (fields["tilt_sigma"], fields["heading_sigma"])
        known = [NAN if sigma is None else float(sigma) for sigma in sigmas]
        flags = fields["pose_flags"]
        cause = next((i for i, flag in enumerate(CAUSES) if flag in flags), -1)
        about = float("tared" in flags), float(cause % len(CAUSES))
        self.poses_us.append(event.stamp.t_device_us)
        self.poses.extend((*fields["q"], *known, *about))

    def add_stroke(self, record: Logged) -> None:
        """One that has ended, as the daemon published it."""
        with contextlib.suppress(msgspec.MsgspecError):
            stroke = msgspec.json.decode(record.data, type=Stroke)
            has_ended = stroke.end != "running" and stroke.windows > 0
            if stroke.displacement_m is not None and has_ended:
                self.strokes.append((stroke, record.t_ns))

    @property
    def seconds(self) -> float:
        return (self.t_us[-1] - self.t_us[0]) * 1e-6 if len(self.t_us) > 1 else 0.0

    @property
    def t_ns(self) -> Any:
        """UTC of each sample, UTC when it was received, and its number: (n, 3)."""
        return np.asarray(self.times, np.int64).reshape(-1, 3)

    @property
    def delay_s(self) -> float:
        """Of the gyroscope's low-pass; half a sample is in its integral."""
        rate_hz = float(self.hello["sample_rate"])
        if self.gyr_delay_s == 0.0 or rate_hz == 0.0:
            return 0.0
        return self.gyr_delay_s - 0.5 / rate_hz

    def recording(self) -> tuple[Recording, np.ndarray[Any, Any]]:
        """Samples at a constant rate, and which of them each message is. FileError
        where too many are missing.
        """
        t_us = np.asarray(self.t_us)
        steps_us = np.diff(t_us)
        usual_us = max(1.0, float(np.median(steps_us)))
        steps = np.maximum(1, np.rint(steps_us / usual_us)).astype(int)
        index = np.concatenate([[0], np.cumsum(steps)])
        rate_hz = 1e6 * index[-1] / (t_us[-1] - t_us[0])
        whole_hz = max(RATE_LEAST_HZ, float(self.hello["sample_rate"]))
        share = len(t_us) / (index[-1] + 1) * min(1.0, rate_hz / whole_hz)
        if share < FULL_SHARE:
            raise FileError(
                f"{self.probe}: {share:.0%} of its samples are in the log; it takes "
                f"all {whole_hz:.0f} a second: set raw_rate of the probe to that"
            )
        rows = np.full((index[-1] + 1, 9), np.nan)
        rows[index] = np.asarray(self.values).reshape(-1, 9)
        is_bad = np.ones(len(rows), bool)
        is_bad[index] = np.asarray(self.is_bad, bool)
        last = np.maximum.accumulate(
            np.where(np.isfinite(rows[:, 0]), range(len(rows)), 0)
        )
        rows[:, :6] = rows[last, :6]  # held where one is missing
        gyr, acc, mag = rows[:, :3], rows[:, 3:6], rows[:, 6:]
        return Recording(rate_hz, gyr, acc, mag, is_bad), index

    def online(self) -> tuple[FloatArray, FloatArray]:
        """Times of the poses in us, (m,), and their quaternion, sigmas of tilt and
        heading in degrees, whether an origin was set, and the index of CAUSES: (m, 8).
        """
        rows = np.asarray(self.poses, float).reshape(-1, 8)
        return np.asarray(self.poses_us), rows


def stretches_of(path: Path, damage: DamageCount, probe: str | None) -> list[Stretch]:
    """Of all probes in a log, or of one."""
    bar = Progress("reading", size_of(path))
    found: list[Stretch] = []
    latest: dict[str, Stretch] = {}
    prefixes: dict[str, str] = {}
    try:
        for name, event in _events(path, damage, bar, prefixes):
            if isinstance(event, Logged):
                if name in latest:
                    latest[name].add_stroke(event)
                continue
            if probe is not None and name != probe:
                continue
            if isinstance(event, ProbeFound):
                latest.pop(name, None)
                continue
            of = latest.get(name)
            if event.message.name == "pose" and of is not None:
                of.add_pose(event)
            elif event.message.name == "raw" and event.params is not None:
                if of is None or _is_other(of, event):
                    of = latest[name] = _begun(name, prefixes[name], event)
                    found.append(of)
                of.add(event)
    finally:
        bar.end()
    if probe is not None and probe not in prefixes:
        raise ProbeUnknown(
            f"{path}: no probe {probe}; available: {', '.join(sorted(prefixes))}"
        )
    for name in latest:
        if f"{name}{SUFFIX}" in prefixes:
            raise FileError(
                f"{path} has refined poses already; give the log it was made of"
            )
    return [each for each in found if each.seconds >= LEAST_S]


def _events(
    path: Path, damage: DamageCount, bar: Progress, prefixes: dict[str, str]
) -> Iterator[tuple[str, ProbeFound | Received | Logged]]:
    """What the probes said, and their strokes; notes the prefixes of their keys."""
    tally = Tally()
    tally.damage = damage
    strokes: list[Logged] = []  # a Nano's are computed by the daemon: in no frame

    def noted() -> Iterator[LogHead | Logged | Damage]:
        for record in salvage(path, bar.update):
            if isinstance(record, Logged):
                prefixes.setdefault(record.probe, record.prefix)
                if record.topic == "stroke":
                    strokes.append(record)
            yield record

    for name, events in events_of_log(path, tally, noted()):
        for event in events:
            if isinstance(event, ProbeFound | Received):
                yield name, event
        yield from ((stroke.probe, stroke) for stroke in strokes)
        strokes.clear()


def _is_other(of: Stretch, event: Received) -> bool:
    pause_us = event.stamp.t_device_us - of.t_us[-1] if of.t_us else 0.0
    return not 0 <= pause_us <= PAUSE_US or event.scales.digest != of.digest


def _begun(name: str, prefix: str, event: Received) -> Stretch:
    hello = messages.decode(event.scales.hello)
    fields = hello.fields if isinstance(hello, Message) else {}
    params = Params.decode(event.params or b"")
    delay_s, digest = event.scales.gyr_delay_s, event.scales.digest
    return Stretch(name, prefix, dict(fields), params, delay_s, digest=digest)
