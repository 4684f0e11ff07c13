# SPDX-License-Identifier: MIT
"""Commands for an image that streams pose and raw of every sample: restarts of its
filter, and other params. Each comes at another moment of a sample's period.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from benchmarks.common.capture import Capture
from benchmarks.common.images import RunFailed
from imud.params.value import Params
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

Command = tuple[int, str, tuple[int, int]]  # device time in us, name, arguments


@dataclass(frozen=True, slots=True)
class Kind:
    """Commands for a sample's period in us, and the event that confirms one."""

    commands: Callable[[float], Iterator[Command]]
    event: str

    def options(self, period_us: float) -> list[str]:
        """The emulator's options for sending them."""
        words: list[str] = []
        for index, (at_us, name, arguments) in enumerate(self.commands(period_us)):
            order = {"command": name, "token": 100 + index, "arguments": arguments}
            frame = encode_frame(messages.encode("command", order, index, 0))
            words += ["--send", f"{at_us}:{frame.hex()}"]
        return words

    def obeyed(self, capture: Capture) -> int:
        """How many were obeyed; RunFailed if none was."""
        count = sum(
            received.message.fields["event"] == self.event
            for received in capture.received
            if received.message.name == "event"
        )
        if count == 0:
            raise RunFailed(f"no {self.event}; let it run {SECONDS:.0f} s")
        return count


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


KINDS = {
    "restarts": Kind(restarts, "restarted"),
    "new params": Kind(changes, "params_changed"),
}
