# SPDX-License-Identifier: MIT
"""`imud sim --sensor`: another sensor's word, image and rate."""

from __future__ import annotations

from pathlib import Path

import pytest

from imud import cli
from imud.errors import FileError
from imud.virtual import boards, memory
from imud.virtual.boards import VirtualBoard

WITH_OTHERS = [board for board in boards.BOARDS.values() if board.others]
each_board = pytest.mark.parametrize("board", WITH_OTHERS, ids=lambda each: each.name)

# Stands in for an emulator: keeps its words.
KEEPS_WORDS = """#!/bin/sh
echo "$@" >"$0.words"
exit 3
"""


BUILDERS = {"nano": "pio run -e nano_lsm6dsox", "pico": "make firmware BOARD=pico"}


@pytest.fixture
def emulator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in, in a folder without images."""
    program = tmp_path / "emulator"
    program.write_text(KEEPS_WORDS)
    program.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("sys.prefix", str(tmp_path / ".venv"))
    for board in WITH_OTHERS:
        monkeypatch.delenv(board.image_variable, raising=False)
    return program


def words_of(emulator: Path) -> list[str]:
    return emulator.with_name("emulator.words").read_text().split()


@each_board
def test_another_sensor_has_its_word_its_image_and_its_rate(
    board: VirtualBoard, emulator: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (other, *_) = board.others
    built = other.image or board.image
    words = ["sim", board.name, "--simulator", str(emulator), "--seconds", "1"]
    words += ["--sensor", other.name, "--raw"]
    assert cli.main(words) == 1
    error = capsys.readouterr().err
    assert error == f"imud: {built} is not built yet; run `{BUILDERS[board.name]}`\n"
    image = emulator.parent / built
    image.parent.mkdir(parents=True)
    image.touch()
    assert cli.main(words) == 3
    said = words_of(emulator)
    assert said[:2] == ["--image", str(image)]
    assert said[said.index("--sensor") + 1] == other.name
    assert board.with_sensor(other.name).sample_rate_hz == other.sample_rate_hz


@each_board
def test_each_sensor_has_its_own_limit_of_rates(
    board: VirtualBoard, emulator: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = emulator.with_name("image.elf")
    image.touch()
    words = ["sim", board.name, "--simulator", str(emulator), "--image", str(image)]
    words += ["--seconds", "1"]
    (other, *_) = board.others
    for limit, sensor in (
        (board.sample_rate_hz, []),
        (other.sample_rate_hz, ["--sensor", other.name]),
    ):
        assert cli.main([*words, *sensor, "--rate", str(limit)]) == 3
        with pytest.raises(SystemExit) as end:
            cli.main([*words, *sensor, "--rate", str(limit + 1)])
        assert end.value.code == 2
        assert f"{limit + 1} is not in 1..{limit}" in capsys.readouterr().err


@each_board
def test_its_usual_sensor_has_no_word(board: VirtualBoard, emulator: Path) -> None:
    image = emulator.with_name("image.elf")
    image.touch()
    words = ["--simulator", str(emulator), "--image", str(image), "--seconds", "1"]
    assert cli.main(["sim", board.name, *words]) == 3
    assert "--sensor" not in words_of(emulator)


def test_what_it_remembers_is_written_with_the_same_sensor(emulator: Path) -> None:
    image, kept = emulator.with_name("image.elf"), emulator.with_name("kept")
    for sensor in ("", "lsm6dsox"):
        with pytest.raises(FileError, match="can't run"):
            memory.memory_with(image, emulator, b"", kept, sensor=sensor)
        said = words_of(emulator)
        assert ("--sensor lsm6dsox" in " ".join(said)) == bool(sensor)
        assert ("--sensor" in said) == bool(sensor)


@pytest.mark.parametrize(
    ("board", "sensor"), [("nano", "bno055"), ("nano", ""), ("f405", "lsm6dsox")]
)
def test_a_sensor_that_a_board_cannot_have_is_a_usage_error(
    board: str, sensor: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(["sim", board, "--sensor", sensor])
    assert end.value.code == 2
    assert "--sensor" in capsys.readouterr().err
