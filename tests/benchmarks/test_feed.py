# SPDX-License-Identifier: MIT
"""What the engines are fed: made from a motion, beside what the image read of it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import capture
import feed
import numpy as np
import pytest
import wire

from imud import messages, motion

G = feed.GRAVITY_M_S2


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


def test_a_level_rest_reads_1_g_and_the_field() -> None:
    found = feed.sampled(moved()).samples
    assert found.rate_hz == 200
    assert np.abs(found.gyr).max() == 0
    assert found.acc[:, 2] == pytest.approx(G, abs=feed.ACC_LSB_M_S2)
    field = found.mag[found.has_mag]
    assert field == pytest.approx(np.tile([0.0, 20.0, 9.0], (len(field), 1)), abs=0.16)
    assert found.has_mag.mean() == pytest.approx(0.5, abs=0.01)


def test_a_ramp_is_read_at_its_own_time_and_its_mean_is_exact() -> None:
    slope = 3.0  # rad/s2, which a straight line between records is
    made = moved(gyr=lambda t: [slope * t, -t, 0.0])
    found = feed.sampled(made)
    inside = found.times_s < made.seconds - 0.01
    taken = found.times_s[inside] - feed.TAKEN_BEFORE_S
    error = found.samples.gyr[inside, 0] - slope * taken
    assert np.abs(error).max() < 0.52 * feed.GYR_LSB_RAD_S


def test_the_field_is_that_of_the_middle_of_its_measurement() -> None:
    made = moved(mag=lambda t: [10.0 * t, 0.0, 0.0])
    found = feed.sampled(made)
    has_mag = found.samples.has_mag & (found.times_s < made.seconds - 0.01)
    felt = found.times_s[has_mag] - feed.FELT_BEFORE_S
    error = found.samples.mag[has_mag, 0] - 10.0 * felt
    assert np.abs(error).max() < 1.1 * feed.MAG_LSB_UT


def test_without_a_sensor_in_the_recording_the_chips_own_low_pass_delays_it() -> None:
    slope = 3.0
    recorded = moved(gyr=lambda t: [slope * t, 0.0, 0.0])
    true = dataclasses.replace(recorded, is_recorded=False)
    late = feed.sampled(recorded).samples.gyr - feed.sampled(true).samples.gyr
    delay_s = feed.GYR_LOWPASS[1]
    assert late[10:-10, 0].mean() / slope == pytest.approx(delay_s, abs=1e-5)


def test_a_rate_beyond_the_range_is_held_there_and_flagged() -> None:
    made = moved(gyr=lambda t: [50.0 if t > 2 else 0.0, 0.0, 0.0])
    rows = feed.sampled(made).rows
    is_beyond = rows["gyr"][:, 0] == 2**15 - 1
    assert is_beyond.any()
    assert (
        rows["sample_flags"][is_beyond] == feed.schema.SampleFlags.GYR_CLIPPED
    ).all()
    assert (rows["sample_flags"][~is_beyond] == 0).all()


def test_between_readings_the_last_is_held_and_before_them_the_first() -> None:
    nothing = [np.nan] * 3
    mag = np.array([nothing, [1, 2, 3], nothing, [4, 5, 6], nothing, nothing])
    zeros = np.zeros((6, 3))
    held = feed.Samples(200.0, zeros, zeros, mag).mag_held
    assert held[:, 0].tolist() == [1, 1, 1, 4, 4, 4]


def test_a_magnet_on_the_probe_adds_to_every_reading() -> None:
    made = moved()
    biased = feed.sampled(feed.with_bias(made, np.array([3.0, -1.5, 0.0]))).samples
    plain = feed.sampled(made).samples
    more = (biased.mag - plain.mag)[plain.has_mag]
    assert more == pytest.approx(np.tile([3.0, -1.5, 0.0], (len(more), 1)), abs=0.31)


def test_rows_and_messages_say_the_same() -> None:
    made = feed.sampled(moved())
    for index in (0, 1):
        said = messages.decode(made.raws[index])
        assert isinstance(said, messages.Message)
        assert said.time_us == made.rows["time_us"][index]
        assert said.fields["acc"] == tuple(made.rows["acc"][index])
        assert (said.fields["mag"] is None) == (index == 0)
    assert wire.to_contents(made.rows) == made.raws
    said = feed.said(feed.with_filter(made.hello, "mahony"))
    assert said.fields["filter"] == "mahony"


def test_contents_of_another_message_are_refused() -> None:
    made = feed.sampled(moved())
    with pytest.raises(ValueError, match="raw messages"):
        wire.to_rows("raw", [made.hello])


@pytest.mark.usefixtures("image", "nano")
def test_the_image_reads_what_is_made_up_here_to_one_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = motion.generate(8.0, seed=4, errors=motion.NO_ERRORS)
    path = tmp_path / "hand.npz"
    made.save(path)
    read = capture.run_nano(path)
    assert read.lost == 0
    # A build's own moment, by which the two would otherwise be apart.
    monkeypatch.setattr(feed, "FIRST_SAMPLE_S", float(read.feed.times_s[0]))
    made_up = feed.sampled(motion.load(path)).rows
    count = min(len(made_up), len(read.feed.rows)) - 2
    sent = read.feed.rows[:count]
    for name in ("gyr", "acc"):
        apart = np.abs(made_up[name][:count].astype(int) - sent[name])
        assert apart.max() <= 1
        assert (apart == 0).mean() > 0.95
