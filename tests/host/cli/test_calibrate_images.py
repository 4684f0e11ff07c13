# SPDX-License-Identifier: MIT
"""`imud calibrate --from` what the images of both boards send."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.calibration.simulated import errors, housing_error
from demanded import BUILT
from imud import cli
from imud.calibration.guided import whole
from imud.calibration.guided.housing import found as housing_found
from imud.calibration.recording import Gatherer
from imud.cli.calibrate_source import of_file
from imud.virtual import modules
from length import choose

SEED = 3


@pytest.mark.long
@pytest.mark.parametrize("board", choose(everyday=["nano"], long=BUILT))
def test_a_shop_module_is_calibrated_from_what_its_image_sends(
    boards: dict[str, tuple[Path, Path]], board: str, tmp_path: Path
) -> None:
    simulator, image = boards[board]
    path = tmp_path / "a.bin"
    words = ["--simulator", simulator, "--image", image, "--fast", "--stream", "--raw"]
    words += ["--record", path, "--seed", SEED, "--seconds", 60]
    words += ["--module", "shop", "--hand", "calibrate"]
    assert cli.main(["sim", board, *map(str, words)]) == 0
    _, subject, samples = of_file(path, None)
    recording = Gatherer.of(subject.scale, samples).recording()
    fit = whole.fit(recording)
    assert fit is not None
    module = modules.named("shop", SEED)
    left = errors(module, fit)
    assert left["tilt"] < 0.1
    assert left["heading"] < 0.4
    assert left["scale"] < 0.15
    turn = housing_found(recording, fit)
    assert turn is not None
    assert housing_error(module, fit, turn) < 0.15
