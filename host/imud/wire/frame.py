# SPDX-License-Identifier: MIT
"""Converts bytes to the content of frames and back, with the firmware's own C."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from imud import _core
from imud.wire import kept, schema
from imud.wire.kept import KeptSchema
from imud.wire.messages import HELLO_ID as HELLO_ID


@dataclass(frozen=True, slots=True)
class FrameStats:
    """Counts of frames: good ones, and bad ones by what was wrong."""

    ok: int = 0
    bad_cobs: int = 0
    bad_crc: int = 0
    too_long: int = 0
    too_short: int = 0

    @property
    def bad(self) -> dict[str, int]:
        """Bad frames by kind."""
        kinds = ("bad_cobs", "bad_crc", "too_long", "too_short")
        return {kind: getattr(self, kind) for kind in kinds}


class FrameDecoder:
    """Turns received bytes into the content of frames, in chunks of any size.

    Follows the hellos to the schema of the probe that speaks, where it is a kept one.
    Contents are of our schema.
    """

    def __init__(self, fingerprint: object = schema.FINGERPRINT) -> None:
        self._before = Counter[str]()  # frames of the schemas before
        self._bad_before = 0
        self._begin(kept.find(fingerprint) or kept.OURS)

    def _begin(self, speaks: KeptSchema) -> None:
        self.speaks = speaks
        self._decoder = _core.FrameDecoder(speaks.seed, HELLO_ID)

    def feed(self, data: bytes) -> list[bytes]:
        """The content of each good frame that these bytes complete, without its CRC."""
        contents = self._decoder.feed(data)
        for content in contents:
            if content[0] == HELLO_ID:
                speaks = kept.find(kept.fingerprint_of(content))
                if speaks is not None and speaks is not self.speaks:
                    contents = self._again(speaks, content, data)
                    break
        if self.speaks is kept.OURS:
            return contents
        return [self.speaks.to_ours(content) for content in contents]

    def _again(self, speaks: KeptSchema, hello: bytes, data: bytes) -> list[bytes]:
        """The contents by another schema in a chunk that holds a hello of it, or the
        hello's end.
        """
        is_whole = encode_frame(hello) in data
        rest = data if is_whole else data[data.find(0) + 1 :]
        self._before.update(self._decoder.stats())
        # What it has counted of the rest is counted by the schema that follows.
        self._begin(self.speaks)
        self._decoder.feed(rest)
        self._before.subtract(self._decoder.stats())
        self._bad_before = self._before.total() - self._before["ok"]
        self._begin(speaks)
        contents = self._decoder.feed(rest)
        return contents if is_whole else [hello, *contents]

    @property
    def bad(self) -> int:
        """The number of bad frames of all kinds."""
        return self._bad_before + self._decoder.bad()

    @property
    def stats(self) -> FrameStats:
        return FrameStats(**self._counts())

    def _counts(self) -> Counter[str]:
        return self._before + Counter(self._decoder.stats())


def encode_frame(content: bytes, speaks: KeptSchema | None = None) -> bytes:
    """The frame of a message's content, with the delimiter at its end; for a reader of
    our schema or that one.
    """
    if content[:1] == bytes([HELLO_ID]):
        return _core.encode_frame(schema.HELLO_SEED, content)
    return _core.encode_frame(speaks.seed if speaks else schema.SEED, content)
