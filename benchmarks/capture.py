# SPDX-License-Identifier: MIT
"""Runs the image that is flashed on a motion, and reads what it said."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import wire
from feed import Feed

from imud.rotation import FloatArray
from imud.session import OtherSchema, Probe, Received, Session

SAMPLE_RATE_HZ = 200.0


class RunFailed(Exception):
    """The virtual probe did not come to a good end."""


@dataclass(frozen=True, slots=True)
class Capture:
    """What the image read and what it made of it; times are of the motion, seconds."""

    feed: Feed
    pose_contents: Sequence[bytes]  # as sent, one for each that the feed counts
    poses: FloatArray  # world_from_body
    lost: int  # samples and messages of which anything is missing
    summary: dict[str, Any]  # as the simulator wrote it

    @property
    def pose_times_s(self) -> FloatArray:
        return self.feed.pose_times_s


def run_nano(motion: Path, options: Sequence[str] = ()) -> Capture:
    """Streams pose and raw of a virtual Nano that feels this motion."""
    with tempfile.TemporaryDirectory() as folder:
        record, summary = Path(folder) / "uart.bin", Path(folder) / "summary.json"
        words = ["sim", "nano", "--motion", str(motion), "--record", str(record)]
        words += ["--summary", str(summary), "--fast", "--stream", "--raw", *options]
        run = subprocess.run(
            [sys.executable, "-m", "imud", *words],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        if run.returncode != 0:
            said = run.stderr.strip().splitlines() or ["it said nothing"]
            raise RunFailed(f"{motion.name}: exit code {run.returncode}: {said[-1]}")
        return read(record, json.loads(summary.read_text()))


def read(record: Path, summary: dict[str, Any]) -> Capture:
    """Reads a capture of UART bytes."""
    probes: dict[str, Probe] = {}
    session = Session(lambda probe_id: probes.setdefault(probe_id, Probe(probe_id)))
    events = [*session.receive(record.read_bytes(), None), *session.close()]
    if any(isinstance(event, OtherSchema) for event in events):
        raise RunFailed("the image is of another schema; run `make firmware`")
    heard: dict[str, list[Received]] = {}
    for event in events:
        if isinstance(event, Received):
            heard.setdefault(event.message.name, []).append(event)
    # Until its sensor runs a probe doesn't know what a count is worth.
    hellos = [
        event.content
        for event in heard.get("hello", [])
        if event.message.fields["sensor"] != "none"
    ]
    raws, poses = heard.get("raw", []), heard.get("pose", [])
    if not (hellos and raws and poses):
        raise RunFailed(f"{len(raws)} samples and {len(poses)} poses were sent")
    sample_us, pose_us = (
        np.array([event.t_device_us for event in each]) for each in (raws, poses)
    )
    after = np.searchsorted(sample_us, pose_us)
    if not np.array_equal(sample_us[after.clip(max=len(raws) - 1)], pose_us):
        raise RunFailed("a pose without its sample")
    unsent = int((np.rint(np.diff(sample_us) * 1e-6 * SAMPLE_RATE_HZ) - 1).sum())
    accounts: list[Any] = [probe.account.counts() for probe in probes.values()]
    unheard = sum(account["sent"] - account["received"] for account in accounts)
    feed = Feed(
        hello=hellos[0],
        raws=[event.content for event in raws],
        pose_after=after.tolist(),
        pose_sequence=[event.message.sequence for event in poses],
        start_us=summary["motion_start_us"],
    )
    contents = [event.content for event in poses]
    return Capture(
        feed=feed,
        pose_contents=contents,
        poses=orientations(contents),
        lost=unsent + unheard,
        summary=summary,
    )


def orientations(contents: Sequence[bytes]) -> FloatArray:
    """The quaternions of pose messages."""
    return np.asarray(wire.to_rows("pose", contents)["q"] * 2.0**-30)
