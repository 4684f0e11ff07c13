# SPDX-License-Identifier: MIT
"""A user who does not know the command line gets help: help texts, suggestions,
completion, man pages.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from imud.cli import build_parser, main

ROOT = Path(__file__).resolve().parents[3]


def ended(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


def test_without_a_command_there_is_the_list(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    code, out, err = ended([], capsys)
    assert (code, err) == (0, "")
    for title, names in build_parser().groups.items():
        (part,) = re.findall(rf"^{title}:\n((?:  .*\n)+)", out, re.MULTILINE)
        assert re.findall(r"^  (\S+)", part, re.MULTILINE) == [*names]
    code, out, _ = ended(["params"], capsys)
    assert code == 0
    assert "load params from a file" in out


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("lst", "there is no 'lst'; did you mean list?"),
        ("sim nnao", "there is no 'nnao'; did you mean nano?"),
        ("list --conect x", "there is no option --conect; did you mean --connect?"),
        ("params laod a b", "there is no 'laod'; did you mean load?"),
        (
            "restart --fliter=fuse",
            "there is no option --fliter; did you mean --filter?",
        ),
        ("params stylus show", "put the command first: imud params show stylus"),
        ("completion fish", "there is no 'fish', only bash, zsh, tcsh"),
        ("fly", "there is no 'fly', only run,"),
    ],
)
def test_what_was_probably_meant_is_named(
    typed: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = ended(typed.split(), capsys)
    assert (code, out) == (2, "")
    assert meant in err.splitlines()[-1]


def test_bash_completes_commands_and_options(tmp_path: Path) -> None:
    done = subprocess.run(
        [Path(sys.executable).with_name("imu-probe"), "completion", "bash"],
        capture_output=True,
        text=True,
        check=True,
    )
    script = tmp_path / "imu-probe.bash"
    script.write_text(done.stdout)
    for words, expected in (
        (["imu-probe", "li"], {"list", "listen"}),
        (["imu-probe", "params", "sh"], {"show"}),
        (["imu-probe", "list", "--conn"], {"--connect"}),
    ):
        typed = " ".join(words)
        code = (
            f"source {script}; COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; "
            "_shtab_imu_probe; printf '%s\\n' \"${COMPREPLY[@]}\""
        )
        found = subprocess.run(
            ["bash", "-c", code], capture_output=True, text=True, check=True
        )
        assert {*found.stdout.split()} == expected, typed


def test_each_command_has_a_man_page(tmp_path: Path) -> None:
    command = [sys.executable, ROOT / "tools/manpages.py", tmp_path]
    subprocess.run(command, check=True, capture_output=True)
    pages = {path.name for path in tmp_path.iterdir()}
    assert {"imud.1", "imud-run.1", "imud-params-load.1"} <= pages
    page = (tmp_path / "imud-params-load.1").read_text("utf-8")
    assert "example: imud params load stylus" in page


def test_only_what_a_file_changes_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "imud.toml"
    text = """\
twin = true

[log]
keep_mb = 4000

[probes.0011223344556677]
name = "stylus"
pose_rate = 50
"""
    file.write_text(f"[web]\nenabled = true\n{text.replace('twin = true', '')}")
    file.write_text("twin = true\n[web]\nenabled = true\n" + text.partition("\n")[2])
    assert main(["config", "--changed", str(file)]) == 0
    assert capsys.readouterr().out == text
    whole = tmp_path / "whole.toml"
    main(["config"])
    whole.write_text(capsys.readouterr().out)
    assert main(["config", "--changed", str(whole)]) == 0
    assert capsys.readouterr().out == ""
    file.write_text("[log]\nkeep_mb = -1\n")
    assert main(["config", "--changed", str(file)]) == 1
    assert "keep_mb" in capsys.readouterr().err
