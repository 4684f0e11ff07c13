# SPDX-License-Identifier: MIT
"""board_test.c, built as the image is, in the virtual STM32F405."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from letters import Board, Run
from programs import ran
from stm32.programs import FLOAT_ABIS, board_program


@pytest.fixture(scope="session", params=FLOAT_ABIS)
def program(root: Path, request: pytest.FixtureRequest) -> Path:
    tests = root / "tests"
    sources = [*(tests / "stm32").glob("*.c"), tests / "generic" / "letters.c"]
    return board_program(request.param, sources)


@pytest.fixture(scope="session")
def used_flash(program: Path, f405: Path, tmp_path_factory: Any) -> bytes:
    """Flash behind a first start, so that further ones erase nothing."""
    path = tmp_path_factory.mktemp("flash") / "flash"
    subprocess.run(
        [f405, "--image", program, "--fast", "--seconds", "3", "--eeprom", path],
        check=True,
        capture_output=True,
    )
    return path.read_bytes()


@pytest.fixture
def board(program: Path, f405: Path, used_flash: bytes, tmp_path: Path) -> Board:
    def run(
        *sent: tuple[int, str],
        seconds: float = 1.0,
        faults: list[dict[str, Any]] | None = None,
        options: tuple[str, ...] = (),
        flash: Path | None = None,
    ) -> Run:
        """Sends letters at their times, in milliseconds."""
        record, summary = tmp_path / "record", tmp_path / "summary"
        (tmp_path / "faults").write_text(json.dumps(faults or []), encoding="ascii")
        if flash is None:
            flash = tmp_path / "flash"
            flash.write_bytes(used_flash)
        command: list[str | Path] = [
            *(f405, "--image", program, "--record", record, "--summary", summary),
            *("--fast", "--seconds", str(seconds), "--faults", tmp_path / "faults"),
            *("--eeprom", flash, *options),
        ]
        for at_ms, letters in sent:
            command += ["--send", f"{at_ms * 1000}:{letters.encode().hex()}"]
        done = ran(*command)
        assert done.returncode == 0, done.stderr
        figures = json.loads(summary.read_text(encoding="ascii"))
        assert figures["firmware_complaint"] is None
        return Run(
            # A link begins with a zero.
            record.read_text(encoding="ascii", errors="replace")
            .replace("\0", "")
            .splitlines(),
            figures,
        )

    return run
