# SPDX-License-Identifier: MIT
"""The examples in other languages: C, JavaScript on the stream, and Octave, whose
programs MATLAB reads as well. `make check` installs Node and Octave, `make test-long`
Octave; with neither, C alone is tried.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from demanded import leave_out
from fakes import PATIENCE_S, POSE
from imud import cli
from imud.recordings import export
from log_files import records, write
from programs import ran
from speaking import speaking

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = ROOT / "examples"
MODULES = ROOT / "build" / "web" / "node_modules"
COUNT = 100  # poses that an example prints here
POSES = "00112233445566aa " + " ".join(f"{part:.6f}" for part in POSE["q"])


def imud_on_path(directory: Path) -> dict[str, str]:
    """The environment of a user who has installed imud."""
    program = directory / "bin" / "imud"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m imud "$@"\n')
    program.chmod(0o755)
    return os.environ | {"PATH": f"{program.parent}:{os.environ['PATH']}"}


def first_lines(command: list[str], environment: dict[str, str]) -> Iterator[str]:
    """Of a program that does not end: it is stopped after COUNT of them."""
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=environment
    ) as running:
        try:
            for _ in range(COUNT):
                yield running.stdout.readline().rstrip("\n")
        finally:
            running.kill()


def octave(directory: Path, program: str, *, path: Path = EXAMPLES) -> str:
    if shutil.which("octave-cli") is None:
        leave_out("octave is not there")
    command = ["octave-cli", "--norc", "--no-history", "--path", str(path)]
    done = ran(
        *command, "--eval", program, timeout=2 * PATIENCE_S, env=imud_on_path(directory)
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_c_prints_the_poses_that_imud_listen_says(tmp_path: Path) -> None:
    program = tmp_path / "follow_pose"
    strict = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-O2"]
    source = str(EXAMPLES / "follow_pose.c")
    subprocess.run(["gcc", *strict, "-o", str(program), source], check=True)
    with speaking(tmp_path) as daemon:
        listen = f"imud listen --json --seconds 3 --connect {daemon.endpoint}"
        done = ran(
            *("sh", "-c", f"{listen} | {program}"),
            timeout=2 * PATIENCE_S,
            env=imud_on_path(tmp_path),
            check=True,
        )
    lines = done.stdout.splitlines()
    assert len(lines) > COUNT
    assert set(lines) == {POSES}


@pytest.mark.parametrize("is_old", [False, True])
def test_javascript_prints_the_poses_of_the_stream(
    tmp_path: Path, is_old: bool
) -> None:
    """Node 22 has WebSockets built in, older ones use the package `ws`."""
    if shutil.which("node") is None or not (MODULES / "ws").is_dir():
        leave_out("node or ws is not there")
    options: list[str] = []
    has_own = "console.log(typeof WebSocket)"
    if is_old:
        preload = tmp_path / "ws.cjs"
        preload.write_text('globalThis.WebSocket = require("ws");\n')
        options = ["--require", str(preload)]
    elif "undefined" in subprocess.check_output(["node", "-e", has_own], text=True):
        pytest.skip("this Node has no WebSocket: the other case has")
    with speaking(tmp_path, page=True) as daemon:
        (said,) = (line for line in daemon.lines if "the page is at" in line)
        url = said.split()[-1].replace("http", "ws")
        example = str(EXAMPLES / "follow_pose.mjs")
        lines = set(
            first_lines(
                ["node", *options, example, f"{url}/stream"],
                os.environ | {"NODE_PATH": str(MODULES)},
            )
        )
    q = " ".join(f"{part:.15g}" for part in POSE["q"])
    assert lines == {f"00112233445566aa {q}"}


@pytest.mark.nightly
def test_octave_prints_live_poses(tmp_path: Path) -> None:
    with speaking(tmp_path) as daemon:
        lines = octave(tmp_path, f"follow_pose ('{daemon.endpoint}')").splitlines()
    assert len(lines) > COUNT
    assert set(lines) == {POSES}


@pytest.mark.nightly
def test_octave_reads_the_tables_of_a_log(tmp_path: Path) -> None:
    put = records(60)
    path = write(tmp_path, put)
    assert cli.main(["export", str(path), "--to", "csv"]) == 0
    file = tmp_path / f"{path.stem}-left-pose.csv"
    poses = [record.values for record in put if record.topic == "pose"]
    found = octave(
        tmp_path,
        f"p = read_table ('{file}'); printf ('%d %d ', numel (p.q_w), p.seq(end));"
        "printf ('%.6f ', p.q_w(1), p.q_x(1), p.q_y(1), p.q_z(1));"
        "printf ('%s %d %d', p.flags{end}, isnan (p.position_x_m(1)),"
        " numel (p.since_origin_void));",
    )
    q = " ".join(f"{part:.6f}" for part in POSE["q"])
    count = len(poses)
    assert found == f"{count} {poses[-1]['seq']} {q} at_rest 1 {count}"


def test_the_reader_of_tables_knows_each_column_of_words() -> None:
    text = (EXAMPLES / "read_table.m").read_text("utf-8")
    words = {
        name
        for table in export.COLUMNS.values()
        for column in table.values()
        for name in column.names
        if column.cell is export._word
    }
    assert {word for word in words if f"'{word}'" not in text} == set()
