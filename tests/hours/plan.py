# SPDX-License-Identifier: MIT
"""Scheduled events of a probe in hours: faults of its sensor and its bus, commands, the
button, noise on the wire. All of it is drawn from a seed.

Nothing here resets the board, so the judge of the run expects one boot.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from fakes.records import calibrated_records
from system.params_orders import APPLY_US, WORD_US, apply, words
from system.virtual import Board, send

S_US = 1_000_000
BEGIN_US = 10 * S_US  # the sensor is set up and calibrated at rest
END_US = 10 * S_US  # nothing happens in the last ten seconds

# The button: down for longer than it is debounced, and pressed again after a while.
PRESS_US = 150_000

# Mean time between two of these; params take 40 commands to send.
EVERY_S = 24.0
PARAMS_EVERY_S = 1200.0


@dataclass(slots=True)
class Plan:
    """Options of the emulator, and the faults for its file."""

    options: list[str] = field(default_factory=list)
    faults: list[dict[str, Any]] = field(default_factory=list)
    commands: int = 0

    def press(self, at_us: int) -> None:
        self.options += ["--press", f"{at_us}:{at_us + PRESS_US}"]

    def order(self, at_us: int, name: str, first: int = 0, second: int = 0) -> None:
        """A command. Each has its own token: one that is repeated is not obeyed."""
        self.commands += 1
        token = 1 + self.commands % 60_000
        self.send(at_us, send(name, first, second, token=token))

    def send(self, at_us: int, frame: str) -> None:
        self.options += ["--send", f"{at_us}:{frame}"]


def plan_of(board: Board, seed: int, seconds: float, every_s: float = EVERY_S) -> Plan:
    """One thing after the other, `every_s` seconds apart in the mean."""
    draw = random.Random(seed)  # noqa: S311
    plan = Plan()
    plan.order(320_000, "fields", 3)  # poses and raw messages
    plan.order(340_000, "rate", 1, board.rate_hz)
    plan.press(400_000)
    params_us = BEGIN_US
    at_us = BEGIN_US
    while at_us < seconds * S_US - END_US:
        if at_us >= params_us:
            at_us = _params(plan, draw, at_us)
            params_us = at_us + int(draw.uniform(0.5, 1.5) * PARAMS_EVERY_S * S_US)
        elif draw.random() < 0.5:
            at_us = _fault(plan, board, draw, at_us)
        else:
            at_us = draw.choice(_ORDERS)(plan, draw, at_us)
        at_us += int(draw.uniform(0.25, 1.75) * every_s * S_US)
    return plan


def _fault(plan: Plan, board: Board, draw: random.Random, at_us: int) -> int:
    """A fault of the sensor or of its bus; when it is over, in us."""

    def span(least_ms: int, most_ms: int) -> dict[str, int]:
        # Short ones as often as long ones.
        ratio = (most_ms / least_ms) ** draw.random()
        return {"for_us": int(least_ms * 1000 * ratio)}

    kinds: list[dict[str, Any]] = [
        {"kind": "nack", "byte": draw.choice(board.acknowledged), **span(3, 3000)},
        {"kind": "stuck_sda", "clocks": draw.randint(1, 9)},
        {"kind": "stuck_sda", **span(3, 2000)},
        {"kind": "no_data_ready", **span(3, 2000)},
        {"kind": "frozen", **span(3, 5000)},
        {"kind": board.no_mag, **span(300, 60000)},
        {"kind": "register_flip", **draw.choice(board.kept_registers)},
        {"kind": "sensor_brown_out"},
    ]
    if board.name == "nano":
        kinds.append({"kind": "mag_hung", "clocks": draw.randint(1, 9)})
        kinds.append({"kind": "mag_idle", **span(300, 60000)})
    else:
        kinds += [{"kind": "glitch"}, {"kind": "spurious_berr"}]
    fault = draw.choice(kinds)
    plan.faults.append({"at_us": at_us, **fault})
    return at_us + int(fault.get("for_us", 0))


def _params(plan: Plan, draw: random.Random, at_us: int) -> int:
    """Another calibration, which restarts the filter."""
    records = calibrated_records(draw.randrange(1000))
    orders = words(records)
    for number, order in enumerate(orders):
        plan.order(at_us + number * WORD_US, *order)
    at_us += len(orders) * WORD_US
    for number in range(2):
        plan.order(at_us + number * APPLY_US, *apply(records))
    return at_us + 2 * APPLY_US


def _command(*choices: tuple[str, int, int]) -> Callable[..., int]:
    def order(plan: Plan, draw: random.Random, at_us: int) -> int:
        plan.order(at_us, *draw.choice(choices))
        return at_us

    return order


def _stop_and_start(plan: Plan, draw: random.Random, at_us: int) -> int:
    """By commands or by the button, as the probe's user does. Then a restart, so that
    the twin may follow again: it can't know the samples between.
    """
    again_us = at_us + draw.randint(S_US // 2, 8 * S_US)
    if draw.random() < 0.5:
        plan.press(at_us)
        plan.press(again_us)
    else:
        plan.order(at_us, "stop")
        plan.order(again_us, "start")
    plan.order(again_us + S_US, "restart", 1)
    return again_us + S_US


def _noise(plan: Plan, draw: random.Random, at_us: int) -> int:
    """What is no frame, or one whose checksum is wrong."""
    frame = bytearray.fromhex(send("reset", 1))
    frame[draw.randrange(1, len(frame) - 1)] ^= 1 << draw.randrange(8)
    noise = draw.randbytes(draw.randint(1, 60))
    plan.send(at_us, draw.choice((bytes(frame), noise)).hex())
    return at_us


_ORDERS = (
    _command(("tare", 0, 0), ("tare", 1, 0), ("tare", 2, 0)),
    _command(("restart", 1, 0)),  # the filter `fuse`
    _command(*(("rate", 0, hz) for hz in (1, 10, 25, 50, 100))),
    _command(("hello", 0, 0), ("params_tell", 0, 0)),
    # What it refuses.
    _command(("rate", 0, 9999), ("tare", 99, 0), ("params_apply", 8, 1)),
    _stop_and_start,
    _noise,
)
