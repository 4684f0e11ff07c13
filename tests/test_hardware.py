# SPDX-License-Identifier: MIT
"""The printed parts, as far as it shows without building them: their dimensions, and
what is derived from them. `make hardware` checks the solids.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hardware import archive, first_params
from hardware.layout import (
    Block,
    Layout,
    boards,
    dimensions,
    index_error_deg,
    tip_radius,
    wedge_error_deg,
)
from imud.errors import ParamsError
from imud.params import handles
from imud.params.value import Params

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"
BOARDS = boards()


def encloses(outer: Block, inner: Block) -> bool:
    low = outer.x0 <= inner.x0 and outer.y0 <= inner.y0 and outer.z0 <= inner.z0
    high = outer.x1 >= inner.x1 and outer.y1 >= inner.y1 and outer.z1 >= inner.z1
    return low and high


def test_the_params_of_handles_are_those_of_their_dimensions() -> None:
    wanted = first_params.files()
    assert sorted(path.stem for path in wanted) == handles.names()
    for path, text in wanted.items():
        assert path.read_text("utf-8") == text, first_params.COMMAND


def test_a_longer_rod_moves_the_tip() -> None:
    layout = Layout("nano")
    layout.handle = {**layout.handle, "rod_out": layout.handle["rod_out"] + 10}
    x, y, z = Layout("nano").tip_from_chip
    assert layout.tip_from_chip == (pytest.approx(x + 10), y, z)


@pytest.mark.parametrize("name", BOARDS)
def test_the_tip_of_a_handle_is_where_its_parts_put_it(name: str) -> None:
    """From the lengths along it, added once more."""
    every = dimensions()
    board, h = every["board"][name], every["handle"]
    sensor = every["sensor"][board["sensor"]]
    ahead = sensor["length"] - sensor["chip"][0] + h["fit"] + h["stop"] + h["front"]
    x, y, z = Layout(name).tip_from_chip
    assert x == pytest.approx(ahead + h["rod_out"])
    assert y == pytest.approx(sensor["width"] / 2 - sensor["chip"][1])
    bottom = h["floor"] + sensor["standoff"] + sensor["thickness"]
    assert z == pytest.approx(board["split"] - bottom - sensor["chip"][2])


@pytest.mark.parametrize("name", BOARDS)
def test_a_probe_takes_the_params_of_a_handle(name: str) -> None:
    params = first_params.params_of(name)
    assert params.faults() == []
    tip = params.tip
    assert tip.axis == (-1, 0, 0)
    assert tip.offset_m == pytest.approx(
        [mm / 1000 for mm in Layout(name).tip_from_chip], abs=1e-6
    )


def test_a_handle_leaves_the_calibration_alone() -> None:
    matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    values = {"bias_counts": (1, 2, 3), "matrix": matrix, "method": "typed"}
    before = Params().replaced("acc", values)
    after = handles.applied("handle-pico", before)
    assert after.acc == before.acc
    assert after.tip == first_params.params_of("pico").tip


def test_an_unknown_handle_is_answered_with_those_there_are() -> None:
    with pytest.raises(ParamsError, match="handle-nano, handle-pico, handle-pyboard"):
        handles.applied("handle-uno", Params())


@pytest.mark.parametrize("name", BOARDS)
def test_boards_are_inside_the_cavity_and_apart(name: str) -> None:
    layout = Layout(name)
    slabs = (layout.board_slab, layout.sensor_slab)
    assert all(encloses(layout.cavity, slab.block) for slab in slabs)
    assert all(encloses(slab.block, post) for slab in slabs for post in slab.posts)
    assert layout.board_slab.block.x1 < layout.sensor_slab.block.x0
    assert encloses(layout.cavity, layout.plug)


@pytest.mark.parametrize("name", BOARDS)
def test_screws_reach_the_lid_and_end_inside_it(name: str) -> None:
    layout = Layout(name)
    longer = dimensions()["saddle"]["screw_more"], dimensions()["saddle"]["thickness"]
    for more, below in ((0.0, 0.0), longer):
        reach = layout.thread(layout.board["screw"] + more, below)
        assert reach >= layout.screw["reach_min"]
        assert layout.split + reach < layout.height - layout.handle["floor"] / 2


def test_each_board_and_sensor_states_where_its_dimensions_are_from() -> None:
    every = dimensions()
    for kind in ("board", "sensor"):
        for name, entry in every[kind].items():
            assert len(entry["source"]) > 20, name
    for name in ("screw", "button"):
        assert every[name]["source"]


def test_an_archive_knows_what_it_was_built_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = tmp_path / "part.stl"
    part.write_bytes(b"solid")
    one, other = tmp_path / "one.zip", tmp_path / "other.zip"
    for path in (one, other):
        archive.write(path, [part], archive.origin())
    assert one.read_bytes() == other.read_bytes()
    assert archive.is_current(one)
    assert not archive.is_current(part)  # no archive at all
    (tmp_path / "dimensions.toml").write_text("[process]")
    monkeypatch.setattr(archive, "HERE", tmp_path)
    assert not archive.is_current(one)


def test_pictures_of_the_parts_are_there_and_shown() -> None:
    wanted = {f"hardware-{name}.svg" for name in (*BOARDS, "gauges")}
    assert {path.name for path in PICTURES.glob("hardware-*")} == wanted
    pages = (ROOT / "docs" / "build.md").read_text("utf-8")
    pages += (ROOT / "hardware" / "README.md").read_text("utf-8")
    assert wanted <= set(re.findall(r"pictures/(hardware-[\w.-]+)", pages))


def test_the_pages_have_the_sizes_in_force() -> None:
    build = (ROOT / "docs" / "build.md").read_text("utf-8")
    plan = (ROOT / "docs" / "check.md").read_text("utf-8")
    for name in BOARDS:
        layout = Layout(name)
        size = (layout.length, layout.width, layout.height)
        assert " x ".join(f"{mm:.0f}" for mm in size) + " mm" in build
        assert f"{tip_radius(layout):.0f} mm" in plan
    assert f"{index_error_deg():.2f} degrees of play" in plan
    assert f"{wedge_error_deg():.2f} degrees for 0.2 mm" in plan
    assert f"{wedge_error_deg():.2f} degrees for each 0.2 mm" in build
