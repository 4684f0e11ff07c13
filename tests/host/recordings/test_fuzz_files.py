# SPDX-License-Identifier: MIT
"""Files of any content by the grammar of their kind: each is read, or refused with an
error of ours, never an internal one.
"""

from __future__ import annotations

import contextlib
import io
import struct
import zipfile
from pathlib import Path

import pyarrow
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyarrow import parquet

import mat_file
from imud.errors import FileError, FlashError
from imud.flash import firmware, uf2
from imud.recordings import foreign_log

CELLS = ("", "0", "1.5", "-9.8", "1e308", "inf", "nan", "NA", "3,2", "10:15:03.25", "a")
CELLS += ("99:99:99", "2026-13-45 10:00:00", "2026-03-04 10:00:00Z", '"', "\0", "½")
NAMES = ("time", "ax", "ay", "az", "gx_rad_s", "gy_rad_s", "gz_rad_s", "mx", "", "fs")
SEPARATORS = (",", ";", "\t", "|", " ")

row = st.lists(st.sampled_from(CELLS), min_size=1, max_size=8)
tables = st.builds(
    lambda names, rows, times, by: "\n".join(map(by.join, [names, *rows * times])),
    st.lists(st.sampled_from(NAMES), max_size=8),
    st.lists(row, min_size=1, max_size=8),
    st.sampled_from([1, 30]),
    st.sampled_from(SEPARATORS),
).map(lambda text: text.encode("latin-1"))
hexes = st.lists(st.binary(min_size=1, max_size=20), max_size=5).map(
    lambda lines: b"".join(b":%s\n" % line.hex().encode() for line in lines)
)


def damaged(whole: bytes) -> st.SearchStrategy[bytes]:
    """With some bytes changed, and cut."""
    places = st.integers(0, len(whole) - 1)
    changes = st.dictionaries(places, st.integers(0, 255), max_size=6)
    return st.builds(
        lambda new, end: bytes(new.get(at, b) for at, b in enumerate(whole))[:end],
        changes,
        st.sampled_from([len(whole), len(whole) // 2, 140]),
    )


def archive(name: str, head: bytes, data: bytes) -> bytes:
    """A .npz with an array of that name, whatever its head says."""
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as file:
        size = struct.pack("<H", len(head))
        file.writestr(f"{name}.npy", b"\x93NUMPY\1\0" + size + head + data)
    return whole.getvalue()


heads = st.builds(
    "{{'descr': {}, 'fortran_order': {}, 'shape': {}, }}\n".format,
    st.sampled_from(["'<f8'", "'|O'", "'<U99999999'", "'<f8,<f4'", "''", "[]", "1"]),
    st.sampled_from(["False", "True", "None"]),
    st.sampled_from(["(9,)", "(3, 3)", "()", "(-1,)", "(99999999999,)", "9", "(1.5,)"]),
).map(str.encode)
archives = st.builds(
    archive, st.sampled_from(NAMES), heads | st.binary(max_size=80), st.binary()
)
scalars = st.sampled_from(["", "5", "x", "[", "{", "&a", "*a", "!!python/name:os", "~"])
keys = ["rosbag2_bagfile_information", "version", "storage_identifier", "files", "path"]
keys += ["relative_file_paths", "topics_with_message_count", "topic_metadata", "name"]
descriptions = st.lists(
    st.builds(
        "{}{}{}: {}".format,
        st.sampled_from(["", "  ", "    "]),
        st.sampled_from(["", "- "]),
        st.sampled_from(keys),
        scalars,
    ),
    max_size=12,
).map(lambda lines: "\n".join(lines).encode())
columns = {name: [0.01 * row for row in range(30)] for name in NAMES[:7]}
PARQUET = pyarrow.BufferOutputStream()
parquet.write_table(pyarrow.table(columns), PARQUET)

STRUCT = {"a": {"acc": [[0.0, 1.0, 9.8]] * 30, "s": "x", "fs": 100.0}}
MAT = mat_file.HEAD + mat_file.matrix("walk", STRUCT)
UF2 = uf2.encoded(bytes(600), firmware.PICO_AT, uf2.FAMILIES["rp2040"])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.csv", tables),
        ("a.mat", damaged(MAT)),
        ("a.npz", archives),
        ("a.parquet", damaged(PARQUET.getvalue().to_pybytes())),
        ("metadata.yaml", descriptions),
        ("a.uf2", damaged(UF2)),
        ("a.hex", hexes),
    ],
)
def test_what_cannot_be_read_is_an_error_of_ours(
    name: str, content: st.SearchStrategy[bytes], tmp_path: Path
) -> None:
    path = tmp_path / name
    is_image = path.suffix in (".uf2", ".hex")
    read = path.parent if path.suffix == ".yaml" else path

    @settings(max_examples=100, deadline=None, suppress_health_check=[*HealthCheck])
    @given(content)
    def check(raw: bytes) -> None:
        path.write_bytes(raw)
        with contextlib.suppress(FileError, FlashError):
            firmware.read(path) if is_image else foreign_log.read(read)

    check()
