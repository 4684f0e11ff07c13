# SPDX-License-Identifier: MIT
"""Runs a board's image on a motion and reads the messages that it sent."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import wire
from benchmarks.common.feed import Feed
from benchmarks.common.images import RunFailed, flashed
from imud.probes.session import OtherSchema, Probe, Received, Session
from imud.rotation import FloatArray
from imud.stages.twin import Twin
from imud.stages.twin_outcomes import TwinState
from imud.virtual import boards, motion, sim
from imud.virtual.memory import memory_with


@dataclass(frozen=True, slots=True)
class Capture:
    """The image's samples and poses; times are seconds from the start of the motion."""

    feed: Feed
    pose_contents: Sequence[bytes]  # as sent, one for each of feed.pose_after
    poses: FloatArray  # world_from_body
    lost: int  # samples and messages that are missing, whole or in part
    log_dropped: int  # messages that its card, if any, has not got
    summary: dict[str, Any]  # as the emulator wrote it
    received: Sequence[Received]  # every message, in order

    @property
    def pose_times_s(self) -> FloatArray:
        return self.feed.pose_times_s

    def twin(self) -> Twin:
        """What compared its poses and strokes with those that this machine's C computes
        from its samples. RunFailed: it could not follow to the end.
        """
        twin = Twin()
        for event in self.received:
            twin.on_message(event.message, event.content, event.params)
        if twin.state not in (TwinState.FOLLOWING, TwinState.DIFFERS):
            raise RunFailed(f"the twin is {twin.state.value} at the end")
        return twin


def run(
    board_name: str,
    path: Path,
    options: Sequence[str] = (),
    *,
    image: Path | None = None,
    sample_rate_hz: int | None = None,
    pose_rate_hz: int | None = None,
    params: bytes = b"",
) -> Capture:
    """Run a virtual board on a motion, streaming pose and raw.

    The image is asked for these rates; by default it sends every sample, and poses at
    its initial rate. `params`: records in force from its start. Raises RunFailed.
    """
    board = boards.BOARDS[board_name]
    if sample_rate_hz is not None:
        board = replace(board, sample_rate_hz=sample_rate_hz)
    simulator, image = flashed(board_name, image)
    with tempfile.TemporaryDirectory() as folder:
        felt, record, summary = (
            Path(folder) / name for name in ("motion", "uart.bin", "summary.json")
        )
        with felt.open("wb") as file:
            motion.write_stream(file, [motion.load(path)])
        words: list[str | Path] = [simulator, "--image", image, "--motion", felt]
        words += ["--record", record, "--summary", summary, "--fast"]
        words += ["--press", ":".join(map(str, sim.PRESS_US))]
        if params:
            memory = Path(folder) / "memory"
            memory_with(image, simulator, params, memory)
            words += ["--eeprom", memory]
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
            lines = done.stderr.strip().splitlines() or ["it printed nothing"]
            raise RunFailed(f"{path.name}: exit code {done.returncode}: {lines[-1]}")
        found = read(record, json.loads(summary.read_text()))
        return replace(found, feed=replace(found.feed, params=params))


def read(record: Path, summary: dict[str, Any]) -> Capture:
    """Read a capture of UART bytes."""
    probes: dict[str, Probe] = {}
    session = Session(lambda probe_id: probes.setdefault(probe_id, Probe(probe_id)))
    events = [*session.receive(record.read_bytes(), None), *session.close()]
    if any(isinstance(event, OtherSchema) for event in events):
        raise RunFailed("the image has another schema; run `make firmware`")
    heard: dict[str, list[Received]] = {}
    for event in events:
        if isinstance(event, Received):
            heard.setdefault(event.message.name, []).append(event)
    # Hellos from before the sensor runs do not have its scale factors yet.
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
        received=[event for event in events if isinstance(event, Received)],
    )


def unlogged(equipment: Sequence[Received]) -> int:
    """Messages that the card was too slow for, from the board's last report."""
    count = equipment[-1].message.fields["messages_unlogged"] if equipment else 0
    assert isinstance(count, int)
    return count


def orientations(contents: Sequence[bytes]) -> FloatArray:
    """The quaternions of pose messages."""
    return np.asarray(wire.to_rows("pose", contents)["q"] * 2.0**-30)
