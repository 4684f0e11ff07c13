# SPDX-License-Identifier: MIT
"""Files crafted to fill a reader's memory, or to keep it busy for ever.
The first of each kind is small and harmless, to compare with.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow
import zstandard
from mcap.writer import CompressionType, Writer
from pyarrow import parquet

from fakes import FakeProbe
from imud.log.parts import seal
from imud.log.writer import MAGIC

GIB = 1 << 30

_MESSAGE = struct.pack("<BQHIQQ", 5, 22, 1, 0, 0, 0)  # empty, on channel 1


def logs(folder: Path) -> Iterator[Path]:
    """MCAP files, of which the largest has some megabytes."""
    for name, data in (
        ("harmless", _packed(_channel(1, "imud/p/frame"))),
        ("zstd that is larger than it says", _chunk(_zeros(4 * GIB), 1000)),
        ("zstd of 4 GB", _chunk(_zeros(4 * GIB), 4 * GIB)),
        ("zstd without a size", _chunk(_zeros(GIB, sized=False), GIB)),
        ("zstd without a size, small", _chunk(_zeros(GIB, sized=False), 1000)),
        ("a million empty messages", _packed(_MESSAGE * 500_000)),
        ("many million empty messages", _packed(_MESSAGE * 6_000_000)),
        ("names", b"".join(_packed(_channels(n)) for n in range(0, 60_000, 6000))),
        (
            "long names",
            b"".join(_packed(_channel(n, "p" * 900_000)) for n in range(300)),
        ),
        ("long record", struct.pack("<BQ", 12, 1 << 62)),
        ("much metadata", _metadata(300_000)),
    ):
        path = folder / f"{name}.mcap"
        path.write_bytes(_file(data))
        yield path
    lz4 = io.BytesIO()
    writer = Writer(lz4, chunk_size=1 << 30, compression=CompressionType.LZ4)
    writer.start()
    channel = writer.register_channel("imud/p/pose", "json", 0)
    writer.add_message(channel, 0, bytes(200 << 20), 0)
    writer.finish()
    (folder / "lz4.mcap").write_bytes(lz4.getvalue())
    yield folder / "lz4.mcap"
    (folder / "summary.mcap").write_bytes(_summary(100_000))
    yield folder / "summary.mcap"


def captures(folder: Path) -> Iterator[Path]:
    """What a UART never said."""
    probe = FakeProbe()
    many = bytearray()
    for number in range(20_000):
        probe.probe_id = number.to_bytes(8, "big")
        many += probe.say("hello")
    for name, data in (
        ("harmless", FakeProbe().say("hello")),
        ("made-up ids", bytes(many)),
        ("nothing", bytes(20 << 20)),
        ("no end", b"\x01" * (20 << 20)),
    ):
        path = folder / f"{name}.bin"
        path.write_bytes(data)
        yield path


def tables(folder: Path) -> Iterator[Path]:
    """Motions."""
    header = "t_s,gyr_x_rad_s,gyr_y_rad_s,gyr_z_rad_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2"
    header += ",mag_x_uT,mag_y_uT,mag_z_uT\n"
    for name, rows in (
        ("harmless", ""),
        ("wide", "1," * 5_000_000),
        ("quoted", '"' + "1" * 20_000_000),
    ):
        path = folder / f"{name}.csv"
        path.write_text(header + rows)
        yield path
    for name, shape, size in (
        ("shape", (1 << 40, 3), 1000),
        ("zeros", (GIB // 24, 3), GIB),
    ):
        path = folder / f"{name}.npz"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for key in ("gyr", "acc", "mag", "sampling_rate"):
                with archive.open(f"{key}.npy", "w", force_zip64=True) as file:
                    file.write(_array_head(shape))
                    for _ in range(0, size, 1 << 20):
                        file.write(bytes(min(size, 1 << 20)))
        yield path


def parquets(folder: Path) -> Iterator[Path]:
    """Columns of one number, again and again."""
    for name, rows in (("harmless", 1000), ("many rows", 10_000_000)):
        path = folder / f"{name}.parquet"
        column = pyarrow.array(np.zeros(rows))
        names = ("time", "ax", "ay", "az", "gx", "gy", "gz")
        parquet.write_table(pyarrow.table(dict.fromkeys(names, column)), path)
        yield path


def texts(folder: Path) -> Iterator[Path]:
    """Settings, params, chains."""
    for name, text in (
        ("harmless", "a = 1"),
        ("deep", "a = " + "[" * 200_000),
        ("dots", "a." * 200_000 + "a = 1"),
        ("digits", "a = " + "9" * 2_000_000),
        ("long", "# " + "x" * (50 << 20)),
        ("keys", "".join(f"k{n} = 1\n" for n in range(500_000))),
    ):
        path = folder / f"{name}.toml"
        path.write_text(text)
        yield path


def _zeros(size: int, *, sized: bool = True) -> bytes:
    """A zstd frame of `size` zeros: 32 kB for each GB."""
    out = io.BytesIO()
    compressor = zstandard.ZstdCompressor(level=1)
    with compressor.stream_writer(
        out, size=size if sized else -1, closefd=False
    ) as file:
        block = bytes(1 << 24)
        for _ in range(size >> 24):
            file.write(block)
    return out.getvalue()


def _chunk(data: bytes, size: int, crc: int = 0, kind: bytes = b"zstd") -> bytes:
    body = struct.pack("<QQQII", 0, 1, size, crc, len(kind)) + kind
    body += struct.pack("<Q", len(data)) + data
    return struct.pack("<BQ", 6, len(body)) + body


def _packed(data: bytes) -> bytes:
    return _chunk(zstandard.compress(data), len(data), zlib.crc32(data))


def _channel(number: int, topic: str) -> bytes:
    text = topic.encode()
    body = struct.pack("<HHI", number, 0, len(text)) + text
    body += struct.pack("<I", 4) + b"json" + struct.pack("<I", 0)
    message = struct.pack("<BQHIQQ", 5, 22 + 2, number, 0, 0, 0) + b"{}"
    return struct.pack("<BQ", 4, len(body)) + body + message


def _channels(first: int) -> bytes:
    return b"".join(_channel(n, f"imud/p{n}/frame") for n in range(first, first + 6000))


def _metadata(count: int) -> bytes:
    values = seal("hello", {f"{n:x}": "" for n in range(count)})
    pairs = b"".join(_text(k) + _text(v) for k, v in values.items())
    body = _text("hello") + struct.pack("<I", len(pairs)) + pairs
    return struct.pack("<BQ", 12, len(body)) + body


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def _file(data: bytes) -> bytes:
    head = struct.pack("<BQII", 1, 8, 0, 0)
    end = struct.pack("<BQI", 15, 4, 0) + struct.pack("<BQQQI", 2, 20, 0, 0, 0)
    return MAGIC + head + data + end + MAGIC


def _summary(count: int) -> bytes:
    """Its summary has `count` channels, which are not in its content."""
    head = MAGIC + struct.pack("<BQII", 1, 8, 0, 0) + struct.pack("<BQI", 15, 4, 0)
    channels = b"".join(_channel(n % 65536, f"imud/{n}/frame") for n in range(count))
    footer = struct.pack("<BQQQI", 2, 20, len(head), 0, 0)
    return head + channels + footer + MAGIC


def _array_head(shape: tuple[int, ...]) -> bytes:
    text = repr({"descr": "<f8", "fortran_order": False, "shape": shape}).encode()
    text += b" " * (63 - (len(text) + 10) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text
