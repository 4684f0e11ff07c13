# SPDX-License-Identifier: MIT
"""The command line against a running daemon."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from chain import Chain
from fakes import PATIENCE_S, free_endpoint
from imud import cli
from streaming import Streaming


def test_listen_prints_what_is_published_and_sums_up(
    chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    connect = ["--connect", chain.daemon.endpoint]
    with Streaming(chain.port, chain.probe):
        angles = ["--json", "--angles", "nectec"]
        assert cli.main(["listen", "--seconds", "0.6", *angles, *connect]) == 0
        printed = capsys.readouterr()
        assert cli.main(["listen", chain.probe.name, "--seconds", "2.5", *connect]) == 0
        shown = capsys.readouterr()
        assert cli.main(["list", *connect]) == 0
        listed = capsys.readouterr()
    poses = [json.loads(line) for line in printed.out.splitlines()]
    first, count = poses[0]["seq"], len(poses)
    assert [pose["seq"] for pose in poses] == list(range(first, first + count))
    assert list(poses[0]["nectec"].values()) == pytest.approx([0, -90, 90])
    assert f"{count} poses received" in printed.err
    assert "0 messages missing (sequence gaps)" in printed.err
    lines = shown.out.splitlines()
    assert lines[0].split()[:4] == ["probe", "yaw", "pitch", "roll"]
    assert lines[1].startswith(chain.probe.name)
    assert "at_rest" in lines[1]
    assert "0 messages missing (sequence gaps)" in lines[-2]
    assert [line for line in lines if "sent = " in line] == lines[-1:]
    assert " 0 lost;" in lines[-1]
    assert shown.err == ""
    assert listed.out.splitlines()[0].split()[:3] == ["probe", "state", "board"]
    assert "0 of " in listed.out


def test_list_as_json_is_the_status(
    chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["list", "--json", "--connect", chain.daemon.endpoint]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert json.loads(line)["probe_id"] == chain.probe.name


def test_tare_from_the_command_line(
    chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    with chain.serving():
        assert cli.main(["tare", "--undo", "--connect", chain.daemon.endpoint]) == 0
    assert capsys.readouterr().out == f"{chain.probe.name}: tare done\n"
    assert chain.probe.commands[-1]["arguments"] == (2, 0)


def test_restart_from_the_command_line(
    chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    connect = ["--connect", chain.daemon.endpoint]
    with chain.serving():
        assert cli.main(["restart", "--filter", "mahony", *connect]) == 0
    assert capsys.readouterr().out == f"{chain.probe.name}: restart done\n"
    assert chain.probe.commands[-1]["arguments"] == (3, 0)
    chain.probe.results["restart"] = "bad_argument"
    with chain.serving():
        assert cli.main(["restart", "--filter", "dcm_pi", *connect]) == 1
    assert capsys.readouterr().err == (
        f"imud: probe {chain.probe.name} has no filter dcm_pi: its firmware does not "
        "include it and runs fuse\n"
    )


def test_no_pose_is_one_line(chain: Chain, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["listen", "--seconds", "0.2", "--connect", chain.daemon.endpoint]
    assert cli.main(arguments) == 1
    assert capsys.readouterr().err == (
        "imud: no pose arrived; is a probe streaming? try imud list, and imud start\n"
    )


@pytest.mark.parametrize("command", ["listen", "list", "start"])
def test_no_daemon_is_one_line(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    endpoint = free_endpoint()
    assert cli.main([command, "--connect", endpoint]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"imud: no imud at {endpoint}; start one with imud run")


def test_a_daemon_ends_with_the_program_that_started_it(tmp_path: Path) -> None:
    words = ["run", "--no-log", "--no-page", "--until-eof", "--listen", free_endpoint()]
    daemon = subprocess.Popen(
        [sys.executable, "-P", "-m", "imud", *words],
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        text=True,
    )
    assert "listens on" in daemon.stderr.readline()
    assert daemon.poll() is None
    daemon.stdin.close()  # as the kernel does for a program that was killed
    assert daemon.wait(PATIENCE_S) == 0
    daemon.stderr.close()
