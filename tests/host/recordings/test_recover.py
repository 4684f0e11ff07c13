# SPDX-License-Identifier: MIT
"""Cut and damaged logs."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader

from imud import cli
from imud.log.parts import Damage
from imud.log.reader import LogHead, salvage
from log_files import frames, read_log, records, write


def test_a_cut_log_is_recovered_beside_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put = records(60)
    path = write(tmp_path, put[:20], put[20:40], put[40:])
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    good = frames(path)
    assert 0 < len(good) < 60
    cut = path.read_bytes()
    assert cli.main(["recover", str(path)]) == 0
    saved = path.with_name(f"{path.stem}-recovered.mcap")
    assert "truncated" in capsys.readouterr().out
    assert path.read_bytes() == cut
    head, *_ = read_log(saved)  # to its end
    assert isinstance(head, LogHead)
    assert frames(saved) == good == [record.content for record in put[: len(good)]]
    with saved.open("rb") as file:
        assert make_reader(file).get_summary() is not None
    assert cli.main(["recover", str(path)]) == 1
    assert "already exists" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == sorted([path, saved])


def test_damage_in_the_middle_costs_only_what_it_struck(tmp_path: Path) -> None:
    put = records(100)
    path = write(tmp_path, *[put[at : at + 10] for at in range(0, 100, 10)])
    whole = path.read_bytes()
    summary_at = 9 * len(whole) // 10
    for at in range(200, summary_at, 211):
        struck = bytearray(whole)
        struck[at : at + 40] = bytes(40)
        path.write_bytes(struck)
        found = frames(path)
        assert set(found) <= {record.content for record in put}
        assert len(found) >= 70, at
        damages = [each for each in salvage(path) if isinstance(each, Damage)]
        assert all(each.size > 0 for each in damages if not each.is_tail)


def test_a_whole_log_is_left_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, records(10))
    assert cli.main(["recover", str(path)]) == 0
    assert "is intact" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == [path]
