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
from engines import Samples

from imud import decode
from imud.rotation import FloatArray

SAMPLE_RATE_HZ = 200.0


class RunFailed(Exception):
    """The virtual probe did not come to a good end."""


@dataclass(frozen=True, slots=True)
class Capture:
    """What the image read and what it made of it; times are of the motion, seconds."""

    samples: Samples
    sample_times_s: FloatArray
    poses: FloatArray  # world_from_body
    pose_times_s: FloatArray
    lost: int  # samples and messages of which anything is missing
    summary: dict[str, Any]  # as the simulator wrote it


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
    tally = decode.Tally()
    raws, poses = [], []
    for message in decode.decode_file(record, tally):
        if message["type"] == "raw" and message["acc_m_s2"] is not None:
            raws.append(message)
        elif message["type"] == "pose":
            poses.append(message)
    if not raws or not poses:
        raise RunFailed(f"{len(raws)} samples and {len(poses)} poses were sent")
    sample_times = times_s(raws, summary)
    nothing = [np.nan] * 3
    samples = Samples(
        SAMPLE_RATE_HZ,
        gyr=np.array([raw["gyr_rad_s"] for raw in raws]),
        acc=np.array([raw["acc_m_s2"] for raw in raws]),
        mag=np.array([raw["mag_uT"] or nothing for raw in raws]),
    )
    steps = np.rint(np.diff(sample_times) * SAMPLE_RATE_HZ)
    unsent = int((steps - 1).sum())
    accounts: list[Any] = [probe.account.counts() for probe in tally.probes.values()]
    unheard = sum(account["sent"] - account["received"] for account in accounts)
    return Capture(
        samples=samples,
        sample_times_s=sample_times,
        poses=np.array([pose["q"] for pose in poses]),
        pose_times_s=times_s(poses, summary),
        lost=unsent + unheard,
        summary=summary,
    )


def times_s(messages: list[dict[str, Any]], summary: dict[str, Any]) -> FloatArray:
    """When each message's sample was felt, from the start of the motion."""
    device_us = np.array([message["t_device_us"] for message in messages])
    return np.asarray((device_us - summary["motion_start_us"]) * 1e-6)
