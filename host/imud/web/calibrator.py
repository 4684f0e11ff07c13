# SPDX-License-Identifier: MIT
"""Calibrates one probe in a process of its own, so that the fits take no time from the
daemon. It reads lines of JSON: a Task, then what is published on the probe's topic
`raw`, and perhaps an End. It writes its state as lines of JSON.
"""

from __future__ import annotations

import datetime
import sys
import time
from typing import BinaryIO

import msgspec

from imud.calibration.earth import Earth
from imud.calibration.recording import Counts, Sample, Scale
from imud.calibration.session import CalibrationSession, Kind, Subject
from imud.params.value import Params

STATE_S = 0.1  # between two states that differ only by what is measured

_encode = msgspec.json.Encoder().encode


class Task(msgspec.Struct, frozen=True):
    """The task. `params`: the active records, as hexadecimal digits."""

    probe: str
    kind: Kind
    scale: Scale
    has_mag: bool
    params: str
    digest: str
    earth: Earth | None = None


class RawSample(msgspec.Struct, frozen=True, tag="raw"):
    """The part of a published raw sample that a calibration needs."""

    t_device_us: int
    acc_counts: Counts
    gyr_counts: Counts
    mag_counts: Counts | None
    temperature_c: float | None
    flags: tuple[str, ...] = ()


class End(msgspec.Struct, frozen=True, tag="end"):
    """Evaluate the samples so far."""


decode = msgspec.json.Decoder(RawSample | End).decode


def sample_of(raw: RawSample) -> Sample:
    """The sample, in counts."""
    return Sample(
        raw.t_device_us,
        raw.acc_counts,
        raw.gyr_counts,
        raw.mag_counts,
        raw.temperature_c,
        "acc_clipped" in raw.flags or "gyr_clipped" in raw.flags,
    )


def run(lines: BinaryIO, out: BinaryIO) -> None:
    """Works until it is over, or the lines end."""
    task = msgspec.json.decode(lines.readline(), type=Task)
    before = Params.decode(bytes.fromhex(task.params))
    subject = Subject(task.scale, before, task.has_mag, task.earth)
    session = CalibrationSession(
        task.kind, subject, datetime.datetime.now(datetime.UTC).date()
    )
    about = {"type": "calibration", "probe": task.probe}
    about |= {"before": task.params, "before_digest": task.digest}
    told_s = 0.0
    for line in lines:
        message = decode(line)
        is_asked = isinstance(message, End)
        if isinstance(message, End):
            session.end()
        else:
            session.feed(sample_of(message))
        now_s = time.monotonic()
        if session.is_over or is_asked or now_s - told_s >= STATE_S:
            told_s = now_s
            out.write(_encode(about | session.state()) + b"\n")
            out.flush()
        if session.is_over:
            return


if __name__ == "__main__":
    run(sys.stdin.buffer, sys.stdout.buffer)
