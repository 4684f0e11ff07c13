# SPDX-License-Identifier: MIT
"""Runs an image that is flashed on a motion, and reads what it said."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import wire
from feed import Feed

from imud.probes.session import OtherSchema, Probe, Received, Session
from imud.rotation import FloatArray
from imud.virtual import motion, sim


class RunFailed(Exception):
    """The virtual probe did not come to a good end."""


@dataclass(frozen=True, slots=True)
class Capture:
    """What the image read and what it made of it; times are of the motion, seconds."""

    feed: Feed
    pose_contents: Sequence[bytes]  # as sent, one for each that the feed counts
    poses: FloatArray  # world_from_body
    lost: int  # samples and messages of which anything is missing
    log_dropped: int  # messages that did not get to its card, where it has one
    summary: dict[str, Any]  # as the simulator wrote it

    @property
    def pose_times_s(self) -> FloatArray:
        return self.feed.pose_times_s


def run(
    board_name: str,
    path: Path,
    options: Sequence[str] = (),
    *,
    image: Path | None = None,
    sample_rate_hz: int | None = None,
    pose_rate_hz: int | None = None,
) -> Capture:
    """Streams pose and raw of a virtual board that feels this motion.

    Rates are what is asked of the image: every sample, and the poses that it starts
    with, unless told otherwise.
    """
    board = sim.BOARDS[board_name]
    if sample_rate_hz is not None:
        board = replace(board, sample_rate_hz=sample_rate_hz)
    simulator = sim.find(None, board.simulator_variable, board.simulator)
    image = sim.find(image, board.image_variable, board.image)
    with tempfile.TemporaryDirectory() as folder:
        felt, record, summary = (
            Path(folder) / name for name in ("motion", "uart.bin", "summary.json")
        )
        with felt.open("wb") as file:
            motion.write_stream(file, [motion.load(path)])
        words: list[str | Path] = [simulator, "--image", image, "--motion", felt]
        words += ["--record", record, "--summary", summary, "--fast"]
        words += ["--press", ":".join(map(str, sim.PRESS_US))]
        for at_us, frame in sim.commands_us(
            board, wants_raw=True, rate_hz=pose_rate_hz
        ):
            words += ["--send", f"{at_us}:{frame.hex()}"]
        done = subprocess.run(
            [*words, *options],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            said = done.stderr.strip().splitlines() or ["it said nothing"]
            raise RunFailed(f"{path.name}: exit code {done.returncode}: {said[-1]}")
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
        np.array([event.stamp.t_device_us for event in each]) for each in (raws, poses)
    )
    after = np.searchsorted(sample_us, pose_us)
    if not np.array_equal(sample_us[after.clip(max=len(raws) - 1)], pose_us):
        raise RunFailed("a pose without its sample")
    accounts: list[Any] = [probe.account.counts() for probe in probes.values()]
    unheard = sum(account["sent"] - account["received"] for account in accounts)
    feed = Feed(
        hello=hellos[0],
        raws=[event.content for event in raws],
        pose_after=after.tolist(),
        pose_sequence=[event.message.sequence for event in poses],
        start_us=summary["motion_start_us"],
    )
    steps_s = np.diff(sample_us) * 1e-6
    unsent = int((np.rint(steps_s * feed.samples.rate_hz) - 1).sum())
    contents = [event.content for event in poses]
    return Capture(
        feed=feed,
        pose_contents=contents,
        poses=orientations(contents),
        lost=unsent + unheard,
        log_dropped=unlogged(heard.get("equipment", [])),
        summary=summary,
    )


def unlogged(equipment: Sequence[Received]) -> int:
    """Messages that the card had no time for, as the board has last said it."""
    count = equipment[-1].message.fields["messages_unlogged"] if equipment else 0
    assert isinstance(count, int)
    return count


def orientations(contents: Sequence[bytes]) -> FloatArray:
    """The quaternions of pose messages."""
    return np.asarray(wire.to_rows("pose", contents)["q"] * 2.0**-30)
