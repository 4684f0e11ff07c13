# SPDX-License-Identifier: MIT
"""A client of OpenIGTLink written from its protocol's description alone, strict about
each field, so that what it takes another client takes too.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

HEADER_BYTES = 58


class Heard(NamedTuple):
    """A message; `matrix` of a TRANSFORM, in mm, and `text` of a STRING."""

    kind: str
    name: str
    seconds: float
    metadata: dict[str, str]
    matrix: NDArray[np.float64]
    text: str


@cache
def crc_of(data: bytes) -> int:
    """The remainder of the data, with 64 zeros behind it, by ECMA-182's polynomial."""
    divisor = 1 << 64 | 0x42F0E1EBA9EA3693
    rest = int.from_bytes(data, "big") << 64
    while rest.bit_length() > 64:
        rest ^= divisor << rest.bit_length() - 65
    return rest


def parsed(data: bytes) -> Heard:
    """One whole message."""
    version, kind, name = struct.unpack(">H12s20s", data[:34])
    seconds, fraction, size, crc = struct.unpack(">IIQQ", data[34:HEADER_BYTES])
    body = data[HEADER_BYTES:]
    assert version == 2
    assert len(body) == size
    assert crc_of(body) == crc
    extended, index, texts, number = struct.unpack(">HHII", body[:12])
    assert (extended, number) == (12, 0)
    content = body[12 : size - texts - index]
    metadata = dict(
        metadata_of(body[size - index - texts : size - texts], body[-texts:])
    )
    matrix, text = np.full((4, 4), np.nan), ""
    if kind.rstrip(b"\0") == b"TRANSFORM":
        columns = np.array(struct.unpack(">12f", content)).reshape(4, 3)
        matrix = np.vstack([columns.T, [0.0, 0.0, 0.0, 1.0]])
    else:
        assert kind.rstrip(b"\0") == b"STRING"
        encoding, length = struct.unpack(">HH", content[:4])
        assert (encoding, length) == (3, len(content) - 4)
        text = content[4:].decode("ascii")
    names = kind.rstrip(b"\0").decode(), name.rstrip(b"\0").decode()
    return Heard(*names, seconds + fraction / 2**32, metadata, matrix, text)


def metadata_of(index: bytes, texts: bytes) -> Iterator[tuple[str, str]]:
    (count,) = struct.unpack(">H", index[:2])
    assert len(index) == 2 + 8 * count
    at = 0
    for number in range(count):
        entry = index[2 + 8 * number : 10 + 8 * number]
        key_bytes, encoding, value_bytes = struct.unpack(">HHI", entry)
        assert encoding == 3
        key, at = texts[at : at + key_bytes], at + key_bytes
        value, at = texts[at : at + value_bytes], at + value_bytes
        yield key.decode("ascii"), value.decode("ascii")


class Client:
    """Hears messages one after the other."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection

    def hear(self) -> Heard:
        head = self._take(HEADER_BYTES)
        (size,) = struct.unpack(">Q", head[42:50])
        return parsed(head + self._take(size))

    def hear_first(
        self,
        send: Callable[[], object],
        is_it: Callable[[Heard], bool] = lambda _: True,
    ) -> Heard:
        """The first message that is it, sending until it is heard: a server knows of
        a client a while after that has connected.
        """
        while True:
            while not select.select([self.connection], [], [], 0.05)[0]:
                send()
            if is_it(message := self.hear()):
                return message

    def hear_named(self, *names: str) -> Heard:
        """The next message that has one of these names."""
        while (message := self.hear()).name not in names:
            pass
        return message

    def _take(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self.connection.recv(count - len(data))
            if not more:
                raise EOFError
            data += more
        return data


@contextlib.contextmanager
def connected(address: tuple[str, int], patience_s: float) -> Iterator[Client]:
    """A client whose system keeps as little as it can of what is not yet read."""
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.settimeout(patience_s)
        connection.connect(address)
        yield Client(connection)
