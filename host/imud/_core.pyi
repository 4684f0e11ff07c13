# SPDX-License-Identifier: MIT
"""The firmware's portable C: native/module.c over firmware/core."""

from collections.abc import Sequence
from typing import Any, Final, TypedDict, final

from typing_extensions import Buffer

CONTENT_MAX: Final[int]  # bytes a frame can carry
HELLO_SEED: Final[int]  # the CRC seed of a hello, the same for all schemas
TILT_FLOOR_DEG: Final[float]  # of the stated tilt
LEVEL_SIGMA_G: Final[float]  # of an uncalibrated accelerometer, as a share of gravity
SOURCES: Final[str]  # SHA-256 of what it was built of: checkout.py

class FrameStats(TypedDict):
    ok: int
    bad_cobs: int
    bad_crc: int
    too_long: int
    too_short: int

@final
class FrameDecoder:
    def __new__(cls, seed: int, hello_id: int) -> FrameDecoder: ...
    def feed(self, data: Buffer, /) -> list[bytes]: ...
    def bad(self) -> int: ...
    def stats(self) -> FrameStats: ...

Vector = tuple[float, float, float]

@final
class Calibrator:
    def __new__(cls, hello: Buffer, params: Buffer = b"") -> Calibrator: ...
    def apply(self, raw: Buffer, /) -> tuple[Vector, Vector, Vector | None]: ...

@final
class Chunk:
    def __new__(cls) -> Chunk: ...
    def add(
        self,
        channel: int,
        log_time: int,
        data: Buffer,
        publish_time: int,
        sequence: int,
        /,
    ) -> int: ...
    def add_record(self, record: bytes, /) -> None: ...
    def take(
        self,
    ) -> tuple[bytes, int, int, tuple[tuple[int, int, bytes], ...]] | None: ...

@final
class Rising:
    def __new__(cls) -> Rising: ...
    def turn(self, x: int, aim: int, rate: float, /) -> None: ...
    def at(self, x: int, /) -> int: ...
    def is_beyond(self, x: int, /) -> bool: ...

# Device's and host's ns; the rate; half of the range in ns, or -1; spread of the rate.
Estimate = tuple[int, int, float, float, float]

@final
class Line:
    def __new__(cls, rising: Rising, drift_max: float, quantum_ns: int) -> Line: ...
    def know(
        self,
        next_us: int,
        latest: tuple[int, int] | None,
        rate: float,
        estimate: Estimate | None,
        /,
    ) -> None: ...
    def date(
        self, device_us: int, host_ns: int, /
    ) -> tuple[int, int | None] | None: ...
    def moment(self, device_us: int, /) -> tuple[int, int | None]: ...
    def middle(self, device_us: int, /) -> int: ...

Table = dict[int, Any]  # values by number

# Name, tag, is it signed, bytes of a number, how many numbers, null, is it scaled, is
# it divided, by what, the tolerance of a norm (0: none), table (None: numbers count).
ReaderField = tuple[
    str, int, bool, int, int, int | None, bool, bool, float, float, Table | None
]

@final
class Reader:
    def __new__(cls, fields: tuple[ReaderField, ...]) -> Reader: ...
    def read(self, content: bytes, /) -> tuple[int, int, dict[str, Any]] | None: ...

@final
class Replay:
    def __new__(cls, hello: Buffer, params: Buffer = b"") -> Replay: ...
    def step(self, raw: Buffer, /) -> None: ...
    def pose(self, sequence: int, time_us: int, /) -> bytes: ...
    def stroke(self, sequence: int, time_us: int, /) -> bytes | None: ...
    def is_by_button(self) -> bool: ...
    def hold(self, is_held: bool, /) -> None: ...
    def params(self, records: Buffer, /) -> bool: ...
    def go_on(self) -> None: ...
    def restart(self, filter: int, /) -> None: ...
    def origin(self, kind: int, /) -> None: ...

def crc16(seed: int, data: Buffer, /) -> int: ...
def encode_frame(seed: int, content: Buffer, /) -> bytes: ...
def estimate(
    above: Sequence[tuple[int, int]],
    below: Sequence[tuple[int, int]],
    at_us: int,
    reference: int,
    rate: float,
    drift_max: float,
    /,
) -> Estimate | None: ...
def read_some(descriptor: int, /) -> bytes | None: ...
