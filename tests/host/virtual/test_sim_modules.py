# SPDX-License-Identifier: MIT
"""`imud sim --module` and `--hand`, with the real emulators and images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from demanded import BUILT
from imud import cli
from imud.recordings import decode
from imud.virtual import modules, motion, sensors, sim

SEED = 3
each_board = pytest.mark.parametrize("board", BUILT)


def recorded(
    boards: dict[str, tuple[Path, Path]], board: str, path: Path, *words: object
) -> Path:
    """A capture of the image's messages, with all raw samples."""
    simulator, image = boards[board]
    own = ["--simulator", simulator, "--image", image, "--fast", "--stream", "--raw"]
    own += ["--record", path, "--seed", SEED, *words]
    assert cli.main(["sim", board, *map(str, own)]) == 0
    return path


def raw_of(path: Path) -> list[dict[str, Any]]:
    heard = decode.decode_file(path, decode.Tally())
    return [message for message in heard if message["type"] == "raw"]


@each_board
def test_a_module_with_half_a_g_of_bias_reads_so(
    boards: dict[str, tuple[Path, Path]], board: str, tmp_path: Path
) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[acc]\nbias_mg = [500, -500, 0]\n")
    hand = ("--hand", "calibrate", "--seconds", 2.2)
    path = recorded(boards, board, tmp_path / "a.bin", "--module", bad, *hand)
    counts = np.mean([each["acc_counts"] for each in raw_of(path)[10:]], axis=0)
    one_g = 2048.0 if board in ("nano", "pico", "mega") else 1366.1
    assert counts / one_g == pytest.approx([0.5, -0.5, 1.0], abs=0.02)
    assert not any("acc_clipped" in each["flags"] for each in raw_of(path))


def test_a_chip_saturates_at_the_end_of_its_range(
    boards: dict[str, tuple[Path, Path]], tmp_path: Path
) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[gyr]\nbias_dps = [2100, 0, -2200]\n")
    path = recorded(
        boards, "nano", tmp_path / "a.bin", "--module", bad, "--seconds", 1.5
    )
    last = raw_of(path)[-1]
    assert last["gyr_counts"][0] == 32767
    assert last["gyr_counts"][2] == -32768
    assert "gyr_clipped" in last["flags"]


def test_a_recording_gets_the_errors_but_no_noise_of_a_module(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    still = np.zeros((200, 3))
    force, field = np.array([0.0, 0.0, 9.8]), np.array([0.0, 20.0, -40.0])
    recording = motion.Motion(100.0, still, still + force, still + field)
    recording.save(path)
    words = ["sim", "nano", "--motion", path, "--module", "shop", "--seed", SEED]
    args = cli.build_parser().parse_args(list(map(str, words)))
    args.motion = motion.load(args.motion)
    _, pieces, seconds = sim.motion_of(args)
    (felt,) = pieces
    module = modules.named("shop", SEED)
    assert seconds == pytest.approx(2.0)
    expected = module.mag @ [0, 20, -40] + module.mag_bias
    assert felt.mag[0] == pytest.approx(expected, abs=1e-3)
    assert np.ptp(felt.mag, axis=0).max() < 1e-6
    args.motion = None
    _, pieces, _ = sim.motion_of(args)
    usual = next(iter(pieces))
    exact = next(sensors.stream(SEED, errors=sensors.NO_ERRORS))
    assert usual.mag.mean(axis=0) == pytest.approx(
        module.mag @ exact.mag.mean(axis=0) + module.mag_bias, abs=0.2
    )
