# SPDX-License-Identifier: MIT
"""`imud replay`: readers and subscribers can't tell a log from the probe itself. It
knows the params of its probes from the first message on, also where the log is a later
part of a longer one.
"""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import signal
import subprocess
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from fakes import PATIENCE_S, DaemonProcess, FakeProbe, Forked, free_endpoint
from fakes.records import calibrated_records, parts_of
from imud import cli
from imud.cli import recordings
from imud.client import Client
from imud.errors import CommandRefused, ProbeUnknown
from imud.net import keys
from imud.params.value import payload_of
from imud.probes.record import Record, record_of
from imud.probes.session import Probe, Received, Session
from imud.probes.session import Probe as HeardProbe
from imud.recordings import replay
from imud.recordings.opening import HELLO, PARAMS, Opening
from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.params import digest_of
from log_files import BEGIN_NS, PERIOD_NS, frames, records, replaying, write


def status(name: str, t_ns: int, **fields: object) -> Record:
    payload = json.dumps({"type": "status", "probe": name, "t_ns": t_ns} | fields)
    return Record(name, "status", payload.encode(), b"", 0, t_ns, t_ns)


@contextlib.contextmanager
def network(tmp_path: Path) -> Iterator[tuple[Client, str]]:
    """Of a daemon without probes."""
    with DaemonProcess(tmp_path / "none", directory=tmp_path, log=False) as daemon:
        daemon.expect("listens on")
        with Client(daemon.endpoint) as client:
            yield client, daemon.endpoint


@contextlib.contextmanager
def playing(*words: object) -> Iterator[subprocess.Popen[str]]:
    pipe = subprocess.PIPE
    process = Forked("-m", "imud", "replay", *words, stdout=pipe, stderr=pipe)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def test_a_replayed_probe_is_alive_answers_with_its_status_and_takes_no_command(
    tmp_path: Path,
) -> None:
    put = records(500)
    path = write(
        tmp_path / "in", [status("left", put[0].t_ns, state="streaming"), *put]
    )
    with network(tmp_path) as (client, endpoint):
        assert client.alive() == []
        with playing(path, "--connect", endpoint, "--speed", 0.2) as process:
            assert client.wait_for("left", seconds=PATIENCE_S) == "left"
            while not client.statuses():
                pass
            (shown,) = client.statuses()
            assert (shown["probe"], shown["state"]) == ("left", "streaming")
            with pytest.raises(CommandRefused, match="a replay of a log"):
                client.command("left", "start")
            # One who would say the same on the same keys is kept from it.
            with (
                Client(endpoint) as second,
                pytest.raises(ProbeUnknown, match="a probe left already exists"),
            ):
                replay.to_network(replay.log_set([path]), second, None)
            process.send_signal(signal.SIGINT)
            output, error = process.communicate()
        assert process.returncode == 130
        assert output.startswith("stopped after ")
        assert output.count("\n") == 1
        assert error == ""
        assert client.alive() == []
        assert client.statuses() == []


def test_while_none_reads_the_pty_control_c_ends_it_with_one_line(
    tmp_path: Path,
) -> None:
    path, link = write(tmp_path, records(10)), tmp_path / "probe"
    with playing(path, "--link", link) as process:
        assert "probe left is on" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        output, error = process.communicate()
    assert (process.returncode, output, error) == (
        130,
        "stopped after 0 messages\n",
        "",
    )
    assert not link.is_symlink()


def test_files_are_played_in_the_order_in_which_they_were_begun(
    tmp_path: Path,
) -> None:
    """Also one that is cut, whose probes stand in no summary."""
    put = records(300)
    thirds = [put[:100], put[100:200], put[200:]]
    names = ["b", "c", "a"]
    paths = [
        write(tmp_path / name, third) for name, third in zip(names, thirds, strict=True)
    ]
    paths[1].write_bytes(paths[1].read_bytes()[:-30])
    what = replay.log_set([paths[2], paths[0], paths[1]])
    assert what == replay.LogSet(paths, ["left"], "imud")
    with network(tmp_path) as (client, _):
        found: dict[str, list[bytes]] = {"frame": [], "pose": []}
        subscribers = [
            client.session.declare_subscriber(
                f"imud/left/{topic}",
                lambda sample, of=of: of.append(sample.payload.to_bytes()),
            )
            for topic, of in found.items()
        ]
        # In the same session: what is put is heard at once.
        assert replay.to_network(what, client, None) == 0
        for subscriber in subscribers:
            subscriber.undeclare()
    assert found["frame"] == [record.content for record in put]
    assert found["pose"] == [each.payload for each in put if each.topic == "pose"]


def test_each_probe_of_a_log_speaks_on_a_pty_of_its_own(tmp_path: Path) -> None:
    left, right = records(400, name="left"), records(400, FakeProbe(), "right")
    path = write(tmp_path, left, right)
    with playing(path, "--speed", "0") as process:
        lines = [process.stdout.readline() for _ in range(2)]
        ports = [line.split(" is on ")[1].split(";")[0] for line in lines]
        found = dict(zip(("left", "right"), read(ports, 400), strict=True))
        assert process.stdout.readline() == "replayed 800 messages\n"
    assert found["left"] == [record.content for record in left]
    assert found["right"] == [record.content for record in right]


def read(ports: list[str], count: int) -> list[list[bytes]]:
    """`count` messages of each port."""
    files = [os.open(port, os.O_RDONLY | os.O_NOCTTY) for port in ports]
    sessions = {}
    for file in files:
        probe = HeardProbe("x")
        sessions[file] = Session(lambda _, probe=probe: probe, None, probe)
        sessions[file].receive(b"\0", None)
    found: dict[int, list[bytes]] = {file: [] for file in files}
    try:
        while any(len(each) < count for each in found.values()):
            ready, _, _ = select.select(files, [], [], PATIENCE_S)
            assert ready
            for file in ready:
                events = sessions[file].receive(os.read(file, 4096), None)
                found[file] += [e.content for e in events if isinstance(e, Received)]
    finally:
        for file in files:
            os.close(file)
    return [found[file] for file in files]


def test_where_keys_rule_a_daemon_may_replay_and_nobody_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "in", [*records(50), status("left", 1)])
    folder = tmp_path / "keys"
    endpoint = free_endpoint().replace("tcp/", "tls/")
    keys.initialise(folder, ["localhost"], int(endpoint.rpartition(":")[2]))
    keys.add(folder, "daemon", "player")
    settings = tmp_path / "imud.toml"
    settings.write_text(f'[zenoh]\nkeys = "{folder}"\n')
    words = ("--config", settings)
    with DaemonProcess(
        tmp_path / "none", *words, directory=tmp_path, log=False, endpoint=endpoint
    ) as daemon:
        daemon.expect("listens on tls")
        clients = folder / "clients"
        with Client(keys=clients / "recorder.toml") as client:
            found: list[bytes] = []
            done = threading.Event()

            def take(_: str, payload: bytes) -> None:
                found.append(payload)
                if len(found) == 50:
                    done.set()

            client.subscribe("frame", None, take)
            client.statuses()  # then the router knows who subscribes
            as_player = ["--keys", str(clients / "player.toml"), "--speed", "max"]
            assert cli.main(["replay", str(path), *as_player]) == 0
            done.wait()
        assert capsys.readouterr().out == "replayed 101 messages\n"
        as_viewer = ["--keys", str(clients / "viewer.toml")]
        assert cli.main(["replay", str(path), *as_viewer]) == 1
        assert "only the role daemon may publish" in capsys.readouterr().err
    both = [*as_player, "--link", str(tmp_path / "x")]
    assert cli.main(["replay", str(path), *both]) == 1
    assert "leave out one of them" in capsys.readouterr().err


@pytest.mark.parametrize("what", ["replaying", "exporting", "recovering", "reading"])
def test_on_a_terminal_a_bar_shows_how_far_it_is(tmp_path: Path, what: str) -> None:
    path = write(tmp_path / "in", *[records(50) for _ in range(20)])
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    words = {
        "replaying": ["replay", "--speed", "max"],
        "exporting": ["export"],
        "recovering": ["recover"],
        "reading": ["info"],
    }[what]
    command = ("-m", "imud", words[0], path, *words[1:])
    master, slave = pty.openpty()
    with Forked(*command, stderr=slave, stdout=subprocess.PIPE) as process:
        os.close(slave)
        assert process.stdout is not None
        if what == "replaying":
            line = process.stdout.readline()
            read([line.split(" is on ")[1].split(";")[0]], 1)
        shown = b""
        with contextlib.suppress(OSError):
            while some := os.read(master, 4096):
                shown += some
        process.wait()
    os.close(master)
    assert f"{what} ".encode() in shown
    assert b"%" in shown
    assert shown.rfind(b"\r\x1b[K") > shown.rfind(b"%")  # it is taken away


def test_pace_follows_the_times_of_the_log() -> None:
    now, slept = [100.0], []

    def sleep(seconds: float) -> None:
        slept.append(round(seconds, 6))
        now[0] += seconds

    pace = replay.Pacer(4.0, lambda: now[0], sleep)
    for t_ns in (0, 10**9, 1_500_000_000, 1_400_000_000, 3 * 10**9):
        pace.wait(t_ns)
    assert slept == [0.25, 0.125, 0.375]
    slept.clear()
    free = replay.Pacer(None, lambda: now[0], sleep)
    free.wait(0)
    free.wait(10**12)
    assert slept == []
    assert recordings.speed("0") is recordings.speed("max") is None


def test_a_reader_that_flushes_late_and_reads_slowly_gets_all(tmp_path: Path) -> None:
    """As imud does on a busy machine: what it flushes is not to be in it yet."""
    put = records(200)
    path = write(tmp_path, put)
    link = tmp_path / "probe"
    with replaying(path, link):
        port = os.open(link, os.O_RDWR | os.O_NOCTTY)
        time.sleep(1.0)  # it may write meanwhile
        termios.tcflush(port, termios.TCIFLUSH)
        attributes = termios.tcgetattr(port)
        attributes[2] &= ~termios.HUPCL
        termios.tcsetattr(port, termios.TCSANOW, attributes)
        found = b""
        while found.count(0) < len(put):
            found += os.read(port, 500)
            time.sleep(0.005)
        os.close(port)
    assert len(FrameDecoder().feed(found)) == len(put)


def test_a_log_replayed_into_a_daemon_is_heard_as_a_probe(tmp_path: Path) -> None:
    probe = FakeProbe()
    put = records(200, probe)
    hello = probe.content("hello")
    last = put[-1]
    put.append(msgspec.structs.replace(last, topic="hello", payload=b"", content=hello))
    path = write(tmp_path / "in", put)
    link = tmp_path / "probe"
    with DaemonProcess(link, directory=tmp_path) as daemon:
        with replaying(path, link):
            daemon.expect("probe 00112233445566aa found")
        daemon.stop()
        assert frames(daemon.log) == [record.content for record in put]


def test_of_several_probes_one_is_chosen_for_a_link(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, records(3, name="left"), records(3, name="right"))
    assert cli.main(["replay", str(path), "--link", str(tmp_path / "x")]) == 1
    assert "choose one with --probe" in capsys.readouterr().err
    assert cli.main(["replay", str(path), "--probe", "up"]) == 1
    assert "no probe up; available: left, right" in capsys.readouterr().err


def test_a_log_of_another_schema_is_not_given_out_as_of_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The seed of a frame's CRC would say that it is."""
    monkeypatch.setattr(schema, "FINGERPRINT", schema.FINGERPRINT ^ 1)
    path = write(tmp_path, records(3))
    assert cli.main(["replay", str(path)]) == 1
    assert "has another schema than this imud" in capsys.readouterr().err


def test_an_endpoint_without_a_network_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, records(3))
    assert cli.main(["replay", str(path), "--connect", free_endpoint()]) == 1
    assert capsys.readouterr().err.startswith("imud: no imud at")


# Params of a log.


ONE, OTHER = calibrated_records(1), calibrated_records(2)
RAWS = 20
HOURS = 3_600_000_000_000


def contents_with(records: bytes, before: int = 10) -> list[bytes]:
    """The messages of a probe with these params, then samples."""
    probe = FakeProbe(params_digest=digest_of(records))
    contents = [probe.content("pose") for _ in range(before)]
    contents += [probe.content("hello"), *parts_of(probe, records, probe.content)]
    return contents + [probe.content("raw") for _ in range(RAWS)]


def received(contents: list[bytes]) -> list[Received]:
    """The events of a daemon that reads these from their first byte on."""
    probe = Probe("left")
    session = Session(lambda _: probe, 0)
    events = session.receive(b"".join(map(encode_frame, contents)), 0)
    return [event for event in events if isinstance(event, Received)]


def later(contents: list[bytes], count: int = RAWS) -> list[Record]:
    """The last records of these: what a log holds that begins there."""
    made = []
    for number, event in enumerate(received(contents)[-count:]):
        t_ns = BEGIN_NS + number * PERIOD_NS
        stamp = replace(event.stamp, t_ns=t_ns, t_received_ns=t_ns)
        made.append(
            record_of(event.message, event.content, "left", stamp, event.scales)
        )
    return made


def params_record(records: bytes, t_ns: int) -> Record:
    """The message that a daemon publishes when it learns of params."""
    values = {"type": "params", "probe": "left", "t_ns": t_ns, **payload_of(records)}
    return Record("left", "params", json.dumps(values).encode(), b"", 0, t_ns, t_ns)


# On a pty.


def played(path: Path, link: Path) -> bytes:
    """The bytes of its replay."""
    data = b""
    with replaying(path, link) as playing:
        port = os.open(link, os.O_RDONLY | os.O_NOCTTY)
        # Until the replay has closed its end.
        with contextlib.suppress(OSError):
            while data.count(b"\0") < RAWS or playing.is_alive():
                data += os.read(port, 4096)
        os.close(port)
    return data


def test_a_later_part_of_a_log_is_calibrated_from_its_first_sample(
    tmp_path: Path,
) -> None:
    put = later(contents_with(ONE))
    data = played(write(tmp_path, put), tmp_path / "probe")
    probe = Probe("left")
    events = Session(lambda _: probe, 0).receive(data, 0)
    heard = [event for event in events if isinstance(event, Received)]
    raws = [event for event in heard if event.message.name == "raw"]
    assert [raw.content for raw in raws] == [record.content for record in put]
    assert {raw.params for raw in raws} == {ONE}
    # What comes ahead of them is the hello and the params, numbered without a gap.
    names = [event.message.name for event in heard[: -len(raws)]]
    assert names == ["hello"] + ["params"] * 5
    assert probe.account.counts()["lost"] == 0
    assert raws[0].message.sequence == heard[0].message.sequence + 6


def opening_of(*metadata: tuple[str, bytes]) -> Opening:
    opening = Opening()
    for topic, data in metadata:
        opening.add(topic, data)
    return opening


def hello_of(records: bytes) -> bytes:
    return FakeProbe(params_digest=digest_of(records)).content("hello")


@pytest.mark.parametrize(
    ("metadata", "records"),
    [
        ([], None),
        ([(PARAMS, ONE)], None),
        ([(HELLO, hello_of(ONE))], None),
        ([(HELLO, hello_of(ONE)), (PARAMS, OTHER)], None),
        ([(HELLO, hello_of(b""))], b""),
        ([(HELLO, hello_of(ONE)), (PARAMS, ONE)], ONE),
        ([(PARAMS, OTHER), (PARAMS, ONE), (HELLO, hello_of(ONE))], ONE),
        # A later hello has nothing to say of the beginning.
        ([(HELLO, hello_of(ONE)), (PARAMS, ONE), (HELLO, hello_of(OTHER))], ONE),
        ([(HELLO, b"\x03 no hello"), (HELLO, hello_of(ONE)), (PARAMS, ONE)], ONE),
    ],
)
def test_the_first_hello_says_which_params_a_log_begins_with(
    metadata: list[tuple[str, bytes]], records: bytes | None
) -> None:
    opening = opening_of(*metadata)
    assert opening.records == records
    assert bool(opening.payload("left", 1)) == (records is not None)
    assert bool(opening.contents(contents_with(ONE)[-1])) == bool(records)


def test_a_probe_that_has_just_booted_tells_its_params_itself() -> None:
    opening = opening_of((HELLO, hello_of(ONE)), (PARAMS, ONE))
    counts = [
        len(opening.contents(content)) for content in contents_with(ONE, before=8)
    ]
    assert counts[:8] == [0] * 6 + [6] * 2


# On a network.


class Held:
    """In place of the pace: waits before messages of a later hour until they may go."""

    def __init__(self) -> None:
        self.reached, self.go_on = threading.Event(), threading.Event()

    def wait(self, t_ns: int) -> None:
        if t_ns >= BEGIN_NS + HOURS:
            self.reached.set()
            self.go_on.wait()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("is_later_part", [False, True])
def test_who_subscribes_late_asks_for_the_params_in_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_later_part: bool
) -> None:
    put = later(contents_with(ONE))
    if not is_later_part:
        put.insert(3, params_record(ONE, put[3].t_received_ns))
    late_ns = BEGIN_NS + HOURS
    put.append(params_record(OTHER, late_ns))
    path = write(tmp_path / "in", put)
    held = Held()
    monkeypatch.setattr(replay, "Pacer", lambda _: held)
    with contextlib.ExitStack() as stack:
        daemon = stack.enter_context(
            DaemonProcess(tmp_path / "none", directory=tmp_path, log=False)
        )
        daemon.expect("listens on")
        client, player = (
            stack.enter_context(Client(daemon.endpoint)) for _ in range(2)
        )
        what = replay.log_set([path])
        playing = threading.Thread(target=replay.to_network, args=(what, player, None))
        playing.start()
        try:
            held.reached.wait()
            client.wait_for("left", seconds=PATIENCE_S)
            reply = client.params("left")
            with pytest.raises(CommandRefused, match="a replay of a log, which"):
                client.params_history("left")
        finally:
            held.go_on.set()
            playing.join()
        daemon.stop()
    assert reply["probe"] == "left"
    assert reply["digest"] == f"{digest_of(ONE):08x}"
    assert {key: reply[key] for key in payload_of(ONE)} == json.loads(
        json.dumps(payload_of(ONE))
    )
