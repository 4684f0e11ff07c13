# SPDX-License-Identifier: MIT
"""`imud strokes`: each stroke on a line as it ends."""

from __future__ import annotations

import contextlib
import json
import math
import queue
import sys
import time
from collections.abc import Mapping
from typing import Any

from imud.client import Client

HEAD = (
    f"{'probe':<16} {'stroke':>6} {'time':>6}  {'length':>8}"
    f"  {'east, north, up (cm)':<26} {'± (cm)':<16} end"
)


def line_of(stroke: Mapping[str, Any]) -> str:
    """A stroke as published: its length and each axis with its 1-sigma error."""
    way, sigma = stroke["displacement_m"], stroke["displacement_sigma_m"]
    head = (
        f"{stroke['probe']:<16} {stroke['stroke']:>6} {stroke['windows'] / 10:4.1f} s"
    )
    if way is None or sigma is None:
        return f"{head}  {'unknown':>8}  {'':<26} {'':<16} {stroke['end']}"
    length = f"{100 * math.hypot(*way):5.2f} cm"
    axes = " ".join(f"{100 * each:8.2f}" for each in way)
    errors = f"{100 * sigma[0]:.2f} {100 * sigma[1]:.2f} {100 * sigma[2]:.2f}"
    return f"{head}  {length:>8}  {axes:<26} {errors:<16} {stroke['end']}"


def listen(
    client: Client, probe: str | None, seconds: float | None, *, as_json: bool
) -> int:
    """Prints strokes as they end, for some seconds or until Ctrl-C."""
    arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    undeclare = client.subscribe("stroke", probe, lambda _, said: arrived.put(said))
    until_s = time.monotonic() + seconds if seconds is not None else math.inf
    if not as_json:
        sys.stdout.write(f"{HEAD}\n")
        sys.stdout.flush()
    with contextlib.suppress(KeyboardInterrupt):
        while (left_s := until_s - time.monotonic()) > 0:
            with contextlib.suppress(queue.Empty):
                payload = arrived.get(timeout=min(left_s, 1.0))
                stroke = json.loads(payload)
                if stroke["end"] != "running":
                    said = payload.decode() if as_json else line_of(stroke)
                    sys.stdout.write(f"{said}\n")
                    sys.stdout.flush()
    undeclare()
    return 0
