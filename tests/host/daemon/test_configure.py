# SPDX-License-Identifier: MIT
"""A probe's name and log, changed by a command while the daemon runs."""

from __future__ import annotations

from pathlib import Path

import pytest

from chain import Chain
from imud.config import reader
from imud.daemon.configure import configured
from imud.errors import CommandRefused
from imud.log.seekable import SeekableLog
from streaming import until

PROBE_ID = "00112233445566aa"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "configure needs"),
        ({"log": "yes"}, "configure needs"),
        ({"rename": "a/b"}, "can't be part of a key, .*; try a-b"),
        ({"rename": "@Stylus 1"}, "; try Stylus-1"),
        ({"rename": ""}, "; try stylus"),
        ({"rename": "other"}, "is also the name of another probe"),
    ],
)
def test_what_the_file_may_not_have_is_refused(
    tmp_path: Path, given: dict[str, str], words: str
) -> None:
    path = tmp_path / "imud.toml"
    path.write_text('[probes.ffffffffffffffff]\nname = "other"\n')
    with pytest.raises(CommandRefused, match=words):
        configured(reader.load(path), PROBE_ID, given)


def test_no_log_is_started_where_none_is_kept() -> None:
    with pytest.raises(CommandRefused, match="writes no log"):
        configured(reader.load(None, is_logging=False), PROBE_ID, {"log": "on"})


def test_a_probe_is_renamed_and_its_log_stopped_meanwhile(chain: Chain) -> None:
    client, before = chain.client, chain.probe.name

    def log_of(name: str) -> str | None:
        found = client.statuses(name)
        return str(found[0]["log"]["state"]) if found else None

    for state in ("off", "on"):
        client.command(before, "configure", log=state)
        until(lambda state=state: log_of(before) == state)
    client.command(before, "configure", rename="stylus")
    until(lambda: log_of("stylus") == "on")
    heard = chain.hear("pose")
    chain.port.write(chain.probe.poses(1))
    assert b'"probe":"stylus"' in heard.get()
    client.command("stylus", "configure", rename="pen")
    until(lambda: log_of("pen") == "on")
    chain.daemon.stop()
    # The log goes on in its file, under every name.
    last = SeekableLog(max(chain.daemon.logs.glob("*.mcap")))
    assert [each.probe for each in last.of("pose")] == ["stylus"]
    assert {each.probe for each in last.of("status")} >= {"stylus", "pen"}
