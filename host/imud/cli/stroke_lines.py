# SPDX-License-Identifier: MIT
"""`imud strokes`: each stroke on a line as it ends, and with --close its path, as the
daemon closes it.
"""

from __future__ import annotations

import contextlib
import json
import math
import queue
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from imud.client import Client, Delivery
from imud.errors import ImudError
from imud.probes.path import SIGMAS


def _row(place: Sequence[float]) -> str:
    return " ".join(f"{100 * each:8.2f}" for each in place)


def _errors(sigma: Sequence[float]) -> str:
    return " ".join(f"{100 * each:.2f}" for each in sigma)


def lines_of(probe: str, closing: Mapping[str, Any]) -> list[str]:
    """The path as measured and closed, cm, and how far its end is off."""
    off, sigma, number = closing["off_m"], closing["off_sigma_m"], closing["strokes"]
    verdict = "within" if closing["is_explained"] else "more than"
    if closing["closed_m"] is None:
        head = "not closed: it did not return, or a stroke is wrong"
        closed = [""] * number
    else:
        head = f"{'closed (cm)':<26}  ± (cm)"
        pairs = zip(closing["closed_m"], closing["closed_sigma_m"], strict=True)
        closed = [f"  {_row(place)}  {_errors(each)}" for place, each in pairs]
    rows = zip(closing["path_m"], closed, strict=True)
    return [
        f"{probe}: {number} strokes end {100 * math.hypot(*off):.2f} cm from their "
        "origin:",
        f"  {_row(off)}  cm east, north, up; {verdict} the range of their errors:",
        f"  {_row([SIGMAS * each for each in sigma])}  (95 %)",
        f"{'stroke':>6}  {'measured (cm)':<26}  {head}",
        *(
            f"{at:>6}  {_row(measured)}{more}"
            for at, (measured, more) in enumerate(rows, 1)
        ),
    ]


CLOSING = ("stroke", "path")

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
    return f"{head}  {length:>8}  {axes:<26} {_errors(sigma):<16} {stroke['end']}"


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
    it is closed by its button or from the page. Returns 1 if one was refused.
    """
    arrived: queue.SimpleQueue[Delivery] = queue.SimpleQueue()
    undeclare = [
        client.listen(kind, probe, arrived.put)
        for kind in (CLOSING if closes else ("stroke",))
    ]
    names: dict[str, str] = {}  # by id, which a probe has under every name
    until_s = time.monotonic() + seconds if seconds is not None else math.inf
    if not as_json:
        show(HEAD)
    with contextlib.suppress(KeyboardInterrupt):
        while (left_s := until_s - time.monotonic()) > 0:
            with contextlib.suppress(queue.Empty):
                delivery = arrived.get(timeout=min(left_s, 1.0))
                record = json.loads(delivery.payload)
                names[delivery.probe_id or delivery.probe] = delivery.probe
                if record["type"] == "path":
                    show_closing(record["probe"], record, as_json=as_json)
                elif record["end"] != "running":
                    show(delivery.payload.decode() if as_json else line_of(record))
    for end in undeclare:
        end()
    if closes and not names:
        sys.stderr.write("no path to close: there was no stroke\n")
    code = 0
    for own, name in names.items() if closes else ():
        try:
            closing = client.command(own, "close")["value"]
        except ImudError as error:
            sys.stderr.write(f"{error}\n")
            code = 1
        else:
            show_closing(name, {"probe": name, **closing}, as_json=as_json)
    return code


def show(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def show_closing(name: str, closing: Mapping[str, Any], *, as_json: bool) -> None:
    show(json.dumps(closing) if as_json else "\n".join(lines_of(name, closing)))
