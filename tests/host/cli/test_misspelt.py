# SPDX-License-Identifier: MIT
"""A probe that is not there: each command names those that are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from configured import running
from imud import cli

COMMANDS = (
    *(["listen"], ["strokes"], ["record"], ["start"], ["stop"], ["tare"], ["restart"]),
    *(["params", "show"], ["params", "clear"], ["params", "history"]),
    *(["calibrate", "all"], ["calibrate", "tip"], ["calibrate", "undo"]),
)


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running(tmp_path_factory.mktemp("misspelt"), "") as (daemon, _, _):
        yield daemon.endpoint
        daemon.stop()


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_misspelt_probe_is_told_from_those_that_are_there(
    command: list[str],
    endpoint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main([*command, "nosuch", "--connect", endpoint]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "imud: no probe nosuch; choose one: 00112233445566aa"
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize("probe", ["", "*", "**", "a/b", "$*", "?a", "#", "\udcff"])
def test_what_no_probe_can_be_called_reaches_none(
    probe: str, endpoint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for command in (["tare", probe], ["name", probe, "x"], ["params", "show", probe]):
        assert cli.main([*command, "--connect", endpoint]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.endswith("; choose one of imud list")
    assert cli.main(["list", "--connect", endpoint, "--prefix", f"{probe}/ "]) == 1
    assert "can't be part of a key" in capsys.readouterr().err


def test_one_for_a_file_is_told_so_too(
    endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["params", "save", "nosuch", str(tmp_path / "a.toml")]
    assert cli.main([*words, "--connect", endpoint]) == 1
    assert "choose one: 00112233445566aa" in capsys.readouterr().err
    assert [*tmp_path.iterdir()] == []
