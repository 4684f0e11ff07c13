# SPDX-License-Identifier: MIT
"""`imud run` as a process: a fake probe on a pty, subscribers on loopback."""

from __future__ import annotations

import fcntl
import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

import reference
from fakes import (
    EQUIPMENT,
    PATIENCE_S,
    DaemonProcess,
    FakeProbe,
    Port,
    free_endpoint,
    status_of,
)
from imud import _core, cli
from imud.client import Client
from imud.daemon.commands import arguments_of
from imud.errors import CommandRefused, DaemonNotFound, NoReply, ProbeUnknown
from imud.journal import phrases
from imud.journal.speaker import Limiter
from imud.log.reader import Logged, read_log
from imud.probes import record
from imud.probes.session import Session
from imud.sinks import log
from imud.wire import messages, schema
from imud.wire.messages import Message

KINDS = ("pose", "raw", "event", "status", "frame")


class Chain:
    """A probe, its port, a daemon that found it, and a client of that daemon."""

    def __init__(
        self,
        directory: Path,
        *arguments: object,
        prefix: str = "imud",
        program: tuple[str, ...] = ("-m", "imud"),
    ) -> None:
        self.probe = FakeProbe()
        self.port = Port(directory / "port")
        self.daemon = DaemonProcess(
            self.port.path, *arguments, directory=directory, program=program
        )
        self.daemon.expect("listens on")
        self.port.wait_open()
        self.port.write(self.probe.say("hello"))
        self.daemon.expect("found on")
        self.client = Client(self.daemon.endpoint, prefix)
        self.client.wait_for(seconds=PATIENCE_S)

    def hear(self, topic: str) -> queue.Queue[bytes]:
        """What is published on a topic from here on, surely from its next message."""
        heard: queue.Queue[bytes] = queue.Queue()
        self.client.subscribe(topic, None, lambda _, payload: heard.put(payload))
        return heard

    def command(self, name: str, **arguments: str) -> dict[str, Any]:
        """A command, while the probe answers it on its side."""
        server = threading.Thread(target=self.port.serve, args=(self.probe, 1))
        server.start()
        try:
            return self.client.command(self.probe.name, name, **arguments)
        finally:
            server.join(PATIENCE_S)

    def status_when(self, is_so: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first status from here on of which that is true."""
        heard = self.hear("status")
        while True:
            status: dict[str, Any] = json.loads(heard.get(timeout=PATIENCE_S))
            if is_so(status):
                return status

    def close(self) -> None:
        self.client.close()
        self.daemon.__exit__(None, None, None)
        self.port.vanish()


@pytest.fixture
def chain(tmp_path: Path) -> Iterator[Chain]:
    made = Chain(tmp_path)
    yield made
    made.close()


def drain(heard: queue.Queue[bytes], last: bytes) -> list[bytes]:
    found = [heard.get(timeout=PATIENCE_S)]
    while found[-1] != last:
        found.append(heard.get(timeout=PATIENCE_S))
    return found


def subscribed(chain: Chain, topic: str) -> queue.Queue[bytes]:
    """Subscribes, and waits until the daemon knows: a sample comes."""
    heard = chain.hear(topic)
    name = {"frame": "pose"}.get(topic, topic)
    while heard.empty():
        chain.port.write(chain.probe.say(name))
        try:
            heard.get(timeout=0.2)
        except queue.Empty:
            continue
        break
    return heard


def test_poses_and_frames_reach_a_subscriber_whole_and_in_order(chain: Chain) -> None:
    poses, frames = subscribed(chain, "pose"), subscribed(chain, "frame")
    sent = [chain.probe.content("pose") for _ in range(500)]
    chain.port.write(b"".join(_core.encode_frame(schema.SEED, c) for c in sent))
    got = drain(frames, sent[-1])[-500:]
    assert got == sent
    first = chain.probe.sequence - 500
    while True:
        pose = json.loads(poses.get(timeout=PATIENCE_S))
        if pose["seq"] >= first:
            break
    for number in range(first, first + 500):
        assert pose["seq"] == number
        assert list(pose) == [
            "type",
            "probe",
            "seq",
            "number",
            "missing",
            "t_device_us",
            "t_ns",
            "t_bound_us",
            "age_us",
            "q",
            "position_m",
            "normal",
            "tilt_sigma_deg",
            "heading_sigma_deg",
            "flags",
        ]
        assert pose["t_device_us"] == number * 5000
        if number < first + 499:
            pose = json.loads(poses.get(timeout=PATIENCE_S))


def test_raw_and_events_have_keys_of_their_own(chain: Chain) -> None:
    raw = json.loads(subscribed_first(chain, "raw"))
    assert raw["acc_counts"] == [0, -16, 2048]
    assert raw["mag_uT"] == pytest.approx([1.5, -3.0, 45.0])
    event = json.loads(subscribed_first(chain, "event"))
    assert (event["event"], event["cause"]) == ("stream_started", "button")
    chain.daemon.expect("stream started \\(button\\)")


def subscribed_first(chain: Chain, topic: str) -> bytes:
    heard = chain.hear(topic)
    while True:
        chain.port.write(chain.probe.say(topic))
        try:
            return heard.get(timeout=0.2)
        except queue.Empty:
            continue


def logged(status: dict[str, Any]) -> int:
    """Messages of the probe itself that are in the log."""
    by_topic = status["ledger"]["logged"]
    own = ("hello", "reply", "pose", "raw", "event")
    return sum(by_topic.get(topic, 0) for topic in own)


def test_the_ledger_of_the_status_adds_up(chain: Chain) -> None:
    probe = chain.probe
    doubled = probe.say("pose")
    lost = probe.say("pose")
    flipped = bytearray(probe.say("pose"))
    flipped[-8] ^= 0x10
    (content,) = reference.contents(probe.say("pose"))
    torn = _core.encode_frame(schema.SEED, content[:-3])
    chain.port.write(doubled * 2 + bytes(flipped) + torn + probe.poses(10))
    assert lost
    status = chain.status_when(
        lambda s: (s["ledger"]["published"].get("pose"), logged(s)) == (11, 12)
    )
    ledger = status["ledger"]
    assert ledger["sent"] == 15  # hello, four that were struck, ten
    assert ledger["received"] == 12
    assert ledger["lost"] == 2
    assert ledger["skewed"] == {"missing": 1}
    assert (ledger["duplicated"], ledger["corrupt"]) == (1, 1)
    assert ledger["dropped"] == {"log": 0, "zenoh": 0}
    assert ledger["sent"] == (
        ledger["received"] + sum(ledger["skewed"].values()) + ledger["lost"]
    )
    chain.daemon.expect("skewed message \\(missing\\): pose: pose_flags is missing")
    chain.daemon.expect("2 lost, 1 corrupt, 1 duplicated")
    assert status["hello"]["firmware"] == "0.1.0+fake"
    assert status["state"] == "unknown"  # it said no status yet
    chain.port.write(probe.say("status", state="idle"))
    status = chain.status_when(lambda s: s["state"] != "unknown")
    assert (status["state"], status["counters"]["uptime"]) == ("idle", 5)


def test_late_joiners_ask_for_status_and_see_who_is_alive(chain: Chain) -> None:
    frames = subscribed(chain, "frame")
    content = chain.probe.content("status")
    chain.port.write(_core.encode_frame(schema.SEED, content))
    drain(frames, content)
    status = status_of(chain.client)
    assert status["probe"] == chain.probe.name
    assert chain.client.alive() == [chain.probe.name]
    assert chain.client.only_probe() == chain.probe.name
    with pytest.raises(ProbeUnknown, match="no probe stylus is there; name one: 0011"):
        chain.client.only_probe("stylus")


def test_who_waits_finds_a_probe_that_its_history_left_out(
    chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Forgetful:
        """A session whose subscribers hear nothing of who is there already."""

        def __init__(self, session: zenoh.Session) -> None:
            self._session = session

        def liveliness(self) -> Forgetful:
            return self

        def get(self, key: str, *, timeout: float) -> object:
            return self._session.liveliness().get(key, timeout=timeout)

        def declare_subscriber(
            self, key: str, on_token: Callable[[zenoh.Sample], None], *, history: bool
        ) -> object:
            assert history
            return self._session.liveliness().declare_subscriber(key, on_token)

    chain.client.wait_for(chain.probe.name)
    monkeypatch.setattr(chain.client, "_session", Forgetful(chain.client.session))
    assert chain.client.wait_for(chain.probe.name) == chain.probe.name
    assert chain.client.wait_for() == chain.probe.name
    with pytest.raises(ProbeUnknown, match=r"no probe stylus came in 0\.6 s; plug it"):
        chain.client.wait_for("stylus", seconds=0.6)


@pytest.mark.parametrize(
    ("name", "arguments", "numbers"),
    [
        ("start", {}, (0, 0)),
        ("stop", {}, (0, 0)),
        ("tare", {}, (0, 0)),
        ("tare", {"what": "heading"}, (1, 0)),
        ("tare", {"what": "undo"}, (2, 0)),
        ("rate", {"stream": "raw", "hz": "200"}, (1, 200)),
        ("fields", {"streams": "pose,raw"}, (3, 0)),
        ("hello", {}, (0, 0)),
        ("reset", {}, (0, 0)),
        ("restart", {}, (0, 0)),
        ("restart", {"filter": "madgwick"}, (4, 0)),
    ],
)
def test_commands_become_two_numbers(
    name: str, arguments: dict[str, str], numbers: tuple[int, int]
) -> None:
    assert arguments_of(name, arguments) == numbers


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("start", {"fast": "1"}, "start knows no fast"),
        ("tare", {"what": "all of it"}, "tare needs what=all, heading or undo"),
        ("rate", {"stream": "pose"}, "rate needs stream"),
        ("rate", {"stream": "pose", "hz": "fast"}, "rate needs stream"),
        ("fields", {"streams": "mag"}, "fields needs streams"),
        ("restart", {"filter": "none"}, "restart needs filter=fuse, complementary"),
        ("restart", {"with": "fuse"}, "restart knows no with"),
    ],
)
def test_commands_that_make_no_sense_are_refused(
    name: str, arguments: dict[str, str], words: str
) -> None:
    with pytest.raises(CommandRefused, match=words):
        arguments_of(name, arguments)


def test_a_command_reaches_the_probe_and_its_answer_comes_back(chain: Chain) -> None:
    answer = chain.command("tare", what="heading")
    assert answer == {
        "ok": True,
        "probe": chain.probe.name,
        "command": "tare",
        "value": [1, 0],
    }
    assert chain.probe.commands[-1]["arguments"] == (1, 0)


def test_a_refusal_says_why(chain: Chain) -> None:
    chain.probe.results["start"] = "not_ready"
    with pytest.raises(CommandRefused, match="refused start: not ready"):
        chain.command("start")
    with pytest.raises(CommandRefused, match="no command 'dance', only fields, hello"):
        chain.client.command(chain.probe.name, "dance")
    with pytest.raises(CommandRefused, match="arguments can't be"):
        chain.client.command(chain.probe.name, "rate", stream="pose", hz="99999999999")
    with pytest.raises(NoReply, match="nobody answered start for probe stylus"):
        chain.client.command("stylus", "start")


def orders(data: bytes) -> list[Message]:
    """Commands among what the daemon wrote, but for questions for the time."""
    said = [messages.decode(content) for content in reference.contents(data)]
    assert all(isinstance(each, Message) for each in said)
    return [
        each
        for each in said
        if isinstance(each, Message) and each.fields["command"] != "time"
    ]


def test_a_command_is_repeated_with_its_token_and_carried_out_once(
    chain: Chain,
) -> None:
    heard: list[Message] = []

    def be_deaf_once() -> None:
        while len(heard) < 2:
            data = chain.port.read()
            said = chain.probe.hear(data)
            heard.extend(orders(data))
        chain.port.write(said)

    server = threading.Thread(target=be_deaf_once)
    server.start()
    answer = chain.client.command(chain.probe.name, "start")
    server.join(PATIENCE_S)
    assert answer["ok"]
    assert [c["command"] for c in chain.probe.commands] == ["start"]
    assert len({order.fields["token"] for order in heard}) == 1


def test_a_probe_that_does_not_answer_is_an_error_after_three_tries(
    chain: Chain,
) -> None:
    with pytest.raises(CommandRefused, match="did not answer stop, 3 times"):
        chain.client.command(chain.probe.name, "stop")
    asked = [order.fields["command"] for order in orders(chain.port.read())]
    assert asked == ["stop"] * 3


@pytest.mark.parametrize("by", [signal.SIGTERM, signal.SIGINT])
def test_it_stops_within_a_second_and_finishes_its_log(
    chain: Chain, by: signal.Signals
) -> None:
    sent = [chain.probe.content("pose") for _ in range(50)]
    chain.port.write(b"".join(_core.encode_frame(schema.SEED, c) for c in sent))
    chain.port.write(chain.probe.say("event"))
    chain.daemon.expect("stream started")
    seconds = chain.daemon.stop(by)
    assert seconds < 1.0
    assert (
        "stopped; probe 00112233445566aa: 52 received, 0 lost"
        in (chain.daemon.lines[-1])
    )
    decoded = subprocess.run(
        [sys.executable, "-m", "imud", "decode", str(chain.daemon.log), "--json"],
        check=True,
        capture_output=True,
        text=True,
    )
    items = [json.loads(line) for line in decoded.stdout.splitlines()]
    assert [i["seq"] for i in items] == list(range(chain.probe.sequence))
    assert "52 sent = 52 received" in decoded.stderr
    assert "ends without" not in decoded.stderr


# A slow end of the interpreter, as on a busy machine, and a callback of Zenoh's that
# returns only in it.
LATE = """
import runpy, sys, time
from imud.sinks.zenoh import ZenohSink

class Slow:
    def __del__(self):
        time.sleep(2)

def tell_late(sink, probe, query):
    sys.stderr.write("asked\\n")
    while not sys.is_finalizing():
        time.sleep(0.01)

sys.slow = Slow()
ZenohSink._tell_status = tell_late
runpy.run_module("imud", run_name="__main__")
"""

# A disk that takes what is written and never says that it has it.
STUCK_DISK = """
import os, runpy, threading, time

def never(descriptor):
    os.write(2, b"stuck\\n")
    threading.Event().wait()

os.fdatasync = never
runpy.run_module("imud", run_name="__main__")
"""


def test_a_callback_of_zenohs_that_is_late_does_not_abort_the_end(
    tmp_path: Path,
) -> None:
    made = Chain(tmp_path, program=("-c", LATE))
    asker = threading.Thread(target=made.client.statuses)
    asker.start()
    made.daemon.expect("asked")
    assert made.daemon.stop() < 1.0
    assert "stopped; probe 00112233445566aa: 1 received" in made.daemon.lines[-1]
    asker.join()
    made.close()


def test_a_disk_that_is_stuck_holds_up_the_end_only_so_long_and_costs_nothing(
    tmp_path: Path,
) -> None:
    made = Chain(tmp_path, program=("-c", STUCK_DISK))
    made.daemon.expect("stuck")
    made.port.write(made.probe.poses(20) + made.probe.say("event"))
    made.daemon.expect("stream started")
    assert made.daemon.stop() < log.PATIENCE_S + 1.0
    assert "log did not finish in time" in "\n".join(made.daemon.lines)
    frames = [m for m in read_log(made.daemon.log) if isinstance(m, Logged)]
    assert sum(m.topic == "frame" for m in frames) == made.probe.sequence
    made.close()


def test_a_probe_has_the_name_that_the_configuration_gives_it(tmp_path: Path) -> None:
    file = tmp_path / "imud.toml"
    file.write_text(
        '[zenoh]\nprefix = "lab/a"\n[probes.00112233445566aa]\nname = "stylus"\n'
    )
    made = Chain(tmp_path, "--config", file, prefix="lab/a")
    try:
        assert made.client.only_probe("stylus") == "stylus"
        with pytest.raises(ProbeUnknown, match=r"no probe needle came in 0\.1 s"):
            made.client.wait_for("needle", seconds=0.1)
    finally:
        made.close()


# The twin.


@pytest.fixture
def twinned(tmp_path: Path) -> Iterator[Chain]:
    made = Chain(tmp_path, "--twin")
    yield made
    made.close()


class Truth:
    """Samples of a fake probe and the poses that a true one makes of them."""

    def __init__(self, probe: FakeProbe) -> None:
        self.probe = probe
        hello = messages.encode("hello", probe.hello_fields, 0, 0)
        self.replay = _core.Replay(hello)
        self.time_us = probe.time_us

    def sample(self, flip: int = 0) -> bytes:
        """A raw message and a pose, of whose x some bits are flipped."""
        probe, time_us = self.probe, self.time_us
        probe.time_us = time_us  # whatever else was said since the last one
        self.time_us += 5000
        raw = probe.content("raw", gyr=(time_us // 5000 % 7, -3, 2))
        self.replay.step(raw)
        pose = bytearray(self.replay.pose(probe.sequence, time_us))
        pose[14] ^= flip
        probe.sequence += 1
        contents = (raw, bytes(pose))
        return b"".join(_core.encode_frame(schema.SEED, each) for each in contents)


def twin_when(chain: Chain, is_so: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    found: dict[str, Any] = chain.status_when(lambda s: is_so(s["twin"]))["twin"]
    return found


def test_the_twin_asks_follows_tells_a_difference_and_a_loss(
    twinned: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    chain, probe, port = twinned, twinned.probe, twinned.port
    truth = Truth(probe)
    told = chain.hear("twin")
    # It asks for a raw message a sample, then for a beginning.
    port.write(probe.say("pose"))
    port.serve(probe, commands=2)
    asked = [(c["command"], c["arguments"]) for c in probe.commands]
    assert asked == [("rate", (1, 200)), ("fields", (3, 0))]
    port.write(truth.sample() + truth.sample())
    port.serve(probe, commands=1)
    assert probe.commands[-1]["command"] == "restart"
    began = probe.sequence - 2
    chain.daemon.expect(f"its twin follows from #{began} on$")
    truth.replay.restart(schema.Filter.FUSE)
    port.write(b"".join(truth.sample() for _ in range(100)))
    tare = chain.command("tare", what="heading")
    assert tare["ok"]
    truth.replay.origin(1)
    port.write(b"".join(truth.sample() for _ in range(100)))
    twin = twin_when(chain, lambda t: t["compared"] == 200)
    assert twin == {
        **{"state": "following", "compared": 200, "differed": 0},
        **{"lost": None, "first_difference": None},
    }
    # It tells the first pose that differs, and counts the others.
    struck = probe.sequence + 1
    port.write(truth.sample(flip=1) + truth.sample() + truth.sample(flip=2))
    chain.daemon.expect(f"pose #{struck} is not what its samples give: q differ$")
    twin = twin_when(chain, lambda t: t["compared"] == 203)
    assert (twin["state"], twin["differed"]) == ("differs", 2)
    first = twin["first_difference"]
    assert (first["seq"], first["fields"]) == (struck, ["q"])
    said, computed = (bytes.fromhex(first[name]) for name in ("probe", "twin"))
    assert said[14] ^ computed[14] == 1
    assert said[:14] + said[15:] == computed[:14] + computed[15:]
    assert cli.main(["list", "--connect", chain.daemon.endpoint]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[0].endswith("  twin")
    assert shown[1].endswith("  differs, 2 of 203")
    # A loss is none.
    lost = probe.sequence
    assert truth.sample()
    port.write(truth.sample() + truth.sample())
    chain.daemon.expect(f"its twin can't follow from #{lost} on: a message is missing")
    twin = twin_when(chain, lambda t: t["state"] == "lost")
    assert (twin["lost"]["seq"], twin["differed"]) == (lost, 2)
    # A restart by whomever begins anew.
    assert chain.command("restart")["ok"]
    chain.daemon.expect("its twin follows from")
    assert twin_when(chain, lambda t: t["state"] == "following")["lost"] is None
    states = [json.loads(told.get(timeout=PATIENCE_S)) for _ in range(4)]
    assert [each["state"] for each in states] == [
        *("following", "differs", "lost", "following")
    ]
    assert states[1]["seq"] == struck
    assert states[1]["first_difference"] == first
    chain.daemon.stop()
    assert "2 of 203 poses differ" in chain.daemon.lines[-1]


def test_a_twin_that_is_not_served_says_so_once(twinned: Chain) -> None:
    chain = twinned
    chain.probe.results["fields"] = "not_ready"
    for _ in range(2):
        chain.port.write(chain.probe.say("pose"))
    chain.port.serve(chain.probe, commands=2)
    chain.daemon.expect("its twin can't begin: probe .* refused fields: not ready")
    assert twin_when(chain, lambda _: True)["state"] == "waiting"
    chain.daemon.stop()
    assert sum("can't begin" in line for line in chain.daemon.lines) == 1


def test_no_twin_is_off(chain: Chain) -> None:
    assert twin_when(chain, lambda _: True)["state"] == "off"


# What goes wrong with a port: one clear line each, and the daemon goes on.


def test_an_absent_port_is_told_once_and_taken_up_when_it_comes(
    tmp_path: Path,
) -> None:
    with DaemonProcess(tmp_path / "port", directory=tmp_path, log=False) as process:
        process.expect("port does not exist; it is opened when it appears")
        probe, port = FakeProbe(), Port(tmp_path / "port")
        process.expect(": open$")
        port.write(probe.say("hello"))
        process.expect("found on")
        process.stop()
        port.vanish()
        assert sum("does not exist" in line for line in process.lines) == 1


def test_a_port_that_vanishes_is_told_once_and_counted_over(tmp_path: Path) -> None:
    made = Chain(tmp_path)
    made.port.write(made.probe.poses(5) + made.probe.say("event"))
    made.daemon.expect("stream started")
    made.port.vanish()
    made.daemon.expect("port vanished; it is opened when it is back")
    made.probe.poses(4)
    made.port = Port(made.port.path)
    made.daemon.expect(": open$")
    made.port.write(made.probe.say("hello"))
    made.daemon.expect("found on")
    status = made.status_when(lambda s: s["port"] is not None)
    assert status["ledger"]["lost"] == 4
    made.daemon.stop()
    made.close()
    lines = [line for line in made.daemon.lines if "port" in line]
    assert sum("vanished" in line for line in lines) == 1
    assert sum("does not exist" in line for line in lines) == 0


def test_a_busy_port_is_told_once_and_taken_up_when_it_is_free(tmp_path: Path) -> None:
    port = Port(tmp_path / "port")
    holder = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    with DaemonProcess(port.path, directory=tmp_path, log=False) as process:
        process.expect("port is in use by another program")
        fcntl.flock(holder, fcntl.LOCK_UN)
        process.expect(": open$")
        process.stop()
        assert sum("in use by" in line for line in process.lines) == 1
    os.close(holder)
    port.vanish()


def test_a_file_that_is_no_port_is_told_once(tmp_path: Path) -> None:
    file = tmp_path / "port"
    file.touch()
    with DaemonProcess(file, directory=tmp_path, log=False) as process:
        process.expect("port can't be opened: is it a serial port\\?")
        process.stop()
        assert sum("serial port" in line for line in process.lines) == 1


def test_a_stream_of_noise_is_told_once_and_ends_nothing(tmp_path: Path) -> None:
    port, probe = Port(tmp_path / "port"), FakeProbe()
    with DaemonProcess(port.path, directory=tmp_path, log=False) as process:
        process.expect("listens on")
        port.wait_open()
        noise = bytes(range(1, 256)) * 2
        port.write(noise)
        process.expect("510 bytes without a valid message; is it a probe at 500000")
        port.write(noise + b"\0" + probe.say("hello"))
        process.expect("found on")
        process.stop()
        assert sum("without a valid message" in line for line in process.lines) == 1
    port.vanish()


def test_a_probe_of_another_schema_is_told_once_and_listed(tmp_path: Path) -> None:
    port = Port(tmp_path / "port")
    probe = FakeProbe(
        schema_fingerprint=schema.FINGERPRINT ^ 0x1234, firmware="0.0.9+old"
    )
    with DaemonProcess(port.path, directory=tmp_path, log=False) as process:
        process.expect("listens on")
        port.wait_open()
        for _ in range(20):
            content = probe.content("pose")
            port.write(_core.encode_frame(schema.SEED ^ 0x1234, content))
            port.write(probe.say("hello"))
        line = process.expect("speaks schema")
        assert f"{schema.FINGERPRINT ^ 0x1234:#010x} (firmware 0.0.9+old)" in line
        assert "update one of them" in line
        with Client(process.endpoint) as client:
            heard: queue.Queue[bytes] = queue.Queue()
            client.subscribe("status", None, lambda _, payload: heard.put(payload))
            status = json.loads(heard.get(timeout=PATIENCE_S))
            assert status["state"] == "other schema"
            assert status["hello"]["firmware"] == "0.0.9+old"
            assert status["link"]["corrupt"] == 0
            assert status["link"]["foreign"] + status["link"]["partial"] == 20
            with pytest.raises(CommandRefused, match="speaks another schema"):
                client.command(probe.name, "start")
        process.stop()
        assert sum("speaks schema" in line for line in process.lines) == 1
        assert not any("corrupt" in line for line in process.lines)
    port.vanish()


def test_two_daemons_on_one_endpoint_are_told_apart(chain: Chain) -> None:
    second = subprocess.run(
        [
            *(sys.executable, "-m", "imud", "run", "/dev/none", "--no-log"),
            *("--listen", chain.daemon.endpoint),
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )
    assert second.returncode == 1
    (line,) = second.stderr.splitlines()
    assert line.startswith(f"imud: can't listen on {chain.daemon.endpoint}")


# What users see.


def test_listen_prints_what_is_published_and_sums_up(
    chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    stop = threading.Event()

    def stream() -> None:
        while not stop.wait(0.005):
            chain.port.write(chain.probe.say("pose"))

    streamer = threading.Thread(target=stream)
    streamer.start()
    connect = ["--connect", chain.daemon.endpoint]
    try:
        assert cli.main(["listen", "--seconds", "0.6", "--json", *connect]) == 0
        printed = capsys.readouterr()
        assert cli.main(["listen", chain.probe.name, "--seconds", "2.5", *connect]) == 0
        shown = capsys.readouterr()
        assert cli.main(["list", *connect]) == 0
        listed = capsys.readouterr()
    finally:
        stop.set()
        streamer.join()
    poses = [json.loads(line) for line in printed.out.splitlines()]
    first, count = poses[0]["seq"], len(poses)
    assert [pose["seq"] for pose in poses] == list(range(first, first + count))
    assert f"{count} poses received" in printed.err
    assert "0 messages missing by sequence" in printed.err
    lines = shown.out.splitlines()
    assert lines[0].split()[:4] == ["probe", "yaw", "pitch", "roll"]
    assert lines[1].startswith(chain.probe.name)
    assert "at_rest" in lines[1]
    assert "0 messages missing by sequence" in lines[-2]
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
    server = threading.Thread(target=chain.port.serve, args=(chain.probe, 1))
    server.start()
    assert cli.main(["tare", "--undo", "--connect", chain.daemon.endpoint]) == 0
    server.join(PATIENCE_S)
    assert capsys.readouterr().out == f"{chain.probe.name}: tare done\n"
    assert chain.probe.commands[-1]["arguments"] == (2, 0)


def test_restart_from_the_command_line(
    chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    connect = ["--connect", chain.daemon.endpoint]
    server = threading.Thread(target=chain.port.serve, args=(chain.probe, 1))
    server.start()
    assert cli.main(["restart", "--filter", "mahony", *connect]) == 0
    server.join(PATIENCE_S)
    assert capsys.readouterr().out == f"{chain.probe.name}: restart done\n"
    assert chain.probe.commands[-1]["arguments"] == (3, 0)
    chain.probe.results["restart"] = "bad_argument"
    server = threading.Thread(target=chain.port.serve, args=(chain.probe, 1))
    server.start()
    assert cli.main(["restart", "--filter", "dcm_pi", *connect]) == 1
    server.join(PATIENCE_S)
    assert capsys.readouterr().err == (
        f"imud: probe {chain.probe.name} has no filter dcm_pi: its firmware was built "
        "without it and runs fuse\n"
    )


def test_no_pose_is_one_line(chain: Chain, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["listen", "--seconds", "0.2", "--connect", chain.daemon.endpoint]
    assert cli.main(arguments) == 1
    assert capsys.readouterr().err == (
        "imud: no pose came; is a probe streaming? imud list, and imud start\n"
    )


@pytest.mark.parametrize("command", ["listen", "list", "start"])
def test_no_daemon_is_one_line(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    endpoint = free_endpoint()
    assert cli.main([command, "--connect", endpoint]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"imud: no imud at {endpoint}; start one with imud run")


def test_an_endpoint_that_is_none_is_one_line() -> None:
    with pytest.raises(DaemonNotFound, match="here is no endpoint"):
        Client("here")


@pytest.mark.parametrize(
    "command",
    [
        *([], ["run"], ["listen"], ["list"], ["start"], ["stop"], ["tare"]),
        *(["restart"], ["decode"]),
    ],
)
def test_every_command_has_help_with_an_example(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main([*command, "--help"])
    assert ended.value.code == 0
    assert "example: imud " in capsys.readouterr().out


@pytest.mark.parametrize(
    "command",
    [
        [],
        ["fly"],
        ["listen", "--seconds", "0"],
        ["run", "--log", "a", "--no-log"],
        ["restart", "--filter", "none"],
    ],
)
def test_wrong_usage_is_exit_code_2(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(command)
    assert ended.value.code == 2
    assert "usage: imud" in capsys.readouterr().err


def test_no_port_to_look_at_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "imud.toml"
    file.write_text("[ports]\nfind = false\n")
    assert cli.main(["run", "--config", str(file)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "is off and no port is named; name one: imud run /dev/ttyUSB0" in line


# What a board has beside its sensor.


def test_equipment_is_in_the_status_and_in_the_list(
    chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    listing = ["list", "--connect", chain.daemon.endpoint]
    status = status_of(chain.client)
    assert status["equipment"] is None
    assert cli.main(listing) == 0
    assert "equipment" not in capsys.readouterr().out
    low = {"battery": 3310, "power": ("low",), "clock": "spare", "card_block": 32768}
    chain.port.write(chain.probe.say("equipment", **low))
    status = chain.status_when(lambda s: s["equipment"] is not None)
    assert status["equipment"] == {
        "clock": "spare",
        "battery_v": 3.31,
        "power": ["low"],
        "radio": None,
        "card": {
            "state": "logging",
            "recording": 1,
            "block": 32768,
            "blocks": 65536,
            "faults": 0,
            "busy_ms": 3,
            "logged": 100,
            "unlogged": 0,
        },
    }
    assert cli.main(listing) == 0
    head, row = capsys.readouterr().out.splitlines()
    assert head.endswith("equipment")
    assert row.endswith("spare clock, battery 3.31 V low, card logging 50 %")


def test_equipment_that_cannot_tell_its_battery_has_none() -> None:
    fields = EQUIPMENT | {"battery": None, "card": "none", "radio": "cable"}
    found = record.equipment_of(fields)
    assert (found["battery_v"], found["card"]) == (None, None)
    assert found["radio"] == {"state": "cable", "resets": 0}


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (("clock_failed", "crystal", 0), "clock failed (crystal), at its start"),
        (("clock_failed", "crystal", 1), "clock failed (crystal), while it ran"),
        (("card_fault", "absent", 0), "card fault (absent)"),
        (("card_fault", "worn", 812), "card fault (worn), at block 812"),
        (("log_started", "none", 3), "log started, recording 3"),
        (("battery_low", "battery", 3310), "battery low (battery), 3310 mV"),
        (("radio_dropped", "none", 0), "radio dropped"),
        (("bus_fault", "stuck_bus", 2), "bus fault (stuck bus), 2"),
        (("overrun", "late", 4), "overrun (late), 4 missed"),
    ],
)
def test_an_event_is_told_in_words(event: tuple[str, str, int], words: str) -> None:
    assert phrases.event_words(*event) == words


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            {"reset_cause": ("hard_fault",), "reset_address": 0x08001234},
            "hard fault at ",
        ),
        ({"reset_cause": ("watchdog",), "reset_address": 0x08001234}, "watchdog at "),
        ({"reset_cause": ("watchdog",)}, "watchdog"),
        ({"reset_cause": ("power_on",), "reset_address": 0x08001234}, "power on"),
    ],
)
def test_a_restart_says_where_it_struck(
    chain: Chain, fields: dict[str, Any], words: str
) -> None:
    chain.probe.restart()
    chain.port.write(chain.probe.say("hello", **fields))
    where = "0x08001234" if words.endswith("at ") else ""
    line = chain.daemon.expect("restarted on")
    assert line.endswith(f"boot 8 ({words}{where})")


def test_a_kind_of_line_is_written_once_in_a_while() -> None:
    limiter = Limiter(quiet_s=10.0, burst=2)
    said = [limiter.allow("a", t) for t in (0.0, 1.0, 2.0, 9.9, 10.0, 10.5, 11.0)]
    assert said == [
        "",
        "",
        None,
        None,
        " (and 2 like it before)",
        None,
        " (and 1 like it before)",
    ]
    assert limiter.allow("b", 11.0) == ""


def test_the_status_names_only_what_the_schema_knows() -> None:
    known = {m.name for m in schema.MESSAGES}
    assert known >= record.JSON_TOPICS
    events = {member.name.lower() for member in schema.Event}
    assert events >= phrases.FAULTS | phrases.DETAILS.keys()
    causes = {member.name.lower() for member in schema.ResetCauseFlags}
    assert causes >= phrases.WITH_ADDRESS
    assert set(Session(lambda _: None, 0).counts()) >= {"corrupt", "foreign"}  # type: ignore[arg-type,return-value] # none is found here
