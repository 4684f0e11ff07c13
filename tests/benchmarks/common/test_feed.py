# SPDX-License-Identifier: MIT
"""The engines' input: simulated from a motion, beside the image's readings of it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.common import capture, feed, wire
from benchmarks.common.boards import BOARDS
from imud.gravity import GRAVITY_M_S2
from imud.virtual import motion, sensors
from imud.wire import messages

G = GRAVITY_M_S2
CHIPS = pytest.mark.parametrize(
    "chip", [feed.MPU9250, feed.LSM9DS0], ids=lambda chip: chip.sensor
)


def moved(
    seconds: float = 3.0, rate_hz: float = 285.7, **rows: object
) -> motion.Motion:
    """Lying level, but for the rows that are given as functions of time."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    parts = {
        "gyr": np.zeros(3),
        "acc": np.array([0, 0, G]),
        "mag": np.array([0, 20, 9]),
    }
    made = {
        name: np.array([rows[name](each) for each in t])  # type: ignore[operator]
        if name in rows
        else np.tile(value.astype(float), (len(t), 1))
        for name, value in parts.items()
    }
    return motion.Motion(rate_hz, **made)


@CHIPS
def test_a_ramp_is_read_at_its_own_time_and_its_mean_is_exact(
    chip: feed.Chip,
) -> None:
    slope = 3.0  # rad/s2, which a straight line between records is
    made = moved(gyr=lambda t: [slope * t, -t, 0.0])
    found = feed.sampled(made, chip)
    inside = found.times_s < made.seconds - 0.01
    taken = found.times_s[inside] - chip.taken_before_s
    error = found.samples.gyr[inside, 0] - slope * taken
    assert np.abs(error).max() < 0.52 * chip.gyr_lsb


def test_the_field_is_that_of_the_middle_of_its_measurement() -> None:
    made = moved(mag=lambda t: [10.0 * t, 0.0, 0.0])
    found = feed.sampled(made)
    has_mag = found.samples.has_mag & (found.times_s < made.seconds - 0.01)
    felt = found.times_s[has_mag] - feed.MPU9250.felt_before_s
    error = found.samples.mag[has_mag, 0] - 10.0 * felt
    assert np.abs(error).max() < 1.1 * feed.MPU9250.mag_lsb


def test_a_clock_of_its_own_gives_the_last_reading_and_each_once() -> None:
    clock = feed.Clock(100.0, phase_s=0.003, taken_after_s=0.001)
    times = np.array([0.0115, 0.0121, 0.0219, 0.0221, 0.0319])
    felt, is_new = clock.last(times)
    assert felt == pytest.approx([0.003, 0.013, 0.013, 0.023, 0.023])
    assert is_new.tolist() == [True, True, False, True, False]
    chip = feed.LSM9DS0
    assert chip.mag_clock
    made = moved(mag=lambda t: [10.0 * t, 0.0, 0.0])
    found = feed.sampled(made, chip)
    has_mag = found.samples.has_mag & (found.times_s < made.seconds - 0.01)
    felt = found.samples.mag[has_mag, 0] / 10.0
    assert np.diff(felt) == pytest.approx(0.01, abs=0.002)  # a count is 0.8 ms
    age = found.times_s[has_mag] + chip.mag_clock.taken_after_s - felt
    assert -0.001 < age.min() < age.max() < 1.0 / chip.rate_hz + 0.001


def test_poses_come_at_their_rate_from_any_rate_of_samples() -> None:
    assert feed.posed_after(8, 200.0) == [1, 3, 5, 7]
    assert feed.posed_after(20, 380.0) == [3, 7, 11, 15, 18]
    assert len(feed.posed_after(3800, 380.0)) == 1000


@CHIPS
def test_without_a_sensor_in_the_recording_the_chips_own_low_pass_delays_it(
    chip: feed.Chip,
) -> None:
    slope = 3.0
    recorded = moved(gyr=lambda t: [slope * t, 0.0, 0.0])
    true = dataclasses.replace(recorded, is_recorded=False)
    late = feed.sampled(recorded, chip).samples.gyr
    late -= feed.sampled(true, chip).samples.gyr
    delay_s = chip.gyr_lowpass[1]
    assert late[10:-10, 0].mean() / slope == pytest.approx(delay_s, abs=3e-5)


def test_a_rate_beyond_the_range_is_held_there_and_flagged() -> None:
    made = moved(gyr=lambda t: [50.0 if t > 2 else 0.0, 0.0, 0.0])
    rows = feed.sampled(made).rows
    is_beyond = rows["gyr"][:, 0] == 2**15 - 1
    assert is_beyond.any()
    assert (
        rows["sample_flags"][is_beyond] == feed.schema.SampleFlags.GYR_CLIPPED
    ).all()
    assert (rows["sample_flags"][~is_beyond] == 0).all()


def test_rows_and_messages_say_the_same() -> None:
    made = feed.sampled(moved())
    for index in (0, 1):
        message = messages.decode(made.raws[index])
        assert isinstance(message, messages.Message)
        assert message.time_us == made.rows["time_us"][index]
        assert message.fields["acc"] == tuple(made.rows["acc"][index])
        assert (message.fields["mag"] is None) == (index == 0)
    assert wire.to_contents(made.rows) == made.raws
    message = feed.message_of(feed.with_filter(made.hello, "mahony"))
    assert message.fields["filter"] == "mahony"


def test_contents_of_another_message_are_refused() -> None:
    made = feed.sampled(moved())
    with pytest.raises(ValueError, match="raw messages"):
        wire.to_rows("raw", [made.hello])


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("board", "names"),
    # The accelerometer of the other has a clock of its own, whose phase is the build's.
    [("nano", ("gyr", "acc")), ("f405", ("gyr",))],
)
def test_the_image_reads_what_is_made_up_here_to_one_count(
    boards: dict[str, tuple[Path, Path]],
    tmp_path: Path,
    board: str,
    names: tuple[str, ...],
) -> None:
    made = sensors.generate(8.0, seed=4, errors=sensors.NO_ERRORS)
    path = tmp_path / "hand.npz"
    made.save(path)
    assert boards[board], "it runs this image"
    read = capture.run(board, path)
    assert read.lost == 0
    # A build's own moment, by which the two would otherwise be apart.
    chip = dataclasses.replace(
        BOARDS[board].chip, first_sample_s=float(read.feed.times_s[0])
    )
    made_up = feed.sampled(motion.load(path), chip)
    count = min(len(made_up.rows), len(read.feed.rows)) - 2
    sent = read.feed.rows[:count]
    for name in names:
        apart = np.abs(made_up.rows[name][:count].astype(int) - sent[name])
        assert apart.max() <= 1
        assert (apart == 0).mean() > 0.95
    message, known = (messages.decode(each.hello) for each in (made_up, read.feed))
    for name in ("board", "sensor", "who_am_i", "sample_rate", "mag_adjust"):
        assert message.fields[name] == known.fields[name]
    for name in ("acc_lsb", "gyr_lsb", "mag_lsb"):
        assert message.fields[name] == pytest.approx(known.fields[name], rel=1e-6)
    # As often is there something of the field.
    shares = [each.samples.has_mag.mean() for each in (made_up, read.feed)]
    assert shares[0] == pytest.approx(shares[1], abs=0.01)
