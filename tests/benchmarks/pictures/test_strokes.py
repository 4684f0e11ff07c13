# SPDX-License-Identifier: MIT
"""The picture of strokes, from paths made by hand."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

import numpy as np
import pytest

WAYS = 0.1 * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, -1.0, 0.0]])
ERRORS = np.full((3, 3), 0.001)


class Path:
    """The parts of a run and its results that the picture needs."""

    true = WAYS
    path = errors = ERRORS
    sigmas = np.full((3, 3), 0.002)


@pytest.fixture(scope="module")
def picture() -> ModuleType:
    """Imported when it is used, because matplotlib takes long."""
    return importlib.import_module("benchmarks.pictures.strokes")


def test_corners_are_drawn_as_measured_and_closed(picture: ModuleType) -> None:
    path: Any = Path()
    measured = picture.places(path, path, is_closed=False)
    assert measured[-1] == pytest.approx([0.3, 0.3])
    assert measured[1] == pytest.approx([10.1, 0.1])
    closed = picture.places(path, path, is_closed=True)
    assert closed == pytest.approx(np.array([[0, 0], [10, 0], [10, 10], [0, 0]]))


def test_the_picture_has_each_experiment(picture: ModuleType) -> None:
    names = (*picture.PATHS, picture.STROKES)
    figure = picture.drawn({name: (Path(), Path()) for name in names})
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == [*picture.PATHS, "10 cm, supported, 2 s"]
    assert "measured: corners 0.37 cm rms" in str(
        [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    )
    assert len(figure.axes[2].patches) == len(WAYS)
