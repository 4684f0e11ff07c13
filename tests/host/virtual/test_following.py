# SPDX-License-Identifier: MIT
"""The hand that does what the page asks."""

from __future__ import annotations

import itertools
import json
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.server import ServerConnection, serve

from imud import rotation
from imud.calibration.path import UP
from imud.rotation import FloatArray
from imud.virtual import following
from imud.virtual.following import (
    Correct,
    Eyes,
    FollowingHand,
    Lay,
    TurnAbout,
    order_of,
)
from imud.virtual.hand import HandMove
from streaming import until

RATE_HZ = 100.0
SIDE = (0.0, 1.0, 0.0)


def guide(**fields: Any) -> dict[str, Any]:
    state = {"type": "calibration", "probe": "stylus", "phase": "running"}
    return state | {"kind": "all", "step": "poses", "poses": 3, "wanted": None} | fields


def found() -> Eyes:
    eyes = Eyes("/dev/null")
    eyes.read({"type": "status", "probe": "other", "port": "/dev/zero"})
    eyes.read({"type": "status", "probe": "stylus", "port": "/dev/null"})
    return eyes


@pytest.mark.parametrize(
    ("state", "order"),
    [
        (guide(wanted=SIDE), Lay(SIDE, 3)),
        (guide(step="half_turn", wanted=SIDE), Lay(None, 3)),
        (guide(), None),
        (guide(kind="mag"), TurnAbout()),
        (guide(kind="verify", seconds=1.0), Lay((0.0, 0.0, 1.0), 0)),
        (guide(kind="verify", seconds=5.0), Lay((0.0, 0.0, -1.0), 1)),
        (guide(phase="done", wanted=SIDE), None),
        (guide(phase="none", wanted=SIDE), None),
    ],
)
def test_what_a_guide_asks_for(state: dict[str, Any], order: object) -> None:
    assert order_of(state) == order


def test_it_looks_at_its_own_probe_alone() -> None:
    eyes = found()
    assert eyes.probe == "stylus"
    eyes.read(guide(wanted=SIDE) | {"probe": "other"})
    assert eyes.order() is None
    eyes.read(guide(wanted=SIDE))
    assert eyes.order() == Lay(SIDE, 3)


def test_an_aim_of_which_nothing_more_comes_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(following, "FORGOTTEN_S", 0.05)
    eyes = found()
    aim = {"type": "aim", "probe": "stylus", "target_q": (0.0, 0.0, 0.0, 1.0)}
    eyes.read(aim)
    assert eyes.order() is None  # no pose yet, from which to go
    eyes.read({"type": "pose", "probe": "stylus", "q": (1.0, 0.0, 0.0, 0.0)})
    eyes.read(aim)
    order = eyes.order()
    assert isinstance(order, Correct)
    assert np.linalg.norm(order.turn) == pytest.approx(np.pi)
    time.sleep(0.1)  # longer than FORGOTTEN_S
    assert eyes.order() is None


def up_of(move: HandMove) -> FloatArray:
    """The direction of the body that is up at the end."""
    return rotation.rotate(rotation.inverse(move.end.quat), UP)


def test_it_lays_the_probe_as_asked_once_and_then_waits() -> None:
    eyes = found()
    moves = FollowingHand(np.random.default_rng(1), RATE_HZ, eyes).moves()
    first, second = itertools.islice(moves, 2)
    assert first.is_rest
    assert second.is_rest
    eyes.read(guide(wanted=SIDE))
    lay, *rests = itertools.islice(moves, 4)
    assert not lay.is_rest
    assert up_of(lay) @ np.array(SIDE) > np.cos(np.radians(30.0))
    assert all(each.is_rest and each.start is lay.end for each in rests)
    eyes.read(guide(step="half_turn"))
    half = next(moves)
    change = rotation.multiply(rotation.inverse(half.start.quat), half.end.quat)
    assert np.linalg.norm(rotation.to_rotation_vector(change)) > np.radians(160.0)


@pytest.mark.parametrize("is_full", [False, True])
def test_it_corrects_by_what_is_shown_until_it_is_there(is_full: bool) -> None:
    """From a full origin attitudes are multiplied from the right."""
    eyes = found()
    if is_full:
        tared = {"type": "event", "event": "tared", "detail": 0}
        eyes.read(tared | {"probe": "stylus"})
    moves = FollowingHand(np.random.default_rng(1), RATE_HZ, eyes).moves()
    now = next(moves).end.quat
    off = rotation.from_rotation_vector(np.array([0.1, -0.2, 0.5]))
    target = rotation.multiply(now, off)
    origin = now if is_full else np.array([1.0, 0.0, 0.0, 0.0])

    def shown(q: FloatArray) -> tuple[float, ...]:
        return tuple(rotation.multiply(q, rotation.inverse(origin)))

    for _ in range(6):
        eyes.read({"type": "pose", "probe": "stylus", "q": shown(now)})
        eyes.read({"type": "aim", "probe": "stylus", "target_q": shown(target)})
        now = next(moves).end.quat
        look = next(moves)
        assert look.start.held
    left = rotation.multiply(rotation.inverse(now), target)
    assert np.linalg.norm(rotation.to_rotation_vector(left)) < 0.03


def test_it_reads_the_stream_of_a_page_and_asks_for_its_aims(tmp_path: Path) -> None:
    port = tmp_path / "port"
    port.touch()
    asked: list[dict[str, Any]] = []

    def talk(connection: ServerConnection) -> None:
        status = {"type": "status", "probe": "stylus", "port": str(port)}
        connection.send("\n".join(map(json.dumps, ({"type": "head"}, status))))
        asked.append(json.loads(connection.recv()))
        connection.send(json.dumps(guide(wanted=SIDE)))
        connection.recv()

    with serve(talk, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        eyes = Eyes(str(port))
        page = f"http://127.0.0.1:{server.socket.getsockname()[1]}"
        threading.Thread(target=following.watch, args=(eyes, page), daemon=True).start()
        until(lambda: eyes.order() == Lay(SIDE, 3))
        server.shutdown()
    assert asked[0]["do"] == "watch"
    assert asked[0]["every"] == [["stylus", "aim"]]
