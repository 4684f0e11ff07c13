# SPDX-License-Identifier: MIT
"""A twin's state: of the boot, of the params, and since the filter started."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from imud import _core
from imud.wire.messages import Message, Value


class BootPhase(Enum):
    """How much was heard of a boot before its filter began. Only who heard all of it
    knows, without being told, which raw message is the filter's first sample.

         hello 0                  stream_started
        --------> FRESH ---------------------------> STREAMING
                    | <---------------------------------+ |
                    |          stream_stopped             |
                    | hello with                          | hello with a sensor, and a
                    | a sensor                            | raw message for each sample
                    v      a change of the streams,       v
                 UNKNOWN <------------------------------ READY
                           or the filter begins

    A missing message, or a hello of another boot, leads to UNKNOWN from everywhere, and
    so does in STREAMING a hello with a sensor without a raw message for each sample.
    """

    UNKNOWN = auto()  # something is missing, or the filter has begun
    FRESH = auto()  # all was heard since number 0, and no sensor is known yet
    STREAMING = auto()  # the same, while messages stream
    READY = auto()  # the next raw message is the filter's first sample


class ParamsKnown(Enum):
    """What is known of the params that the probe has in force.

             all parts heard            a message is missing
    UNKNOWN -----------------> SURE <------------------------> GUESSED
       ^                        |     a hello or an event
       +------------------------+         names them
          others are named
    """

    UNKNOWN = auto()
    GUESSED = auto()  # those last heard of, or others since
    SURE = auto()


class Losses(Enum):
    """What is missing in the sequence since the filter began.

                 one number              a raw message that comes next
        WHOLE ---------------> ONE_MISSING ---------------> NO_SAMPLE
                                    ^  ^     one number       |  |
                                    |  +----------------------+  | a pose
                                    |        one number          v
                                    +------------------------- HARMLESS

    Any other gap ends the twin, and so does in ONE_MISSING whatever needs its sample.
    """

    WHOLE = auto()
    ONE_MISSING = auto()  # it may have been a sample
    NO_SAMPLE = auto()  # it may have been a pose, with its latched flags
    HARMLESS = auto()  # a pose has come since


@dataclass(slots=True)
class TwinBoot:
    """The state of one boot."""

    phase: BootPhase
    count: Value  # as its hello counts boots; before that, of the boot before
    hello: bytes = b""  # the last one that knows a sensor
    sample_rate: int = 0
    raw_rate: Value = None
    raw_us: int | None = None  # time of the last raw message
    is_heard: bool = False  # raw messages have come since the streams changed

    def knows(self, hello: Message, content: bytes, sample_rate: int) -> None:
        """Takes up a hello that knows a sensor, which comes when the filter begins."""
        self.hello = content
        self.sample_rate = sample_rate
        self.raw_rate = hello.fields["raw_rate"]
        if self.phase is BootPhase.STREAMING and self.is_full:
            self.phase = BootPhase.READY
        elif self.phase is not BootPhase.READY:
            self.phase = BootPhase.UNKNOWN

    def streams(self, *, is_on: bool) -> None:
        """A stream began or ended. Without one there are samples that are not sent."""
        self.is_heard = False
        if self.phase in (BootPhase.FRESH, BootPhase.STREAMING):
            self.phase = BootPhase.STREAMING if is_on else BootPhase.FRESH

    def change_streams(self) -> None:
        """Other messages are sent from now on, or the same."""
        self.is_heard = False
        self.unready()  # samples may be fused before the first raw message

    def unready(self) -> None:
        """The next raw message need not be the filter's first sample."""
        if self.phase is BootPhase.READY:
            self.phase = BootPhase.UNKNOWN

    @property
    def is_full(self) -> bool:
        """Whether there is a raw message for each sample."""
        return self.raw_rate == self.sample_rate


@dataclass(slots=True)
class TwinParams:
    """The state of the active params."""

    records: bytes | None = None  # None: not all of their parts were heard
    is_named: bool = False  # nothing is missing since they were named
    changed_at: int | None = None  # the last message that changed them

    @property
    def known(self) -> ParamsKnown:
        if self.records is None:
            return ParamsKnown.UNKNOWN
        return ParamsKnown.SURE if self.is_named else ParamsKnown.GUESSED


@dataclass(slots=True)
class TwinRun:
    """The state since the filter started."""

    replay: _core.Replay
    number: int | None  # of the filter, where an event named it
    hello: bytes  # that it began with
    is_guess: bool  # its params, or its own field, may be others
    is_heard: bool  # each sample since then was told, as the one before it
    steps: int = 0
    losses: Losses = Losses.WHOLE
    missing: int = 0  # the number that is, in ONE_MISSING
    has_differed: bool = False

    def step(self, content: bytes) -> None:
        self.replay.step(content)
        self.steps += 1
