# SPDX-License-Identifier: MIT
"""A browser's requests: JSON objects with a `do`. Anything else is refused."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from imud.calibration.session import Kind
from imud.commands import PARAMETERS_MAX
from imud.web.limbs import LimbName, Setup

# One part of a key, or of a selector: Zenoh gives the excluded characters a meaning.
Name = Annotated[str, Meta(max_length=200, pattern=r"^[^/*$#?;=\s]+$")]
Value = Annotated[str, Meta(max_length=8192, pattern=r"^[^;]*$")]
Secret = Annotated[str, Meta(max_length=200)]


class _Message(
    msgspec.Struct,
    frozen=True,
    forbid_unknown_fields=True,
    tag_field="do",
    tag=str.lower,
):
    pass


class Login(_Message, frozen=True):
    """The user's login. With a token the name is empty."""

    user: Secret
    secret: Secret


class Watch(_Message, frozen=True):
    """The probes' topics of which it needs every payload, its drawing rate, and its
    selected probe: poses of others are sent less often.
    """

    every: Annotated[tuple[tuple[Name, Name], ...], Meta(max_length=16)] = ()
    rate_hz: Annotated[float, Meta(ge=0.2, le=240)] = 60.0
    probe: Name | None = None


class Seen(_Message, frozen=True):
    """The number of the last message that it has drawn."""

    n: int


class Ask(_Message, frozen=True):
    """A command for a probe; the answer has the same id."""

    id: int
    probe: Name
    command: Name
    parameters: Annotated[dict[Name, Value], Meta(max_length=PARAMETERS_MAX)] = {}


class Calibrate(_Message, frozen=True):
    """Begins a calibration of a probe; `end` has it judged, `stop` gives it up."""

    id: int
    probe: Name
    kind: Kind | Literal["end", "stop"]


class Update(_Message, frozen=True):
    """Writes the newest firmware into a probe."""

    id: int
    probe: Name


class Logs(_Message, frozen=True):
    """Asks for the list of logs; the answer has the same id."""

    id: int


class Read(_Message, frozen=True):
    """Asks for the next part of a log; the answer has the same id."""

    id: int
    name: Name
    offset: Annotated[int, Meta(ge=0, le=1 << 50)]


class Export(_Message, frozen=True):
    """Makes the tables of a log; the answer has the name of a file to `read`."""

    id: int
    name: Name


class Ports(_Message, frozen=True):
    """Asks for the serial ports of the daemon's machine."""

    id: int


class Adopt(_Message, frozen=True):
    """Makes a port the daemon's own, or leaves it to others."""

    id: int
    port: Annotated[str, Meta(max_length=200)]
    ours: bool


class Virtual(_Message, frozen=True):
    """Starts the virtual probe, or ends it."""

    id: int
    on: bool


class Limbs(_Message, frozen=True):
    """Asks for the limbs that are saved, and the segments that there are."""

    id: int


class Limb(_Message, frozen=True):
    """Keeps a limb, if it has a `setup`, and runs it; without a name: ends it."""

    id: int
    name: LimbName | None
    setup: Setup | None = None
    replace: bool = False


class Play(_Message, frozen=True):
    """Plays a log at this multiple of real time, from its beginning; of the one that
    is played, another speed. 0: stands still.
    """

    id: int
    name: Name
    speed: Annotated[float, Meta(ge=0, le=100)] = 1.0


class Seek(_Message, frozen=True):
    """Goes to a time of the log that is played, UTC in ms."""

    id: int
    t_ms: Annotated[float, Meta(ge=0, le=1e13)]


class GoLive(_Message, frozen=True, tag="live"):
    """Ends the log: what is live is sent again."""


BrowserMessage = (
    Login
    | Watch
    | Seen
    | Ask
    | Calibrate
    | Update
    | Logs
    | Read
    | Export
    | Ports
    | Adopt
    | Virtual
    | Limbs
    | Limb
    | Play
    | Seek
    | GoLive
)
_decode = msgspec.json.Decoder(BrowserMessage).decode


def decode(message: str | bytes) -> BrowserMessage:
    """Decodes one message; MsgspecError if it is none of these."""
    try:
        found: BrowserMessage = _decode(message)
    except RecursionError:
        raise msgspec.DecodeError("it nests too deep") from None
    return found
