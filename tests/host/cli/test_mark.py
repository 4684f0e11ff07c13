# SPDX-License-Identifier: MIT
"""A value from outside: marked by the command line, heard, logged, and in a table."""

from __future__ import annotations

import csv
import json
import time
from pathlib import Path
from typing import Any

import pytest

from chain import Chain
from imud import cli
from imud.params.value import Params

TIP = Params().replaced("tip", {"offset_m": (0.1, 0.0, 0.0), "sigma_m": 0.001})


def test_a_value_is_published_logged_and_exported(
    tmp_path: Path, chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["mark", chain.probe.name]
    network = ["--connect", chain.daemon.endpoint]
    heard = chain.hear("mark")
    assert cli.main([*words, "--note", "no pose yet", *network]) == 0
    assert "no pose at this moment" in capsys.readouterr().out
    assert json.loads(heard.get())["q"] is None

    chain.probe.params.records = TIP.encode()
    chain.port.write(chain.probe.say("hello"))
    chain.status_when(lambda status: status["params"]["digest"] is not None)
    poses = chain.hear("pose")
    mark: dict[str, Any] = {"position_m": None}
    while mark["position_m"] is None:  # on a busy machine the pose is too old
        chain.port.write(chain.probe.say("pose", position=(0.1, 0.0, 0.0)))
        pose = json.loads(poses.get())
        assert cli.main([*words, "-0.42", "--note", "=1+1", *network]) == 0
        said = capsys.readouterr().out
        mark = json.loads(heard.get())
    assert said.startswith(f"{chain.probe.name}: marked; tip at")
    assert (mark["value"], mark["text"]) == (-0.42, "=1+1")
    assert mark["position_m"] == pose["position_m"]
    assert mark["t_pose_ns"] == pose["t_ns"]

    # A probe that has stopped may have been moved since.
    time.sleep(1.1)  # a pose is too old after 1 s
    assert cli.main([*words, "--note", "too late", *network]) == 0
    assert "no pose at this moment" in capsys.readouterr().out
    assert json.loads(heard.get())["position_m"] is None

    for wrong in (["nan"], ["a"], [], ["1", "--note", "x" * 201]):
        assert cli.main([*words, *wrong, *network]) == 1
        assert "mark needs value=NUMBER or text=TEXT" in capsys.readouterr().err
    chain.daemon.stop()
    log = str(chain.daemon.log)
    assert cli.main(["export", log, "--out", str(tmp_path / "tables")]) == 0
    (path,) = (tmp_path / "tables").glob("**/*mark*.csv")
    with path.open() as file:
        note, *_, value, _ = csv.DictReader(file)
    assert (note["value"], note["text"], note["q_w"]) == ("", "no pose yet", "")
    assert value["value"] == "-0.42"
    assert value["text"] == "'=1+1"  # no formula for a spreadsheet
    assert float(value["position_x_m"]) == pytest.approx(0.1)
