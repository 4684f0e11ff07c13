# SPDX-License-Identifier: MIT
"""Motions from files and from the hand: what is felt agrees with what is done."""

from __future__ import annotations

import io
import itertools
import math
import struct
from pathlib import Path

import numpy as np
import pytest

from imud import rotation
from imud.virtual import motion, sensors
from imud.virtual.motion import Motion, MotionError
from imud.virtual.sensors import SensorErrors, World

RATE_HZ = 1000.0


@pytest.fixture(scope="module")
def exact() -> Motion:
    """A minute of the hand as a perfect sensor would feel it."""
    return sensors.generate(60.0, seed=7, errors=sensors.NO_ERRORS)


def known(array: rotation.FloatArray | None) -> rotation.FloatArray:
    assert array is not None
    return array


def rms(values: rotation.FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


# The hand: each quantity against a difference of the one it derives from. Steps of
# 2 ms are blunt, so each bound is a share of what the hand does at its strongest.


def test_the_rate_is_the_attitudes_derivative(exact: Motion) -> None:
    quat = known(exact.quat)
    turned = rotation.multiply(rotation.inverse(quat[:-2]), quat[2:])
    rate = rotation.to_rotation_vector(turned) * RATE_HZ / 2.0
    assert np.abs(exact.gyr).max() > math.radians(300.0)
    assert np.abs(rate - exact.gyr[1:-1]).max() < math.radians(0.05)


def test_velocity_is_the_positions_derivative(exact: Motion) -> None:
    position = known(exact.position)
    speed = (position[2:] - position[:-2]) * RATE_HZ / 2.0
    assert np.abs(known(exact.velocity)).max() > 0.5
    assert np.abs(speed - known(exact.velocity)[1:-1]).max() < 5e-4


def test_specific_force_is_acceleration_against_gravity(exact: Motion) -> None:
    velocity = known(exact.velocity)
    acceleration = (velocity[2:] - velocity[:-2]) * RATE_HZ / 2.0
    felt = rotation.rotate(known(exact.quat), exact.acc)[1:-1]
    up = np.array([0.0, 0.0, motion.GRAVITY_M_S2])
    assert np.abs(acceleration).max() > 3.0
    # The surface's grain at 60 Hz is what 2 ms resolve worst: 2.4 % of its strength.
    assert np.abs(acceleration + up - felt).max() < 0.05


def test_the_tip_is_at_its_place_in_the_body(exact: Motion) -> None:
    arm = rotation.rotate(known(exact.quat), np.array(World().tip_m))
    assert np.allclose(known(exact.position) + arm, known(exact.tip), atol=1e-12)


def test_the_field_is_the_earths_whatever_the_attitude(exact: Motion) -> None:
    field = rotation.rotate(known(exact.quat), exact.mag)
    dip = math.radians(66.0)
    expected = 49.0 * np.array([0.0, math.cos(dip), -math.sin(dip)])
    assert np.allclose(field, expected, atol=1e-9)


def test_a_magnet_is_a_dipole() -> None:
    magnet = sensors.Magnet((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    along, across = magnet.field_ut(np.array([[0.0, 0.0, 0.1], [0.1, 0.0, 0.0]]))
    # mu0/4pi m/r^3 = 100 uT at 0.1 m; twice that on the axis, against it beside.
    assert along == pytest.approx([0.0, 0.0, 200.0])
    assert across == pytest.approx([0.0, 0.0, -100.0])


def test_a_magnet_disturbs_where_the_sensor_comes_near() -> None:
    world = World(magnets=(sensors.Magnet((0.15, 0.0, 0.05), (0.0, 0.5, 0.0)),))
    felt = sensors.generate(30.0, seed=7, world=world, errors=sensors.NO_ERRORS)
    norm = np.linalg.norm(felt.mag, axis=1)
    expected = world.field_at(known(felt.position))
    assert np.allclose(rotation.rotate(known(felt.quat), felt.mag), expected, atol=1e-9)
    assert norm.max() - norm.min() > 10.0


def test_a_rest_is_perfectly_still(exact: Motion) -> None:
    assert exact.is_rest is not None
    assert np.abs(exact.gyr[exact.is_rest]).max() < 1e-12
    force = np.linalg.norm(exact.acc[exact.is_rest], axis=1)
    assert force == pytest.approx(motion.GRAVITY_M_S2, abs=1e-12)


def runs(flags: motion.BoolArray) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [slice(*pair) for pair in itertools.pairwise(edges)][::2]


@pytest.mark.parametrize("seed", range(5))
def test_it_starts_with_three_to_five_seconds_of_rest(seed: int) -> None:
    made = sensors.generate(8.0, seed)
    assert made.is_rest is not None
    assert made.movement is not None
    first = runs(made.is_rest)[0]
    assert first.start == 0
    assert 3.0 <= first.stop / RATE_HZ <= 5.0
    assert (made.movement == (np.arange(len(made)) >= first.stop)).all()


def test_strokes_are_five_to_fifteen_centimetres_along_the_surface(
    exact: Motion,
) -> None:
    assert exact.is_stroke is not None
    strokes = runs(exact.is_stroke)[:-1]  # the end may cut the last one short
    assert len(strokes) > 10
    tip = known(exact.tip)
    for stroke in strokes:
        path = tip[stroke]
        length = np.linalg.norm(path[-1] - path[0])
        assert 0.0499 < length < 0.1501
        # The surface is level at height 0, but for its grain.
        assert np.abs(path[:, 2]).max() < 5e-5


def test_each_round_has_strokes_turns_and_rests(exact: Motion) -> None:
    assert exact.is_rest is not None
    up = rotation.rotate(known(exact.quat), np.array([0.0, 0.0, 1.0]))[:, 2]
    assert len(runs(exact.is_rest)) >= 3
    assert up.min() < -0.5  # upside down
    assert known(exact.tip)[:, 2].max() > 0.15  # in the air
    assert known(exact.tip)[:, 2].min() > -1e-3  # never inside the table


def test_the_same_seed_gives_the_same_motion() -> None:
    first, again, other = (sensors.generate(6.0, seed) for seed in (3, 3, 4))
    for name in motion.NPZ_KEYS:
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.gyr, other.gyr)


def test_a_stream_is_the_same_motion_in_pieces() -> None:
    whole = sensors.generate(20.0, seed=3)
    pieces = sensors.stream(3)
    gathered = [next(pieces) for _ in range(60)]
    joined = motion.join(gathered)[: len(whole)]
    assert np.array_equal(joined.acc, whole.acc)
    assert np.array_equal(known(joined.quat), known(whole.quat))
    assert all(len(piece) < 10 * RATE_HZ for piece in gathered)


def test_noise_has_the_data_sheets_strength_after_the_chips_low_pass() -> None:
    errors = SensorErrors(gyr_offset_dps=0.0, acc_offset_mg=0.0)
    made = sensors.generate(3.0, seed=11, errors=errors)  # all of it rest
    assert made.is_rest is not None
    assert made.is_rest.all()
    # A mean over 5 of 1000 records a second, close to 0.443/92 Hz.
    averaged = [
        values.reshape(-1, 5, 3).mean(axis=1) - values.mean(axis=0)
        for values in (made.gyr, made.acc)
    ]
    assert math.degrees(rms(averaged[0])) == pytest.approx(0.1, rel=0.1)
    assert rms(averaged[1]) / motion.GRAVITY_M_S2 == pytest.approx(8e-3, rel=0.1)
    assert rms(made.mag - made.mag.mean(axis=0)) == pytest.approx(0.6, rel=0.1)


def test_offsets_stay_within_their_limits_and_differ_by_seed() -> None:
    errors = SensorErrors(0.0, 0.0, 0.0, 3.0, 60.0, 5.0)
    found = np.array(
        [sensors.generate(0.1, seed, errors=errors).gyr[0] for seed in range(20)]
    )
    limit = math.radians(3.0)
    assert np.abs(found).max() <= limit
    assert np.abs(found).max() > 0.8 * limit
    assert len(np.unique(found)) == found.size


# Files.


def test_a_saved_motion_reads_back(tmp_path: Path, exact: Motion) -> None:
    path = tmp_path / "hand.npz"
    exact[:3000].save(path)
    again = motion.load(path)
    assert again.rate_hz == exact.rate_hz
    assert again.is_recorded is exact.is_recorded is False
    for name in motion.NPZ_KEYS:
        value, expected = (getattr(each, name) for each in (again, exact))
        assert value.dtype == expected.dtype
        assert np.allclose(value, expected[:3000], rtol=1e-6, atol=1e-6)


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


def test_times_rounded_to_milliseconds_are_a_constant_rate(tmp_path: Path) -> None:
    rate_hz = 285.714
    rows = [row(round(index / rate_hz, 3)) for index in range(2000)]
    read = motion.load(csv_file(tmp_path, *rows))
    assert read.rate_hz == pytest.approx(rate_hz, rel=1e-4)


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        ([row(0.0)], "1 records; at least 2"),
        ([row(0.0), row(0.01), row(0.03), row(0.04)], r"csv:4: 0\.02 s after"),
        ([row(0.0), row(0.01), row(0.01), row(0.02)], r"csv:4: 0 s after"),
        ([row(0.0), row(0.01), row(0.0)], "csv:(3|4): .*"),
        ([row(0.0), row(0.0), row(0.0)], "csv:3: t_s does not increase"),
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


# The stream to the simulator.


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
    assert read.movement is not None
    assert read.movement.dtype == np.bool_
    assert known(read.quat).shape == (len(read), 4)
