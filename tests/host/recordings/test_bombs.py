# SPDX-License-Identifier: MIT
"""Files from strangers that are made to fill the memory: each reader uses some
megabytes, ends soon, and reports the problem of the file.
"""

from __future__ import annotations

import io
import os
import resource
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow
import pytest
import zstandard
from mcap.writer import CompressionType, Writer
from pyarrow import parquet

from fakes import FakeProbe
from imud.log.parts import seal
from imud.log.writer import MAGIC

# What a command takes beyond that on a harmless file, and beyond the file.
MIB = 1 << 20
MORE_MIB = 64
SOON_S = 20.0
KILL_S = 30


def run(words: Sequence[str], folder: Path) -> tuple[int, str, float, float]:
    """Exit code, stderr, resident memory in MiB and processor seconds of a command."""
    with (folder / "err").open("w+") as err:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "imud", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=err,
            cwd=folder,
        )
        resource.prlimit(process.pid, resource.RLIMIT_CPU, (KILL_S, KILL_S))
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        err.seek(0)
        text = err.read()
    seconds = usage.ru_utime + usage.ru_stime
    return process.returncode, text, usage.ru_maxrss / 1024, seconds


# Makers of files; the first of each is small and harmless, to compare with.
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
    for name, count, mib in (("shape", 1 << 40, 1), ("zeros", GIB // 96, 256)):
        path = folder / f"{name}.npz"
        with (
            zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file,
            file.open("gyr.npy", "w", force_zip64=True) as array,
        ):
            array.write(_array_head((count, 3)))
            for _ in range(mib):
                array.write(bytes(MIB))
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


CASES: list[tuple[Callable[[Path], Iterator[Path]], list[str]]] = [
    (logs, ["info", "{}"]),
    (logs, ["decode", "{}"]),
    (logs, ["export", "{}", "--to", "csv", "--out", "tables"]),
    (logs, ["recover", "{}", "--to", "{}.saved"]),
    (logs, ["sim", "nano", "--motion", "{}"]),
    (captures, ["info", "{}"]),
    (captures, ["decode", "{}"]),
    (tables, ["sim", "nano", "--motion", "{}"]),
    (tables, ["import", "{}", "--dry-run"]),
    (parquets, ["import", "{}", "--dry-run"]),
    (texts, ["config", "--check", "{}"]),
    (texts, ["params", "load", "p", "{}"]),
    (texts, ["body", "{}"]),
    (texts, ["calibrate", "tip", "p", "--method", "circle", "--positions", "{}"]),
]


@pytest.mark.sampled(8)
@pytest.mark.parametrize(
    ("make", "words"), CASES, ids=["-".join([m.__name__, *w]) for m, w in CASES]
)
def test_a_file_that_is_made_to_fill_the_memory_does_not(
    tmp_path: Path,
    make: Callable[[Path], Iterator[Path]],
    words: list[str],
    record_property: Callable[[str, object], None],
) -> None:
    plain_mib: float | None = None
    failed = []
    for path in make(tmp_path):
        given = [word.format(path) for word in words]
        code, error, took_mib, seconds = run(given, tmp_path)
        if plain_mib is None:
            plain_mib = took_mib
        more_mib = took_mib - plain_mib - path.stat().st_size / MIB
        told = f"{path.name}: {code}, {more_mib:.0f} MiB, {seconds:.1f} s"
        record_property(path.name, told)
        is_good = more_mib < MORE_MIB and seconds < SOON_S and code in (0, 1)
        if not is_good or error.count("\n") > 3 or "internal error" in error:
            failed.append(f"{told}: {error[-300:]}")
    assert not failed, "\n".join(failed)
