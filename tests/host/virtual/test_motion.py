# SPDX-License-Identifier: MIT
"""Motions from files, and the stream that reaches the simulator."""

from __future__ import annotations

import io
import itertools
import math
import struct
from pathlib import Path

import numpy as np
import pytest

from imud.virtual import motion, sensors
from imud.virtual.motion import Motion, MotionError


def test_a_saved_motion_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "hand.npz"
    made = sensors.generate(3.0, seed=7, errors=sensors.NO_ERRORS)
    made.save(path)
    again = motion.load(path)
    assert again.rate_hz == made.rate_hz
    assert again.is_recorded is made.is_recorded is False
    for name in motion.NPZ_KEYS:
        value, expected = (getattr(each, name) for each in (again, made))
        assert value.dtype == expected.dtype
        assert np.allclose(value, expected, rtol=1e-6, atol=1e-6)


def test_sensors_and_rate_are_enough(tmp_path: Path) -> None:
    path = tmp_path / "plain.npz"
    ones = np.ones((4, 3), np.float32)
    np.savez(path, gyr=ones, acc=2 * ones, mag=3 * ones, sampling_rate=[50.0])
    read = motion.load(path)
    assert (len(read), read.rate_hz, read.seconds) == (4, 50.0, 0.08)
    assert read.quat is None
    assert read.is_recorded
    assert (read.acc == 2.0).all()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"acc": None}, "no acc in it"),
        ({"acc": None, "sampling_rate": None}, "no acc, sampling_rate in it"),
        ({"mag": np.ones((3, 3))}, r"mag has shape \(3, 3\), not \(4, 3\)"),
        ({"gyr": np.float64(1.0)}, r"gyr has shape \(\), not \(1, 3\)"),
        ({"sampling_rate": 0.0}, "sampling_rate is 0 Hz"),
        ({"sampling_rate": math.nan}, "sampling_rate is nan Hz"),
        ({"sampling_rate": [1.0, 2.0]}, "sampling_rate is not one number"),
        ({"opt_quat": np.ones((4, 3))}, "opt_quat has shape"),
        ({"acc": np.diag([1.0, 1.0, 1.0, math.inf])[:, 1:]}, "record 3: acc is not a"),
        ({"gyr": np.array([{}], dtype=object)}, "not a .npz of plain arrays"),
    ],
)
def test_a_bad_npz_is_refused_with_its_reason(
    tmp_path: Path, change: dict[str, object], complaint: str
) -> None:
    ones = np.ones((4, 3))
    arrays: dict[str, object] = {"gyr": ones, "acc": ones, "mag": ones}
    arrays |= {"sampling_rate": 100.0} | change
    path = tmp_path / "bad.npz"
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    with pytest.raises(MotionError, match=complaint):
        motion.load(path)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"sampling_rate": "fast"}, "sampling_rate holds str.*, not numbers"),
        ({"sampling_rate": 1e300}, "sampling_rate is 1e\\+300 Hz; the maximum is"),
        ({"sampling_rate": 100j}, "sampling_rate holds complex128, not numbers"),
        ({"gyr": np.ones((4, 3)) * 1j}, "gyr holds complex128, not numbers"),
        ({"mag": np.array([["a"] * 3] * 4)}, "mag holds str.*, not numbers"),
        ({"acc": np.full((4, 3), 1e300)}, "record 0: acc exceeds every sensor's range"),
        ({"opt_quat": np.ones((4, 4)) * 1j}, "opt_quat holds complex128, not numbers"),
    ],
)
def test_what_is_no_number_of_a_sensor_is_refused(
    tmp_path: Path, change: dict[str, object], complaint: str
) -> None:
    ones = np.ones((4, 3))
    arrays: dict[str, object] = {"gyr": ones, "acc": ones, "mag": ones}
    path = tmp_path / "bad.npz"
    np.savez(path, **(arrays | {"sampling_rate": 100.0} | change))
    with pytest.raises(MotionError, match=complaint):
        motion.load(path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 and no more", b"\x93NUMPY"])
def test_what_is_no_npz_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.npz"
    path.write_bytes(content)
    with pytest.raises(MotionError, match=r"bad\.npz: not a \.npz"):
        motion.load(path)


def test_an_absent_file_and_an_unknown_kind_are_named(tmp_path: Path) -> None:
    with pytest.raises(MotionError, match=r"none\.csv: No such file"):
        motion.load(tmp_path / "none.csv")
    with pytest.raises(MotionError, match=r"a\.mat: a motion is a \.npz or a \.csv"):
        motion.load(tmp_path / "a.mat")


HEADER = ",".join(["t_s", *itertools.chain(*motion.CSV_COLUMNS.values())])


def csv_file(tmp_path: Path, *rows: str, header: str = HEADER) -> Path:
    path = tmp_path / "motion.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def row(t_s: float, first: float = 1.0) -> str:
    return ",".join(str(value) for value in [t_s, *(first + i for i in range(9))])


def test_a_csv_reads_by_its_header(tmp_path: Path) -> None:
    read = motion.load(csv_file(tmp_path, row(0.0), row(0.02), "", row(0.04, 5.0)))
    assert read.rate_hz == pytest.approx(50.0)
    assert read.gyr.tolist() == [[1, 2, 3], [1, 2, 3], [5, 6, 7]]
    assert read.acc[0].tolist() == [4, 5, 6]
    assert read.mag[0].tolist() == [7, 8, 9]


def test_csv_columns_come_in_any_order_among_others(tmp_path: Path) -> None:
    names = ["note", *reversed(HEADER.split(","))]
    rows = [
        ",".join(["-", *(str(value) for value in [*range(9, 0, -1), t_s])])
        for t_s in (0.0, 0.01)
    ]
    read = motion.load(csv_file(tmp_path, *rows, header=", ".join(names)))
    assert read.gyr.tolist() == [[1, 2, 3], [1, 2, 3]]
    assert read.mag.tolist() == [[7, 8, 9], [7, 8, 9]]


def test_records_that_are_missing_for_a_short_time_lie_between_their_neighbours(
    tmp_path: Path,
) -> None:
    rows = [row(0.01 * index, float(index)) for index in range(20)]
    del rows[7:11], rows[2]
    read = motion.load(csv_file(tmp_path, *rows))
    assert len(read) == 20
    assert read.gyr[:, 0] == pytest.approx(np.arange(20.0))
    assert read.rate_hz == pytest.approx(100.0)


def test_times_rounded_to_milliseconds_are_a_constant_rate(tmp_path: Path) -> None:
    rate_hz = 285.714
    rows = [row(round(index / rate_hz, 3)) for index in range(2000)]
    read = motion.load(csv_file(tmp_path, *rows))
    assert read.rate_hz == pytest.approx(rate_hz, rel=1e-4)


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        ([row(0.0)], "1 records; at least 2"),
        (
            [row(0.0), row(0.01), row(0.02), row(0.13), row(0.14)],
            r"csv:5: 0\.11 s after",
        ),
        ([row(0.0), row(0.01), row(0.01), row(0.02)], r"csv:4: 0 s after"),
        ([row(0.0), row(0.01), row(0.0)], "csv:(3|4): .*"),
        ([row(0.0), row(0.0), row(0.0)], "csv:3: times do not increase"),
        ([row(0.0), row(0.01), "0.02,1"], "csv:4: 2 columns, not 10"),
        ([row(0.0), row(0.01).replace("5.0", "five")], "csv:3: .*'five'"),
        ([row(0.0), row(0.01, math.nan)], "record 1: gyr is not a finite number"),
        (
            [row(i * 0.01 * (1 + i / 500)) for i in range(100)],
            r"csv:\d+: 4\.\d records off a constant rate",
        ),
    ],
)
def test_a_bad_csv_is_refused_at_its_line(
    tmp_path: Path, rows: list[str], complaint: str
) -> None:
    with pytest.raises(MotionError, match=complaint):
        motion.load(csv_file(tmp_path, *rows))


def test_missing_csv_columns_are_all_named(tmp_path: Path) -> None:
    header = HEADER.replace("acc_x_m_s2,", "").replace("mag_z_uT", "mag_z")
    with pytest.raises(MotionError, match=r"csv:1: no column acc_x_m_s2, mag_z_uT$"):
        motion.load(csv_file(tmp_path, row(0.0), header=header))


def test_the_stream_is_a_header_and_nine_floats_a_record() -> None:
    numbers = np.arange(27.0).reshape(3, 9)
    piece = Motion(200.0, gyr=numbers[:, :3], acc=numbers[:, 3:6], mag=numbers[:, 6:])
    file = io.BytesIO()
    motion.write_stream(file, [piece[:2], piece[2:]], count=3)
    sent = file.getvalue()
    assert sent[:8] == b"IMUMOT1\0"
    assert struct.unpack("<dQQ", sent[8:32]) == (200.0, 3, 1)
    assert struct.unpack("<27f", sent[32:]) == tuple(range(27))


class Pipe(io.BytesIO):
    """Remembers how much each flush has handed over."""

    def __init__(self) -> None:
        super().__init__()
        self.flushed: list[int] = []

    def flush(self) -> None:
        self.flushed.append(self.tell())


def test_each_piece_of_a_stream_is_handed_over_at_once() -> None:
    pipe = Pipe()
    pieces = sensors.stream(seed=1)
    motion.write_stream(pipe, itertools.islice(pieces, 4))
    assert len(pipe.flushed) == 4
    # No number of records, and no low-pass but the chip's own is to be felt.
    assert struct.unpack_from("<QQ", pipe.getvalue(), 16) == (0, 0)
    assert pipe.flushed[-1] == len(pipe.getvalue())
    assert (pipe.flushed[0] - 32) % 36 == 0


def test_the_recordings_with_optical_truth_read(shared_data: Path) -> None:
    path = shared_data / "broad" / "13_undisturbed_slow_translation_with_breaks_A.npz"
    read = motion.load(path)
    assert read.rate_hz == pytest.approx(285.714, abs=0.01)
    assert read.position is None
    assert read.movement.dtype == np.bool_
    assert read.quat.shape == (len(read), 4)
