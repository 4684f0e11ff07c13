# SPDX-License-Identifier: MIT
"""A twin's reports: its state, its outcomes, and how two poses differ."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from imud.wire import messages, schema
from imud.wire.messages import Message

# Flags of a pose about all samples since the pose before it.
LATCHED = schema.PoseFlags.CLIPPED | schema.PoseFlags.GAP

# Where the flags are in the content of a pose.
_FLAGS = messages.place_of("pose", "pose_flags")


class TwinState(Enum):
    """Whether a twin follows its probe, and the result.

                   the filter begins             a pose differs
        WAITING -------------------> FOLLOWING ----------------> DIFFERS
           ^                           ^   |                        |
           |         the filter begins |   | a sample is missing    |
           |                           |   v                        |
           +------------------------- LOST <------------------------+
             another boot or stream           a sample is missing

    From FOLLOWING and DIFFERS, too, another boot or stream, or params that are not
    known, lead to WAITING, and a restart of the filter to FOLLOWING.
    """

    WAITING = "waiting"  # for a stream, and for the filter to begin
    FOLLOWING = "following"
    LOST = "lost"
    DIFFERS = "differs"  # follows, and has met a difference since the filter began


@dataclass(frozen=True, slots=True)
class TwinStarted:
    """The filter began and the twin follows it."""

    sequence: int


@dataclass(frozen=True, slots=True)
class TwinStopped:
    """The stream or the boot ended, and the twin with it."""

    sequence: int


@dataclass(frozen=True, slots=True)
class TwinLost:
    """The twin can't follow from this message on."""

    sequence: int
    reason: str


@dataclass(frozen=True, slots=True)
class TwinDiffers:
    """A pose differs from what its samples give."""

    sequence: int
    fields: tuple[str, ...]  # that differ
    probe: bytes  # content as received
    twin: bytes
    is_first: bool  # since the filter began


@dataclass(frozen=True, slots=True)
class AskRaw:
    """The probe should send a raw message for each sample."""

    rate_hz: int | None  # None: the rate is right already


@dataclass(frozen=True, slots=True)
class AskRestart:
    """The probe should restart its filter."""


@dataclass(frozen=True, slots=True)
class AskParams:
    """The probe should tell its params."""


TwinOutcome = (
    TwinStarted | TwinStopped | TwinLost | TwinDiffers | AskRaw | AskRestart | AskParams
)


def differ_in_latches(probe: bytes, twin: bytes) -> bool:
    """Whether they differ only in latched flags that a missing pose had taken."""
    reported, computed = (
        int.from_bytes(pose[_FLAGS], "little") for pose in (probe, twin)
    )
    is_fewer = reported & ~computed == 0 and computed & ~reported & ~LATCHED == 0
    return is_fewer and _without_flags(probe) == _without_flags(twin)


def _without_flags(pose: bytes) -> bytes:
    return pose[: _FLAGS.start] + pose[_FLAGS.stop :]


def differing(message: Message, twin: bytes) -> tuple[str, ...]:
    other = messages.decode(twin)
    fields = other.fields if isinstance(other, Message) else {}
    return tuple(n for n, value in message.fields.items() if value != fields.get(n))
