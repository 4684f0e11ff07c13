# SPDX-License-Identifier: MIT
"""Modules mounted in any of 24 ways, on the virtual boards: the samples that the image
sends go through the guide, with a hand that does what it says.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from imud.calibration.guided.events import Finished
from imud.calibration.guided.procedure import Procedure
from imud.calibration.mount import ALL, ModuleMount
from imud.cli.calibrate_source import of_file

SECONDS = 70

MODULE = """\
[acc]
matrix = {matrix}
bias_mg = [9, 18, -12]
[gyr]
matrix = {matrix}
bias_dps = [1, 0, -0.5]
[mag]
matrix = {matrix}
bias_uT = [20, -10, 5]
"""


# By day the same hand and guide find mountings without a board between them.
@pytest.mark.nightly
@pytest.mark.parametrize("board", ["nano", "f405"])
@pytest.mark.parametrize("mount", ALL, ids=lambda each: each.name)
def test_a_mounted_module_goes_through_the_guide(
    board: str, mount: ModuleMount, tmp_path: Path
) -> None:
    module = tmp_path / "module.toml"
    module.write_text(MODULE.format(matrix=mount.turn.T.tolist()))
    raw = tmp_path / "raw.bin"
    words = ["sim", board, "--fast", "--stream", "--raw", "--record", str(raw)]
    words += ["--module", str(module), "--hand", "calibrate", "--seed", "3"]
    command = [sys.executable, "-m", "imud", *words, "--seconds", str(SECONDS)]
    subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
    _, subject, samples = of_file(raw, None)
    procedure = Procedure(subject.scale, mount=None)
    events = [event for sample in samples for event in procedure.feed(sample)]
    (done,) = [each for each in events if isinstance(each, Finished)]
    assert done.mount == mount
    assert np.allclose(done.turn @ done.fit.acc.matrix, np.eye(3), atol=0.02)
