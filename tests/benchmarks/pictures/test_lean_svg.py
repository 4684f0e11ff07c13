# SPDX-License-Identifier: MIT
"""Pictures with no more than a screen shows, for light and dark pages."""

from __future__ import annotations

import importlib
import re
from dataclasses import asdict
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from benchmarks.common.paths import PICTURES
from benchmarks.pictures import lean_svg

DRAWN = ("limb", "probe", "strokes", "time")
MOST_BYTES = 100_000
COLOUR = re.compile(r"#[0-9a-f]{6}\b")


@pytest.fixture(scope="module")
def theme() -> ModuleType:
    """Imported when it is used, because matplotlib takes long."""
    return importlib.import_module("benchmarks.pictures.theme")


def test_a_thinned_line_keeps_its_ends_and_peaks_and_drops_what_is_straight() -> None:
    x = np.linspace(0.0, 700.0, 7001)
    y = 0.02 * np.sin(x)
    y[3000] = 50.0
    thinned = lean_svg.thinned(np.stack([x, y], axis=-1))
    assert len(thinned) < 20
    assert thinned[0].tolist() == [0.0, 0.0]
    assert thinned[-1].tolist() == [x[-1], y[-1]]
    assert [x[3000], 50.0] in thinned.tolist()
    gaps = np.interp(x, *thinned.T) - y
    assert abs(gaps).max() <= lean_svg.TOLERANCE


def test_a_closed_line_is_thinned_like_an_open_one() -> None:
    side = np.linspace(0.0, 10.0, 50)
    there = np.stack([side, np.zeros(50)], axis=-1)
    back = np.stack([side[::-1], np.ones(50)], axis=-1)
    ring = np.vstack([there, back, there[:1]])
    corners = [[0, 0], [10, 0], [10, 1], [0, 1], [0, 0]]
    assert lean_svg.thinned(ring).tolist() == corners


@pytest.mark.parametrize(
    ("data", "lean"),
    [
        ("M 1.004 2.006 \nL 4.5 2 \n", "m1 2.01l3.5 -0.01"),
        ("M 0 0 \nL 1 0 \nL 2 0 \nL 2 3 \nz\n", "m0 0l2 0 0 3z"),
        # A closed path ends where it began, and the next counts from there.
        ("M 1 1 \nL 5 1 \nz\nM 2 2 \nL 3 3 \n", "m1 1l4 0zm1 1l1 1"),
        ("M 1 1 \nC 1 2 2 3 3 3 \nC 4 3 5 2 5 1 \n", "m1 1c0 1 1 2 2 2 1 0 2 -1 2 -2"),
        ("M -0.5 0 \nQ 0 1 1 1 \n", "m-0.5 0q0.5 1 1.5 1"),
    ],
)
def test_a_path_is_written_in_steps_of_a_hundredth(data: str, lean: str) -> None:
    assert lean_svg.lean_path(data) == lean


def test_rounding_does_not_add_up_along_a_line() -> None:
    far = [(0.0, 0.0)] + [(n / 3.0, 5.0 * (n % 2)) for n in range(1, 1000)]
    data = "M " + "L ".join(f"{x} {y} \n" for x, y in far)
    steps = re.findall(r"-?[\d.]+", lean_svg.lean_path(data))
    at = np.array(steps, dtype=float).reshape(-1, 2).cumsum(axis=0)
    assert at == pytest.approx(np.array(far), abs=0.00501)


def test_equal_marks_are_written_once(theme: ModuleType, tmp_path: Path) -> None:
    figure = theme.blank(4.0, 3.0)
    axes = figure.subplots()
    for height in range(5):
        axes.plot([0, 1, 2], [height] * 3, "o", color=theme.LIGHT.ours)
    theme.save(figure, tmp_path / "marks.svg")
    svg = (tmp_path / "marks.svg").read_text()
    marks = [line for line in svg.splitlines() if line.startswith('<path id="p')]
    assert sum(theme.LIGHT.ours in line for line in marks) == 1
    assert svg.count("<use") >= 15


def test_math_text_is_refused(theme: ModuleType, tmp_path: Path) -> None:
    figure = theme.blank(4.0, 3.0)
    figure.suptitle("$x^2$")
    with pytest.raises(ValueError, match="plain text"):
        theme.save(figure, tmp_path / "math.svg")


def test_each_colour_has_one_for_dark_pages(theme: ModuleType) -> None:
    light, dark = (asdict(each).values() for each in (theme.LIGHT, theme.DARK))
    assert len(set(light) | set(dark)) == len(light) + len(dark)


@pytest.mark.parametrize("name", DRAWN)
def test_a_picture_is_small_and_reads_on_light_and_dark_pages(
    theme: ModuleType, name: str
) -> None:
    svg = (PICTURES / f"{name}.svg").read_text()
    assert len(svg) < MOST_BYTES
    style = svg[svg.index("<style>") : svg.index("</style>")]
    used = set(COLOUR.findall(svg.replace(style, "")))
    dark = dict(
        zip(asdict(theme.LIGHT).values(), asdict(theme.DARK).values(), strict=True)
    )
    assert used <= dark.keys()
    for colour in used:
        assert f'="{colour}"]' in style
        assert dark[colour] in style
    ground = f'<rect width="100%" height="100%" fill="{theme.LIGHT.ground}"/>'
    assert svg.index(ground) < svg.index("<text")
