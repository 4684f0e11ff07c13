# SPDX-License-Identifier: MIT
"""The firmware's portable C: _core.c over firmware/core."""

from typing import Final, TypedDict, final

from typing_extensions import Buffer

CONTENT_MAX: Final[int]  # bytes a frame can carry
HELLO_SEED: Final[int]  # where the CRC of a hello starts, whatever the schema

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
    def stats(self) -> FrameStats: ...

@final
class Replay:
    def __new__(cls, hello: Buffer) -> Replay: ...
    def step(self, raw: Buffer, /) -> None: ...
    def pose(self, sequence: int, time_us: int, /) -> bytes: ...

def crc16(seed: int, data: Buffer, /) -> int: ...
def encode_frame(seed: int, content: Buffer, /) -> bytes: ...
