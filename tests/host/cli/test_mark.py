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
from imud.config import reader
from imud.daemon.hub import Hub
from imud.daemon.intake import Intake
from imud.journal.output import Journal
from imud.log.marks import marks_in
from imud.params.value import Params

TIP = Params().replaced("tip", {"offset_m": (0.1, 0.0, 0.0), "sigma_m": 0.001})


def exported(log: str, folder: Path) -> list[dict[str, str]]:
    assert cli.main(["export", log, "--out", str(folder)]) == 0
    (path,) = folder.glob("**/*mark*.csv")
    with path.open() as file:
        return [*csv.DictReader(file)]


def recalled(log: str, probe_id: str) -> list[dict[str, Any]]:
    """The marks as another daemon has them that logs into this folder."""
    intake = Intake(reader.load(None, is_logging=False), Hub(), Journal(1.0, 1))
    intake.recall(marks_in(Path(log).parent))
    return intake.marks.of(probe_id)


def check_rows(rows: list[dict[str, str]], corrected_id: str, late_id: str) -> None:
    """What was exported."""
    note, *_, value, corrected, _, withdrawn = rows
    assert corrected["value"] + corrected["unit"] == "0.43N"
    assert withdrawn["state"] == "withdrawn"
    assert (corrected["id"], withdrawn["id"]) == (corrected_id, late_id)
    assert corrected["position_x_m"] == value["position_x_m"]
    assert (note["value"], note["text"], note["q_w"]) == ("", "no pose yet", "")
    assert value["value"] == "-0.42"
    assert value["text"] == "'=1+1"  # no formula for a spreadsheet
    assert float(value["position_x_m"]) == pytest.approx(0.1)


def test_a_value_is_published_logged_and_exported(
    tmp_path: Path,
    chain: Chain,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
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

    change = ["0.43", "--unit", "N", "--id", mark["id"], *network]
    assert cli.main([*words, *change]) == 0
    again = json.loads(heard.get())
    changed = {"value": 0.43, "unit": "N", "state": "corrected", "t_ns": again["t_ns"]}
    assert again == mark | changed
    (reply,) = chain.client.session.get(f"imud/{chain.probe.name}/marks")
    assert json.loads(reply.ok.payload.to_bytes())["marks"][-1]["value"] == 0.43

    # A probe that has stopped may have been moved since.
    time.sleep(1.1)  # a pose is too old after 1 s
    assert cli.main([*words, "--note", "too late", *network]) == 0
    assert "no pose at this moment" in capsys.readouterr().out
    late = json.loads(heard.get())
    assert late["position_m"] is None
    back = [*words, "--id", late["id"], "--withdraw", *network]
    assert (cli.main(back), cli.main(back)) == (0, 1)
    assert f"has no mark {late['id']}" in capsys.readouterr().err

    for wrong in (["nan"], ["a"], [], ["1", "--note", "x" * 201]):
        assert cli.main([*words, *wrong, *network]) == 1
        assert "mark needs value=NUMBER or text=TEXT" in capsys.readouterr().err
    chain.daemon.stop()
    log = str(chain.daemon.log)
    check_rows(exported(log, tmp_path / "tables"), again["id"], late["id"])
    Path(log).with_name("imud-20000101T000000Z.mcap").write_bytes(b"no log")
    Path(log).with_name("imud-21000101T000000Z.mcap").touch()  # has just begun
    kept = recalled(log, chain.probe.name)
    assert [each.getMessage()[:30] for each in caplog.records].count(
        "log: marks of earlier logs are"
    ) == 1
    assert (kept[0]["text"], kept[-1]["value"]) == ("no pose yet", 0.43)
