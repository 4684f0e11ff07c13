# SPDX-License-Identifier: MIT
"""`imud strokes`: each stroke on a line as it ends, and with --close its path."""

from __future__ import annotations

import contextlib
import json
import math
import queue
import sys
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from imud.client import Client, Delivery
from imud.probes.path import SIGMAS, StrokePath


def _row(place: Sequence[float]) -> str:
    return " ".join(f"{100 * each:8.2f}" for each in place)


def lines_of(probe: str, closing: Mapping[str, Any]) -> list[str]:
    """The path as measured and closed, cm, and how far its end is off."""
    off, sigma, number = closing["off_m"], closing["off_sigma_m"], closing["strokes"]
    verdict = "within" if closing["is_explained"] else "more than"
    places = zip(closing["path_m"], closing["closed_m"], strict=True)
    return [
        f"{probe}: {number} strokes end {100 * math.hypot(*off):.2f} cm from their "
        "origin:",
        f"  {_row(off)}  cm east, north, up; {verdict} the range of their errors:",
        f"  {_row([SIGMAS * each for each in sigma])}  (95 %)",
        f"{'stroke':>6}  {'measured (cm)':<26}  closed (cm)",
        *(
            f"{at:>6}  {_row(measured)}  {_row(closed)}"
            for at, (measured, closed) in enumerate(places, 1)
        ),
    ]


CLOSING = ("stroke", "pose", "path")

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
        why = ": ".join(filter(None, (stroke["end"], stroke.get("advice"))))
        return f"{head}  {'unknown':>8}  {'':<26} {'':<16} {why}"
    length = f"{100 * math.hypot(*way):5.2f} cm"
    axes = " ".join(f"{100 * each:8.2f}" for each in way)
    errors = f"{100 * sigma[0]:.2f} {100 * sigma[1]:.2f} {100 * sigma[2]:.2f}"
    return f"{head}  {length:>8}  {axes:<26} {errors:<16} {stroke['end']}"


def listen(
    client: Client,
    probe: str | None,
    seconds: float | None,
    *,
    as_json: bool,
    closes: bool,
) -> int:
    """Prints strokes as they end, for some seconds or until Ctrl-C. `closes`: prints
    the path of each probe as one that has returned to its origin, then and whenever
    it is closed by its button or from the page.
    """
    arrived: queue.SimpleQueue[Delivery] = queue.SimpleQueue()
    undeclare = [
        client.listen(kind, probe, arrived.put)
        for kind in (CLOSING if closes else ("stroke",))
    ]
    # By id, which a probe has under every name.
    paths: defaultdict[str, StrokePath] = defaultdict(StrokePath)
    names: dict[str, str] = {}
    until_s = time.monotonic() + seconds if seconds is not None else math.inf
    if not as_json:
        show(HEAD)
    with contextlib.suppress(KeyboardInterrupt):
        while (left_s := until_s - time.monotonic()) > 0:
            with contextlib.suppress(queue.Empty):
                delivery = arrived.get(timeout=min(left_s, 1.0))
                record = json.loads(delivery.payload)
                own = delivery.probe_id or delivery.probe
                names[own] = delivery.probe
                if record["type"] == "pose":
                    paths[own].add_pose(record)
                    continue
                if record["type"] == "path":
                    show_closing(record["probe"], record, as_json=as_json)
                    continue
                paths[own].add_stroke(record)
                if record["end"] != "running":
                    show(delivery.payload.decode() if as_json else line_of(record))
    for end in undeclare:
        end()
    if closes:
        named = {names[own]: path for own, path in paths.items()}
        show_closed(named, as_json=as_json)
    return 0


def show(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def show_closed(paths: Mapping[str, StrokePath], *, as_json: bool) -> None:
    """Each probe's path since its origin, closed."""
    known = {name: path.closing() for name, path in paths.items()}
    for name, closing in known.items():
        if closing is not None:
            show_closing(name, {"probe": name, **closing}, as_json=as_json)
    if not any(known.values()):
        sys.stderr.write(
            "no path to close: its origin is unknown, or its last stroke has no "
            "length; `imud tare` sets an origin\n"
        )


def show_closing(name: str, closing: Mapping[str, Any], *, as_json: bool) -> None:
    show(json.dumps(closing) if as_json else "\n".join(lines_of(name, closing)))
