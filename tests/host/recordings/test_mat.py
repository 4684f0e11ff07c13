# SPDX-License-Identifier: MIT
"""Recordings in `.mat` files: what public ones hold is found, and what does not fit
ends with what to do.
"""

from __future__ import annotations

import struct
import zlib
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mat_file
from imud.errors import FileError
from imud.recordings import foreign_log, foreign_mat
from imud.recordings.foreign_map import ForeignMap
from raw_probe import in_si, used


def shapes() -> dict[str, dict[str, Any]]:
    """One recording, as structs and matrices of others."""
    t, acc, gyr, mag = in_si(used(20.0))
    deg = np.degrees(gyr)
    one = {"acc": acc, "gyr": deg, "mag": mag, "name": "left"}
    return {
        "arrays": {"time": t[:, None], "acc": acc, "gyro": deg, "mag": mag},
        "lying": {"acc": acc.T, "gyr": deg.T, "mag": mag.T, "fs": 100.0},
        "struct": {"fs_video": 30.0, "walk": {**one, "sampling_rate": 100.0}},
        "one struct of several": {"time": t, "hip": {**one, "acc": -acc}, "knee": one}
        | {"knee": {**one, "time": t}},
        "beside another rate": {"acc": acc, "gyr": deg, "fs": 100.0, "q": t.repeat(4)},
        "a matrix": {"data": np.column_stack([t, acc, deg, mag])},
    }


TOLD = {
    "one struct of several": ForeignMap(topics=("knee",)),
    "a matrix": ForeignMap(
        {"time": ("data_1",)}
        | {"acc": ("data_2", "data_3", "data_4"), "gyr": ("data_5", "data_6", "data_7")}
    ),
}


@pytest.mark.parametrize("is_packed", [True, False])
@pytest.mark.parametrize("kind", shapes())
def test_each_shape_of_a_recording_is_found(
    kind: str, is_packed: bool, tmp_path: Path
) -> None:
    path = mat_file.write(tmp_path / "a.mat", shapes()[kind], is_packed=is_packed)
    found = foreign_log.read(path, deepcopy(TOLD.get(kind)))
    t, acc, gyr, mag = in_si(used(20.0))
    assert np.abs(found.acc - acc).max() < 1e-9
    assert np.abs(found.gyr - gyr).max() < 1e-9
    assert np.abs(found.t_us - found.t_us[0] - 1e6 * (t - t[0])).max() < 600.0
    assert found.has_mag == (kind not in ("beside another rate", "a matrix"))
    if found.has_mag:
        fresh = np.isfinite(found.mag[:, 0])
        assert np.abs(found.mag[fresh] - mag[fresh]).max() < 1e-9


def packed(data: bytes, times: int = 1) -> bytes:
    pack = zlib.compressobj()
    inner = b"".join(pack.compress(data) for _ in range(times)) + pack.flush()
    return struct.pack("<II", 15, len(inner)) + inner


def deep() -> bytes:
    inner: Any = np.zeros(3)
    for _ in range(100):
        inner = {"a": inner}
    return mat_file.matrix("a", inner)


HEAD, ZEROS = mat_file.HEAD, np.zeros((9, 3))
WHOLE = mat_file.matrix("acc", ZEROS)
BAD = {
    "version 4": (bytes(200), "'-v7'"),
    "version 7.3": (HEAD[:124] + b"\0\2IM" + b"\x89HDF" * 9, "'-v7'"),
    "empty": (b"", "'-v7'"),
    "cut": (HEAD + WHOLE[:-9], "save it again"),
    "cut in a tag": (HEAD + WHOLE + b"\1\0", "save it again"),
    "no zlib": (HEAD + struct.pack("<II", 15, 8) + bytes(8), "save it again"),
    "a bomb": (HEAD + packed(bytes(1 << 20), 400), "over 200 MB: save fewer"),
    "small ones": (HEAD + packed(mat_file.element(14, b"") * 300_000), "too many"),
    "deep": (HEAD + deep(), "too deep"),
    "a shape": (HEAD + WHOLE.replace(b"\t\0\0\0\3", b"\t\0\0\1\3", 1), "over 200 MB"),
    "no force": (HEAD + mat_file.matrix("x", ZEROS), "--map acc=X,Y,Z"),
    "rates": (
        HEAD
        + b"".join(mat_file.matrix(name, ZEROS + 9.8) for name in ("acc", "gyr"))
        + b"".join(mat_file.matrix(f"fs {n}", float(n)) for n in (30, 100)),
        "--rate HZ",
    ),
    "several": (
        HEAD + b"".join(mat_file.matrix(n, {"acc": ZEROS}) for n in "ab"),
        "choose one with --topic: a, b",
    ),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_does_not_fit_says_what_to_do(kind: str, tmp_path: Path) -> None:
    content, why = BAD[kind]
    path = tmp_path / "a.mat"
    path.write_bytes(content)
    with pytest.raises(FileError, match=why):
        foreign_log.read(path)


def test_a_large_file_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = mat_file.write(tmp_path / "a.mat", {"acc": ZEROS})
    monkeypatch.setattr(foreign_mat, "ROOM", 100)
    with pytest.raises(FileError, match="save fewer variables"):
        foreign_log.read(path)
