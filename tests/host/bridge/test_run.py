# SPDX-License-Identifier: MIT
"""`imud bridge` as a process between a daemon and those who receive."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path
from typing import Any

import msgspec
import pytest
from pymavlink.dialects.v20 import common
from pythonosc.osc_bundle import OscBundle

from bridged import Broker, Follower, Receiver, needs_mosquitto
from configured import running
from fakes import DaemonProcess, FakeProbe, Forked, Port
from imud.bridge.run import Pace
from imud.cli import bridge, main
from imud.config.reader import load
from imud.config.settings import Config
from imud.errors import ConfigError
from streaming import Streaming


def said(receiver: Receiver, end: str) -> Any:
    """The value of the next message at an address that ends so."""
    while True:
        for message in OscBundle(receiver.hear()):
            if message.address.endswith(end):
                return message.params[0]


def expect_state(receiver: Receiver, state: str) -> None:
    while said(receiver, "/state") != state:
        pass


def test_a_bridge_tells_of_a_probe_that_leaves_and_a_daemon_that_dies(
    tmp_path: Path,
) -> None:
    file, probe, port = tmp_path / "imud.toml", FakeProbe(), Port(tmp_path / "port")
    with Receiver() as osc, Receiver() as link:
        file.write_text(
            f"[ports]\nfind = false\nnamed = ['{port.path}']\n"
            f"[osc]\nenabled = true\nto = '{osc.to}'\nrate_hz = 20\n"
            f"[mavlink]\nenabled = true\nto = '{link.to}'\n"
            f"[probes.{probe.name}]\nname = 'stylus'"
        )
        out, words = subprocess.PIPE, ["--config", str(file)]
        with DaemonProcess(*words, directory=tmp_path) as daemon:
            daemon.find(port, probe)
            port.write(probe.say("status"))
            words += ["--connect", daemon.endpoint]
            process = Forked("-m", "imud", "bridge", "all", *words, stderr=out)
            with Streaming(port, probe):
                expect_state(osc, "streaming")
                assert said(osc, "/stylus/sigma/heading") == 1.25
                parser = common.MAVLink(None)
                told = {
                    parser.parse_buffer(link.hear())[0].get_type() for _ in range(90)
                }
                assert told == {"HEARTBEAT", "ATTITUDE_QUATERNION_COV"}
            port.vanish()
            expect_state(osc, "gone")
        expect_state(osc, "away")  # it was killed
        port = Port(tmp_path / "port")
        with DaemonProcess(
            *words[:2], directory=tmp_path, endpoint=daemon.endpoint
        ) as again:
            again.find(port, probe)
            port.write(probe.say("status"))
            expect_state(osc, "streaming")
            port.vanish()
        process.send_signal(signal.SIGTERM)
        lines = process.communicate()[1].splitlines()
    assert process.returncode == 0, lines
    assert [line.split()[1] for line in lines[-2:]] == ["osc:", "mavlink:"]


@needs_mosquitto
def test_a_broker_tells_of_a_bridge_that_was_killed(tmp_path: Path) -> None:
    with (
        Broker(tmp_path, "allow_anonymous true") as broker,
        Follower(broker) as home,
        running(tmp_path, "") as (daemon, _, _),
    ):
        words = ["--to", f"{broker.host}:{broker.port}", "--connect", daemon.endpoint]
        process = Forked("-m", "imud", "bridge", "mqtt", *words)
        assert home.hear("imud/availability").payload == b"online"
        process.kill()
        process.wait()
        assert home.hear("imud/availability").payload == b"offline"


def test_a_pace_keeps_its_rate_for_each_probe() -> None:
    pace = Pace(50.0)
    due = [pace.is_due("a", number / 200) for number in range(400)]
    assert sum(due) == 100
    assert pace.is_due("b", 1.999)
    # After a pause it begins again, without making up for it.
    late = [pace.is_due("a", 10.0 + number / 200) for number in range(40)]
    assert sum(late) == 10
    assert all(Pace(0.0).is_due("a", 1.0) for _ in range(3))


def test_each_option_is_a_setting() -> None:
    for name, (_, options) in bridge.OUTPUTS.items():
        assert {*options} <= {*getattr(Config(), name).__struct_fields__}


def test_arguments_come_before_the_file(tmp_path: Path) -> None:
    file = tmp_path / "imud.toml"
    file.write_text("[osc]\nrate_hz = 30\nangles = 'aerospace'")
    given = {"rate_hz": 60.0, "to": None}
    config = load(file, changes={"osc": given, "bridge": {"connect": None}})
    assert config.osc == msgspec.structs.replace(
        Config().osc, rate_hz=60.0, angles="aerospace"
    )


@pytest.mark.parametrize(
    ("section", "values", "words"),
    [
        ("osc", {"to": "9000"}, "try 127.0.0.1:9000"),
        ("osc", {"angles": "xyz"}, 'not "aerospace" or "nautical"'),
        ("mqtt", {"topic": "a/#"}, "can't be part of a key"),
        ("mavlink", {"system": 0}, "0 is not a whole number from 1 to 170"),
        ("bridge", {"connect": "127.0.0.1"}, "try tcp/127.0.0.1:7447"),
    ],
)
def test_a_setting_that_cannot_be_is_refused(
    section: str, values: dict[str, object], words: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        load(None, changes={section: values})
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("words", "told", "code"),
    [
        (["all"], "no output is enabled", 78),
        (["osc", "--connect", "tcp/127.0.0.1:1"], "imud run", 1),
        (["osc", "--to", "nowhere.invalid:9000"], "[osc] to: nowhere.invalid:9000", 78),
    ],
)
def test_what_keeps_it_from_starting_is_one_line(
    words: list[str], told: str, code: int, capfd: pytest.CaptureFixture[str]
) -> None:
    before = {each: signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGINT)}
    try:
        assert main(["bridge", *words]) == code
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("imud: ")
    assert told in line
