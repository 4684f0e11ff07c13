# SPDX-License-Identifier: MIT
"""A virtual leg that walks, for pictures of the view Limb: what `imud body` makes of
the samples of its three probes, published at their pace again and again.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator

import msgspec
import numpy as np

from imud.body import chain, fused
from imud.body.live import LiveBody
from imud.body.state import BodyState
from imud.client import Client
from imud.net.access import BODIES, BODY_STATE
from imud.virtual import leg
from imud.virtual.leg_probes import RATE_HZ

PERIOD_S = 0.04  # between two states
SKIP = 5  # of the leg's records: samples 200 times a second
MANNER = leg.Manner(walk_s=16.0, squats=3, raises=3)

_encode = msgspec.json.Encoder().encode


def states(seed: int = 1) -> list[BodyState]:
    """The states of the leg, from where it is aligned on."""
    made = leg.made(seed, MANNER)
    body = LiveBody(chain.read(leg.CHAIN, "leg"))
    tracks = {}
    for name, motion in made.motions.items():
        times_s = np.arange(0, len(motion.gyr), SKIP) / RATE_HZ
        rows = (motion.gyr[::SKIP], motion.acc[::SKIP], motion.mag[::SKIP])
        tracks[name] = fused.attitudes(times_s, *rows)
    found = []
    shown_s = 0.0
    for row, time_s in enumerate(times_s.tolist()):
        for name, track in tracks.items():
            history = body.histories[name]
            sigmas = float(track.tilt_sigma[row]), float(track.heading_sigma[row])
            w, x, y, z = track.quat[row].tolist()
            history.add_pose(time_s, (w, x, y, z), sigmas)
            motion = made.motions[name]
            (gx, gy, gz), (ax, ay, az) = (
                each[row * SKIP].tolist() for each in (motion.gyr, motion.acc)
            )
            history.add_raw(time_s, (gx, gy, gz), (ax, ay, az))
            history.bound_us = 700
        if time_s >= shown_s:
            shown_s += PERIOD_S
            found.append(body.state(time_s))
    return [state for state in found if state.stage == "running"]


@contextlib.contextmanager
def walking(endpoint: str) -> Iterator[None]:
    """Publishes the states on the daemon's network meanwhile."""
    made = states()
    is_over = threading.Event()
    with Client(endpoint) as client:

        def publish() -> None:
            number = 0
            while not is_over.wait(PERIOD_S):
                state = made[number % len(made)]
                number += 1
                published = msgspec.structs.replace(
                    state, number=number, t_ns=time.time_ns() - state.age_us * 1000
                )
                key = f"imud/{BODIES}/{state.body}/{BODY_STATE}"
                client.session.put(key, _encode(published))

        thread = threading.Thread(target=publish)
        thread.start()
        try:
            yield
        finally:
            is_over.set()
            thread.join()
