# SPDX-License-Identifier: MIT
"""The samples of probes on a body: from logs, or from motion files."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from imud.body import fused, level, tracks
from imud.body.tracks import Track
from imud.errors import FileError
from imud.log.reader import Logged, salvage
from imud.rotation import FloatArray
from imud.virtual import motion

MOTIONS = (".npz", ".csv")
POSES_MIN = 10

Rows = list[tuple[float, ...]]


def of_files(names: Sequence[str]) -> dict[str, Track]:
    """Tracks by probe, of logs and of motions as PROBE=FILE. Raises FileError.

    Times are in s of UTC; motions begin at 0.
    """
    found: dict[str, Track] = {}
    logs = []
    for name in names:
        probe, equals, file = name.partition("=")
        if equals and Path(file).suffix.lower() in MOTIONS:
            found[probe] = of_motion(Path(file))
        elif Path(name).suffix.lower() in MOTIONS:
            raise FileError(f"{name}: add the name of its probe: PROBE={name}")
        else:
            logs.append(Path(name))
    if logs:
        if found:
            raise FileError("logs have UTC and motions do not; give only one kind")
        found = of_logs(logs)
    return found


def of_motion(path: Path) -> Track:
    """The track of one motion file, whose poses the firmware's C computes."""
    recorded = motion.load(path)
    times_s = np.arange(len(recorded)) / recorded.rate_hz
    try:
        return fused.attitudes(times_s, recorded.gyr, recorded.acc, recorded.mag)
    except ValueError as error:
        raise FileError(f"{path}: {error}") from error


def of_logs(paths: Iterable[Path]) -> dict[str, Track]:
    """Tracks by probe of all logs together. Forces come from raw messages."""
    poses: dict[str, Rows] = {}
    raws: dict[str, Rows] = {}
    undated: set[str] = set()
    for path in paths:
        for item in salvage(path, lambda _: None):
            if not isinstance(item, Logged) or item.topic not in ("pose", "raw"):
                continue
            fields = _fields_of(item)
            if fields.get("t_ns") is None or fields.get("t_bound_us") is None:
                undated.add(item.probe)
                continue
            time_s = fields["t_ns"] * 1e-9
            if item.topic == "pose":
                sigmas = (fields.get("tilt_sigma_deg"), fields.get("heading_sigma_deg"))
                row = (time_s, *fields["q"], *map(_number, sigmas))
                poses.setdefault(item.probe, []).append(row)
            elif fields.get("acc_m_s2") is not None:
                field = fields.get("mag_uT") or (np.nan,) * 3
                row = (time_s, *fields["gyr_rad_s"], *fields["acc_m_s2"], *field)
                raws.setdefault(item.probe, []).append(row)
    found = {
        probe: _track(np.array(sorted(rows)), raws.get(probe, []))
        for probe, rows in poses.items()
        if len(rows) >= POSES_MIN
    }
    for probe in raws.keys() - found.keys():
        if len(raws[probe]) >= POSES_MIN:
            found[probe] = _of_samples(probe, raws[probe])
    lost = sorted(undated - set(found))
    if lost:
        raise FileError(
            f"{', '.join(lost)}: the clock is unknown, so there is no common time"
        )
    return found


def _of_samples(probe: str, raws: Rows) -> Track:
    """The track of a probe that sent samples alone."""
    rows = _sorted(raws)
    try:
        return fused.attitudes(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10])
    except ValueError as error:
        raise FileError(f"{probe}: {error}") from error


def _sorted(raws: Rows) -> FloatArray:
    """By time, each time once."""
    rows = np.array(sorted(raws))
    return np.asarray(rows[np.unique(rows[:, 0], return_index=True)[1]])


def _fields_of(item: Logged) -> Mapping[str, Any]:
    with contextlib.suppress(msgspec.DecodeError, UnicodeDecodeError):
        return msgspec.json.decode(item.data, type=dict[str, Any])
    return {}


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


def _track(poses: FloatArray, raws: Rows) -> Track:
    _, first = np.unique(poses[:, 0], return_index=True)
    poses = poses[first]
    tilt, heading = np.radians(poses[:, 5]), np.radians(poses[:, 6])
    # Before a filter has settled it states none.
    tilt = np.where(np.isfinite(tilt), tilt, np.radians(10.0))
    track = tracks.of_poses(poses[:, 0], poses[:, 1:5], tilt, heading)
    if len(raws) < POSES_MIN:
        return track
    rows = _sorted(raws)
    at = tracks.joined(track, rows[:, 0])
    rate_hz = 1.0 / float(np.median(np.diff(rows[:, 0])))
    bias = level.biases(rows[:, 1:4], rows[:, 4:7], rate_hz)
    return Track(
        rows[:, 0],
        at.quat,
        rows[:, 1:4] - bias,
        at.tilt_sigma,
        at.heading_sigma,
        rows[:, 4:7],
    )
