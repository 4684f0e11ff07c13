# SPDX-License-Identifier: MIT
"""A hand that does what the page asks: it reads the same messages as a browser, lays
the probe as the guide says, turns it when it should be waved, and aims by the errors
that are shown. It has no script of its own, so a person may do any step.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from imud import rotation
from imud.calibration.algebra import units
from imud.calibration.path import UP
from imud.probes.references import ORIGIN_ALL
from imud.rotation import FloatArray
from imud.virtual.calibrating import IRON, CalibratingHand, Manners, beside, felt_of
from imud.virtual.hand import HandMove, Stance
from imud.virtual.motion import Motion
from imud.virtual.motions.module import Module
from imud.virtual.stroking import SWAYS

FOLLOW, FOLLOW_IRON = "follow", "follow-iron"
NAMES = (FOLLOW, FOLLOW_IRON)

REST_S = 0.2  # so soon it looks again at what is asked
AGAIN_S = 8.0  # and lays the probe down again, if the guide still asks for the same
FORGOTTEN_S = 2.0  # an aim of which nothing more comes is over
AIM_S, LOOK_S = 0.7, 1.2  # the time for a correction, and to see its effect
AIM_GAIN = 0.85  # of the error that is shown: no hand hits at once
AIM_OFF_RAD = 0.005  # rms of an axis, that a correction misses by
RETRY_S = 1.0

Quat = tuple[float, float, float, float]


@dataclass(frozen=True)
class Lay:
    """With this direction of the body up; None: half a turn where it lies."""

    up: tuple[float, float, float] | None
    count: int  # of the poses before: the same direction may be asked for twice


@dataclass(frozen=True)
class TurnAbout:
    """Turn it about in the air."""


@dataclass(frozen=True)
class Correct:
    """Turn it by so much, as seen from the body; or from the world, where it is aimed
    from a full origin: that multiplies attitudes from the right.
    """

    turn: tuple[float, float, float]  # a rotation vector, rad
    is_of_world: bool = False


Order = Lay | TurnAbout | Correct


class Eyes:
    """The page's last request for the probe on a port. Any thread may read it."""

    def __init__(self, port: str) -> None:
        self.probe = ""  # its name; empty: the daemon has not found it yet
        self._port = port
        self._lock = threading.Lock()
        self._order: Order | None = None
        self._q: Quat | None = None
        self._has_full_origin = False
        self._aim_s = -FORGOTTEN_S

    def order(self) -> Order | None:
        """The next action."""
        with self._lock:
            is_late = time.monotonic() - self._aim_s > FORGOTTEN_S
            if isinstance(self._order, Correct) and is_late:
                self._order = None
            return self._order

    def read(self, line: dict[str, Any]) -> None:
        """A line of the page's messages."""
        with self._lock:
            if line.get("type") == "status" and self._is_mine(line.get("port")):
                self.probe = line["probe"]
            elif line.get("probe") == self.probe:
                self._read(line)

    def _is_mine(self, port: str | None) -> bool:
        mine = os.path.realpath(self._port)
        return port is not None and os.path.realpath(port) == mine

    def _read(self, line: dict[str, Any]) -> None:
        if line["type"] == "pose":
            self._q = line["q"]
        elif line["type"] == "event" and line["event"] == "tared":
            self._has_full_origin = line["detail"] == ORIGIN_ALL
        elif line["type"] == "aim" and self._q is not None:
            self._aim_s = time.monotonic()
            there = np.array(line["target_q"])
            back = rotation.inverse(np.array(self._q))
            is_of_world = self._has_full_origin
            pair = (there, back) if is_of_world else (back, there)
            x, y, z = rotation.to_rotation_vector(rotation.multiply(*pair)).tolist()
            self._order = Correct((x, y, z), is_of_world)
        elif line["type"] == "calibration":
            self._order = order_of(line)


def order_of(line: dict[str, Any]) -> Order | None:
    """The action for a state of a guided calibration."""
    if line["phase"] != "running":
        return None
    if line["kind"] == "mag":
        return TurnAbout()
    if line["kind"] == "verify":
        is_first = line["seconds"] < 4.0
        return Lay((0.0, 0.0, 1.0 if is_first else -1.0), 0 if is_first else 1)
    if line.get("step") == "half_turn":
        return Lay(None, line["poses"])
    wanted = line.get("wanted")
    return Lay(tuple(wanted), line["poses"]) if wanted else None


def watch(eyes: Eyes, page: str) -> None:
    """Reads a page's messages for ever, in a thread of its own."""
    address = page.replace("http", "ws", 1).rstrip("/") + "/stream"
    while True:
        with contextlib.suppress(OSError, WebSocketException):
            _watch(eyes, address)
        time.sleep(RETRY_S)


def _watch(eyes: Eyes, address: str) -> None:
    watched = ""
    with connect(address, compression=None, max_size=None) as socket:
        for message in socket:
            for text in str(message).split("\n"):
                eyes.read(msgspec.json.decode(text))
            if eyes.probe != watched:
                watched = eyes.probe
                every = [[watched, "aim"]]
                words = {"do": "watch", "every": every, "rate_hz": 20, "probe": watched}
                socket.send(msgspec.json.encode(words), text=True)


class FollowingHand(CalibratingHand):
    """Does what the page asks, and holds still in between."""

    def __init__(self, random: np.random.Generator, rate_hz: float, eyes: Eyes) -> None:
        super().__init__(random, rate_hz, (), Manners())
        self._eyes = eyes

    def moves(self) -> Iterator[HandMove]:
        now = self._stance(UP, None)
        yield self._rest(now, 2.0)
        done: Order | None = None
        done_s = 0.0
        while True:
            order = self._eyes.order()
            is_again = time.monotonic() - done_s > AGAIN_S
            if isinstance(order, Lay) and (order != done or is_again):
                up = None if order.up is None else np.array(order.up)
                then = self._stance(up, now)
                yield self._move(now, then, is_lifted=up is not None)
                now, done, done_s = then, order, time.monotonic()
            elif isinstance(order, TurnAbout):
                then = self._turned(now, units(self._random.standard_normal(3)) * 2.0)
                yield self._move(now, then, is_lifted=False)
                now, done = then, None
            elif isinstance(order, Correct):
                missed = self._random.normal(0.0, AIM_OFF_RAD, 3)
                turn = AIM_GAIN * np.array(order.turn) + missed
                then = self._turned(now, turn, is_of_world=order.is_of_world)
                yield HandMove(now, then, round(AIM_S * self._rate_hz))
                yield self._rest(then, LOOK_S)
                now, done = then, None
            elif order is None and now.held:
                # Without a request it is put down.
                then = self._stance(UP, now)
                yield self._move(now, then, is_lifted=False)
                now = then
            else:
                yield self._rest(now, REST_S)

    def _rest(self, stance: Stance, seconds: float) -> HandMove:
        records = round(seconds * self._rate_hz)
        return HandMove(stance, stance, records, is_rest=not stance.held)

    def _turned(
        self, before: Stance, turn: FloatArray, *, is_of_world: bool = False
    ) -> Stance:
        """In the hand, turned by a rotation vector of the body, or of the world."""
        by = rotation.from_rotation_vector(turn)
        pair = (by, before.quat) if is_of_world else (before.quat, by)
        quat = rotation.multiply(*pair)
        tip = before.tip if before.held else before.tip + UP * self._manners.lift_m
        return Stance(tip, quat, held=1.0, free=1.0)


def pieces(
    name: str,
    module: Module,
    seed: int,
    rate_hz: float,
    page: str = "",
    port: Path | None = None,
) -> Iterator[Motion]:
    """The endless motion of such a hand as a module measures it; `name`: follow, or
    follow-iron beside a loudspeaker. `page`: the address of the one that it reads;
    empty: it holds still. `port`: that of its probe.
    """
    eyes = Eyes(str(port or ""))
    if page:
        threading.Thread(target=watch, args=(eyes, page), daemon=True).start()
    return felt_of(
        *(module, seed, rate_hz, beside((IRON,) if name == FOLLOW_IRON else ())),
        lambda random, hz: FollowingHand(random, hz, eyes),
        SWAYS["paper"],
    )
