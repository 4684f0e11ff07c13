# SPDX-License-Identifier: MIT
"""Hours of the images themselves in their emulators: here a minute, twelve hours at
night (`make hours`).
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from hours.plan import plan_of
from hours.worker import LAST, ROOT, Hours, started
from imud.wire.frame import encode_frame
from programs import ran
from system.virtual import BOARDS, F405, NANO, Board
from twin_bench import followed

SECONDS = 60
EVERY_S = 4


def make_hours(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    options = ["--folder", folder, "--hours", SECONDS / 3600, "--every", EVERY_S]
    return ran(
        sys.executable, "-m", "hours", *map(str, options), *words, cwd=ROOT / "tests"
    )


def state_of(folder: Path, board: Board) -> dict[str, Any]:
    return json.loads((folder / board.name / "state.json").read_text())


@pytest.mark.usefixtures("boards")
def test_both_boards_stop_and_go_on_and_come_to_a_good_end(tmp_path: Path) -> None:
    done = make_hours(tmp_path, "--minutes", "0.02")
    assert done.returncode == 75, done.stderr
    assert "stopped there; the next call continues" in done.stdout
    halfway = [state_of(tmp_path, board) for board in (NANO, F405)]
    assert not all(state["end"] for state in halfway)
    # Another seed does not give up what is under way.
    done = make_hours(tmp_path, "--seed", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr.count("of 0.0166667 h, seed 1\n") == 2
    for before, board in zip(halfway, (NANO, F405), strict=True):
        state = state_of(tmp_path, board)
        assert state["pid"] == before["pid"]  # not restarted
        assert state["problems"] == []
        assert [part["hours"] for part in state["parts"]][-1] == 0.017
        assert state["parts"][-1]["compared"] > 1000
        assert state["parts"][-1]["faults_told"] > 0
        assert state["faults"] >= 2


@pytest.mark.parametrize("board", BOARDS.values(), ids=BOARDS)
def test_a_seed_gives_the_same_plan_and_another_seed_another(board: Board) -> None:
    first, again, other = (plan_of(board, seed, 43200) for seed in (1, 1, 2))
    assert (first.options, first.faults) == (again.options, again.faults)
    assert first.faults != other.faults
    # Each kind comes up in twelve hours, and none that restarts the board.
    kinds = {fault["kind"] for fault in first.faults}
    assert len(kinds) == 9
    assert not kinds & {"reset", "brown_out", "power_cut", "crystal"}
    # As many as the emulators take of each.
    assert first.options.count("--send") < 4096


def test_what_came_until_a_problem_is_kept(tmp_path: Path) -> None:
    hours = Hours(NANO.name, tmp_path, 1, 60.0)
    frames = [encode_frame(content) for content in followed().live(600).contents]
    hours.take(b"\0" + b"".join(frames[:400]))
    assert not (tmp_path / LAST).exists()
    bad = encode_frame(b"\xee" * 20)  # no such message
    hours.take(bad)
    hours.take(b"".join(frames[400:]))
    assert (tmp_path / LAST).read_bytes() == b"\0" + b"".join([*frames[:400], bad])


def test_a_board_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    done = make_hours(tmp_path, "pico")
    assert done.returncode == 2
    assert "there is no board pico; there are nano, f405" in done.stderr


@pytest.mark.usefixtures("boards")
def test_a_run_under_way_is_given_up_only_if_that_is_asked_for(tmp_path: Path) -> None:
    make_hours(tmp_path, "nano", "--minutes", "0.02")
    before = state_of(tmp_path, NANO)
    done = make_hours(tmp_path, "nano", "--minutes", "0.02", "--seed", "2", "--fresh")
    assert "nano: the run at 0.0" in done.stderr
    assert "is abandoned" in done.stderr
    after = state_of(tmp_path, NANO)
    assert (before["seed"], after["seed"]) == (1, 2)
    assert started(before["pid"]) != before["started"]
    os.killpg(after["pid"], signal.SIGKILL)


def test_a_worker_that_ends_at_once_is_told(tmp_path: Path) -> None:
    (tmp_path / "nano" / "uart").mkdir(parents=True)  # no pipe can be made there
    done = make_hours(tmp_path, "nano")
    assert done.returncode == 1
    assert f"see {tmp_path}/nano/worker.txt" in done.stderr
