# SPDX-License-Identifier: MIT
"""Strokes of a log, measured afterwards: when they were is what the probe has told."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from imud import rotation
from imud.probes.record import Record
from imud.published import Stroke
from imud.recordings.raw_samples import SUFFIX, Stretch
from imud.refine.strokes import REST_LEAST, WINDOW_S, moved
from imud.refine.whole import Part
from imud.refine.window import Window
from imud.rotation import FloatArray

# So many windows and its own before a stroke is told it began, and ended: the firmware
# holds back three or four, and means over a window reach half of one further.
BEGAN, ENDED = 4.25, 3.25
_ENCODER = msgspec.json.Encoder()


@dataclass(frozen=True, slots=True)
class Refound:
    """A stroke as it is measured afterwards."""

    stroke: Stroke
    received_ns: int

    def turned(self, turn: FloatArray) -> Refound:
        """In a world that is turned."""
        way = self.stroke.displacement_m
        if way is None:
            return self
        along = triple(rotation.rotate(turn, np.array(way)))
        stroke = msgspec.structs.replace(self.stroke, displacement_m=along)
        return Refound(stroke, self.received_ns)


def triple(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def of_part(
    stretch: Stretch,
    index: np.ndarray[Any, Any],
    part: Part,
    window: Window | None,
    first: int,
) -> Iterator[Refound]:
    """Those that begin in a part, whose first sample is `first`."""
    if not stretch.strokes:
        return
    told_us = [stroke.t_device_us for stroke, _ in stretch.strokes]
    at = np.searchsorted(np.asarray(stretch.t_us), told_us).clip(max=len(index) - 1)
    each = WINDOW_S * (window.recording.rate_hz if window is not None else 0.0)
    ends = index[at] - first - round(ENDED * each)
    lengths = [stroke.windows + BEGAN - ENDED for stroke, _ in stretch.strokes]
    begins = ends - np.rint(each * np.array(lengths)).astype(int)
    before, after = np.roll(ends, 1), np.roll(begins, -1)
    before[0], after[-1] = 0, np.iinfo(int).max
    margin = round((REST_LEAST + 1) * each) if first else 0
    is_known = window is not None and not any(doubt.is_of_all for doubt in part.doubts)
    for number, (stroke, received_ns) in enumerate(stretch.strokes):
        begin, end = int(begins[number]), int(ends[number])
        if not margin <= begin < len(part.quats) + margin:
            continue
        found = None
        if window is not None and is_known:
            free = int(before[number]), int(after[number])
            found = moved(window, part.quats, (begin, end), free)
        measured = msgspec.structs.replace(
            stroke,
            probe=stroke.probe + SUFFIX,
            displacement_m=None if found is None else triple(found.way),
            displacement_sigma_m=None if found is None else triple(found.sigma),
            path_m=None,
            path_sigma_m=None,
        )
        yield Refound(measured, received_ns)


def records(strokes: Sequence[Refound]) -> Iterator[Record]:
    for each in strokes:
        stroke = each.stroke
        values = {"type": "stroke"} | msgspec.to_builtins(stroke)
        times_ns = stroke.t_ns or 0, each.received_ns
        payload = _ENCODER.encode(values)
        yield Record(stroke.probe, "stroke", payload, b"", stroke.seq, *times_ns)


def words(strokes: Sequence[Refound]) -> str:
    """What was found, for people."""
    known = [each.stroke.displacement_sigma_m for each in strokes]
    sigmas = [max(sigma) for sigma in known if sigma is not None]
    error = f"{1000 * np.median(sigmas):.1f} mm" if sigmas else "withheld"
    return f"{len(strokes)} strokes, {len(sigmas)} measured: 1-sigma error {error}"
