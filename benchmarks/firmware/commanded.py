# SPDX-License-Identifier: MIT
"""The slowest sample of an image that obeys commands while it streams: restarts of its
filter, and other params. Each comes at another moment of a sample's period, with pose
and raw of every sample on the wire.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common.boards import Board
from benchmarks.common.images import RunFailed
from benchmarks.firmware.budget import LIMITS, Line
from benchmarks.firmware.profiles import measure
from imud.params.value import Params
from imud.virtual import motion, sensors
from imud.wire import messages
from imud.wire.frame import encode_frame
from imud.wire.params import words_of

# The emulator takes 64 commands, of which capture.run sends three.
RESTARTS = 60
CHANGES = 8
FIRST_US = 3_000_000  # the stream has begun, and the gyroscope's offset is known
# Between two restarts, besides the step of their phase: no whole part of the second in
# which the periodic messages come.
EVERY_US = 430_000
# The Nano's memory takes 3.4 ms a byte, and a change some steps of 5 ms.
WORD_US = 60_000
APPLY_US = 640_000
SECONDS = (FIRST_US + RESTARTS * EVERY_US) / 1e6 + 1.0
LISTED = 20  # functions

Command = tuple[int, str, tuple[int, int]]  # device time in us, name, arguments


@dataclass(frozen=True, slots=True)
class Function:
    """Its cycles in the slowest sample: of its own, and with what it calls."""

    name: str
    own: int
    inclusive: int


@dataclass(frozen=True, slots=True)
class Commanded:
    """The slowest sample of a run with commands."""

    what: str
    count: int  # of the commands that were obeyed
    cycles: int
    parts: dict[str, int]
    functions: list[Function]  # the most cycles of their own first

    def line(self, board: Board) -> Line:
        """Beside the limit of every sample."""
        name = f"the same, with {self.count} {self.what}"
        return Line(name, self.cycles, "", LIMITS[board.name].cycles)


def restarts(period_us: float) -> Iterator[Command]:
    """Every other one forgets the own field that the probe has kept."""
    for index in range(RESTARTS):
        at_us = FIRST_US + index * EVERY_US + round(index * period_us / RESTARTS)
        yield at_us, "restart", (0, index % 2)  # filter 0: the one that runs


def changes(period_us: float) -> Iterator[Command]:
    """Params with a calibration of the gyroscope, and none, in turn."""
    matrix = [[1.002, 0.001, 0], [0, 0.998, 0], [0, 0, 1]]
    values = {"bias_counts": [0, 0, 0], "matrix": matrix, "method": "learned"}
    sets = [Params().replaced("gyr", values), Params()]
    at_us = FIRST_US
    for index, params in zip(range(CHANGES), itertools.cycle(sets), strict=False):
        records, digest = params.encode(), params.digest
        for word in words_of(records):
            yield at_us, "params_write", word
            at_us += WORD_US
        signed = digest - (digest >> 31 << 32)
        phase_us = round(index * period_us / CHANGES)
        yield at_us + phase_us, "params_apply", (len(records), signed)
        at_us += APPLY_US


# The measurements, and the event that confirms a command.
KINDS = {"restarts": (restarts, "restarted"), "new params": (changes, "params_changed")}


def options(commands: Iterator[Command]) -> list[str]:
    """The emulator's options for sending them."""
    words: list[str] = []
    for index, (at_us, name, arguments) in enumerate(commands):
        order = {"command": name, "token": 100 + index, "arguments": arguments}
        frame = encode_frame(messages.encode("command", order, index, 0))
        words += ["--send", f"{at_us}:{frame.hex()}"]
    return words


def measure_all(board: Board, image: Path, hand: Path, seed: int) -> list[Commanded]:
    """Run the image on the motion's begin, with commands of each kind; RunFailed if
    none of a kind was obeyed.
    """
    shorter = hand.with_name("commanded.npz")
    motion.load(hand)[: round(SECONDS * sensors.HAND_RATE_HZ)].save(shorter)
    found = []
    for what, (commands, done) in KINDS.items():
        words = options(commands(1e6 / board.chip.rate_hz))
        measured = measure(board, image, shorter, seed, words)
        events = (
            received.message.fields["event"]
            for received in measured.capture.received
            if received.message.name == "event"
        )
        count = sum(event == done for event in events)
        if count == 0:
            raise RunFailed(f"no {what} were executed; let it run {SECONDS:.0f} s")
        found.append(slowest(measured.profile, what, count))
    return found


def slowest(profile: dict[str, Any], what: str, count: int) -> Commanded:
    """The slowest sample in the emulator's profile."""
    functions = [
        Function(name, tally["self"]["in_worst"], tally["inclusive"]["in_worst"])
        for name, tally in profile["functions"].items()
        if tally["inclusive"]["in_worst"] > 0
    ]
    parts = {name: tally["in_worst"] for name, tally in profile["parts"].items()}
    return Commanded(
        what,
        count,
        profile["total"]["worst"],
        dict(sorted(parts.items(), key=lambda item: -item[1])),
        sorted(functions, key=lambda function: (-function.own, function.name)),
    )


def show(found: Sequence[Commanded]) -> None:
    """Print the slowest samples by part and by function."""
    for each in found:
        print(f"\nslowest sample with {each.what}: {each.cycles} cycles, by part")
        for name, cycles in each.parts.items():
            if cycles > 0:
                print(f"{name:34}{cycles:>10}")
        print("by function                              own   with what it calls")
        # What obeys a command has few cycles of its own, and calls those that have.
        by_all = sorted(each.functions, key=lambda function: -function.inclusive)
        listed = dict.fromkeys([*by_all[:LISTED], *each.functions[:LISTED]])
        for function in listed:
            print(f"{function.name:34}{function.own:>10}{function.inclusive:>22}")
