# SPDX-License-Identifier: MIT
"""Names that people give to probes are kept, and never stop a daemon."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from configured import running
from fakes import PATIENCE_S, DaemonProcess
from imud import cli
from imud.client import Client
from imud.config import reader
from imud.daemon import names
from imud.errors import FileError
from imud.params.value import Params
from streaming import Streaming, until

PROBE_ID = "00112233445566aa"


def name_of(daemon: DaemonProcess) -> str:
    with Client(daemon.endpoint) as client:
        return client.wait_for(seconds=PATIENCE_S)


def given(daemon: DaemonProcess, before: str, name: str) -> int:
    return cli.main(["name", before, name, "--connect", daemon.endpoint])


def test_a_name_is_kept_over_a_restart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with running(tmp_path, "") as (daemon, _, _):
        assert given(daemon, name_of(daemon), "stylus") == 0
        out = capsys.readouterr().out
        assert out.startswith(f"{PROBE_ID} is now called stylus\nother hosts don't")
        assert name_of(daemon) == "stylus"
        assert given(daemon, "stylus", "a/b") == 1
        assert "can't be part of a key" in capsys.readouterr().err
        assert given(daemon, "nobody", "other") == 1
        assert "no probe nobody;" in capsys.readouterr().err
        daemon.stop()
    with running(tmp_path, "") as (daemon, _, _):
        assert name_of(daemon) == "stylus"
        daemon.stop()


def test_the_configuration_goes_before_a_name_that_was_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    named = f'[probes.{PROBE_ID}]\nname = "bench"\n'
    with running(tmp_path, named) as (daemon, _, _):
        assert given(daemon, "bench", "stylus") == 0
        assert "another name for it" in capsys.readouterr().out
        assert name_of(daemon) == "stylus"
        daemon.stop()
    with running(tmp_path, named) as (daemon, _, _):
        assert name_of(daemon) == "bench"
        daemon.stop()


def test_a_folder_that_takes_no_file_refuses_the_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    memory = tmp_path / "file" / "ports.json"
    memory.parent.write_text("")
    with running(tmp_path, f"memory = '{memory}'\n") as (daemon, _, _):
        assert given(daemon, PROBE_ID, "stylus") == 1
        error = capsys.readouterr().err
        assert "can't " in error
        assert "names.json" in error
        assert name_of(daemon) == PROBE_ID
        daemon.stop()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"no JSON", "is damaged"),
        (b'{"00112233445566aa": 5}', "is damaged"),
        (b'{"00112233445566aa": "a/b"}', "can't be part of a key"),
        (b'{"00112233445566aa": "other"}', "is also the name of another probe"),
    ],
)
def test_a_file_that_is_damaged_is_told_and_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, data: bytes, words: str
) -> None:
    path = tmp_path / "imud.toml"
    path.write_text(
        f"[ports]\nmemory = '{tmp_path}/ports.json'\n"
        '[probes.ffffffffffffffff]\nname = "other"\n'
    )
    config = reader.load(path)
    names.path_of(config).write_bytes(data)
    assert names.with_names(config) == config
    assert words in caplog.text


def test_what_is_kept_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "imud.toml"
    path.write_text(f"[ports]\nmemory = '{tmp_path}/ports.json'\n")
    config = reader.load(path)
    names.keep(config, PROBE_ID, "stylus")
    names.keep(config, "ffffffffffffffff", "arm")
    names.keep(config, PROBE_ID, "pen")
    assert json.loads(names.path_of(config).read_bytes()) == {
        PROBE_ID: "pen",
        "ffffffffffffffff": "arm",
    }
    found = names.with_names(config)
    assert found.name_of(PROBE_ID) == "pen"
    assert found.name_of("ffffffffffffffff") == "arm"
    assert names.with_names(config, {PROBE_ID: "tip"}).name_of(PROBE_ID) == "pen"
    names.path_of(config).write_text("{")
    with pytest.raises(FileError, match="remove it"):
        names.keep(config, PROBE_ID, "other")


def until_called(daemon: DaemonProcess, name: str) -> None:
    with Client(daemon.endpoint) as client:
        until(lambda: [each["probe"] for each in client.statuses()] == [name])


def test_a_name_goes_with_the_probe_to_other_hosts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    records = b""
    other = '[probes.ffffffffffffffff]\nname = "stylus"\n'
    hosts = {"first": "", "second": "", "third": other}
    calls = {"second": "stylus", "third": PROBE_ID}
    for folder, text in hosts.items():
        (tmp_path / folder).mkdir()
        with running(tmp_path / folder, text) as (daemon, probe, port):
            probe.params.records = records
            with Streaming(port, probe, say=lambda p=port, a=probe: p.answers(a)):
                if folder == "first":
                    with Client(daemon.endpoint) as client:
                        until(lambda c=client: c.statuses()[0]["params"]["is_known"])
                    assert given(daemon, PROBE_ID, "é" * 13) == 0
                    assert "more than 24" in capsys.readouterr().out
                    assert given(daemon, "é" * 13, "stylus") == 0
                    assert capsys.readouterr().out.endswith("called stylus\n")
                    records = probe.params.records
                    assert Params.decode(records).name == "stylus"
                else:
                    port.write(probe.say("hello"))
                    until_called(daemon, calls[folder])
                if folder == "third":
                    daemon.expect("params: .* also the name of another probe")
