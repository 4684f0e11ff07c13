# SPDX-License-Identifier: MIT
"""The daemon as a service: what systemd is told, what a reload takes up, what is
installed, and that no query of anybody's is a fault.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from fakes import PATIENCE_S, DaemonProcess, FakeProbe, Port, free_address
from imud.cli import main
from imud.client import Client
from imud.daemon.commands import arguments_of
from imud.daemon.systemd import Notifier
from imud.errors import CommandRefused
from imud.log.reader import Logged, read_log
from imud.wire import messages
from imud.wire.messages import decode


class Manager:
    """The socket that systemd would listen on."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.settimeout(30)

    def expect(self, word: str) -> str:
        """The next datagram that has it."""
        while word not in (text := self._socket.recv(4096).decode()):
            pass
        return text

    def drain(self) -> None:
        """Takes what is there."""
        while select.select([self._socket], [], [], 0.1)[0]:
            self._socket.recv(4096)

    def expect_none(self, seconds: float) -> None:
        assert not select.select([self._socket], [], [], seconds)[0]

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Manager]:
    path = tmp_path / "notify"
    monkeypatch.setenv("NOTIFY_SOCKET", str(path))
    listening = Manager(path)
    yield listening
    listening.close()


@contextlib.contextmanager
def running(
    folder: Path, text: str, *, log: bool | None = True
) -> Iterator[tuple[DaemonProcess, FakeProbe, Port]]:
    port, probe = Port(folder / "port"), FakeProbe()
    file = folder / "imud.toml"
    file.write_text(f"[ports]\nfind = false\nnamed = ['{port.path}']\n{text}")
    with DaemonProcess("--config", file, directory=folder, log=log) as daemon:
        port.wait_open()
        port.write(probe.say("hello"))
        daemon.expect("found on")
        try:
            yield daemon, probe, port
        finally:
            port.vanish()


def reload(daemon: DaemonProcess, folder: Path, old: str, new: str) -> None:
    file = folder / "imud.toml"
    file.write_text(file.read_text().replace(old, new))
    daemon.process.send_signal(signal.SIGHUP)


def test_systemd_is_told_of_each_step(tmp_path: Path, manager: Manager) -> None:
    with running(tmp_path, "") as (daemon, _, _):
        assert manager.expect("READY=1") == "READY=1"
        manager.expect("WATCHDOG=1")
        assert "1 probe, " in manager.expect("STATUS=1 probe")
        daemon.process.send_signal(signal.SIGHUP)
        assert "MONOTONIC_USEC=" in manager.expect("RELOADING=1")
        manager.expect("READY=1")
        assert daemon.stop() < 1.0
        manager.expect("STOPPING=1")


def test_a_stop_under_a_stream_is_clean_and_loses_nothing(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """What came before the signal is in the log, which is whole."""
    with running(tmp_path, "") as (daemon, probe, port):
        for _ in range(20):
            port.write(probe.poses(100))
        port.write(probe.say("event"))
        daemon.expect("stream started")
        sent = probe.sequence
        port.write(probe.poses(50))  # these may come or not
        seconds = daemon.stop()
    record_property("stopped after, s", round(seconds, 3))
    assert seconds < 1.0
    frames = [
        decode(each.data)
        for each in read_log(daemon.log)
        if isinstance(each, Logged) and each.topic == "frame"
    ]
    numbers = [each.sequence for each in frames]
    assert numbers == list(range(len(numbers)))
    record_property("sent before the signal", sent)
    record_property("lost of them", sent - min(sent, len(numbers)))
    assert len(numbers) >= sent
    assert not any("did not finish" in line for line in daemon.lines)
    assert main(["info", str(daemon.log)]) == 0


def test_the_watchdog_hears_of_a_loop_that_lives_and_of_no_other(
    tmp_path: Path, manager: Manager
) -> None:
    with running(tmp_path, "") as (daemon, _, _):
        manager.expect("WATCHDOG=1")
        for _ in range(3):
            begin = time.monotonic()
            manager.expect("WATCHDOG=1")
            # systemd waits for ten: WatchdogSec of the unit.
            assert time.monotonic() - begin < 5.0
        daemon.process.send_signal(signal.SIGSTOP)
        manager.drain()
        manager.expect_none(2.5)
        daemon.process.send_signal(signal.SIGCONT)
        manager.expect("WATCHDOG=1")
        assert daemon.stop() < 1.0


def test_nothing_is_told_where_nobody_listens(tmp_path: Path) -> None:
    Notifier({}).ready()
    Notifier({"NOTIFY_SOCKET": str(tmp_path / "none")}).ready()


def test_a_reload_gives_a_probe_its_name_and_loses_no_count(tmp_path: Path) -> None:
    with running(tmp_path, "# more") as (daemon, probe, port):
        port.write(probe.poses(20))
        own = "[probes.00112233445566aa]\nname = 'stylus'"
        reload(daemon, tmp_path, "# more", own)
        daemon.expect("reloaded: probes")
        with Client(daemon.endpoint) as client:
            assert client.wait_for("stylus") == "stylus"
            assert client.alive() == ["stylus"]
            # Once a second there is another status.
            ledger: dict[str, Any] = {}
            until = time.monotonic() + PATIENCE_S
            while ledger.get("logged", {}).get("pose") != 20:
                assert time.monotonic() < until, ledger
                for status in client.statuses("stylus"):
                    assert status["probe_id"] == probe.name
                    ledger = status["ledger"]
            assert ledger["published"]["pose"] == 20
            assert ledger["adds_up"], ledger["differs"]
        reload(daemon, tmp_path, "'stylus'", "'tip'")
        daemon.expect("reloaded: probes")
        daemon.stop()
        assert any("probe tip: 21 received, 0 lost" in line for line in daemon.lines)


LOG_OFF, LOG_ON = "[log]\nenabled = false", "[log]\nenabled = true"
ROS2_ON = "[ros2]\nenabled = true\n"


def ledger_when(
    client: Client, is_so: Callable[[dict[str, Any]], bool]
) -> dict[str, Any]:
    """Of the first status of which that is true; there is another once a second."""
    until = time.monotonic() + PATIENCE_S
    while True:
        for status in client.statuses():
            ledger: dict[str, Any] = status["ledger"]
            if is_so(ledger):
                return ledger
        assert time.monotonic() < until, ledger
        time.sleep(0.05)


def test_a_sink_that_a_reload_switches_keeps_the_ledger_adding_up(
    tmp_path: Path,
) -> None:
    with running(tmp_path, LOG_OFF, log=None) as (daemon, probe, port):
        with Client(daemon.endpoint) as client:
            port.write(probe.poses(20))
            ledger_when(client, lambda each: each["received"] == 21)
            for turn in range(1, 4):
                reload(daemon, tmp_path, LOG_OFF, ROS2_ON + LOG_ON)
                daemon.expect("reloaded: log, ros2")
                port.write(probe.poses(30))
                ledger = ledger_when(
                    client, lambda each: each["logged"].get("pose", 0) == 30
                )
                assert ledger["adds_up"], ledger["sinks"]
                assert ledger["sinks"].keys() == {"zenoh", "log", "ros2"}
                assert ledger["sinks"]["zenoh"]["earlier"] == 0
                # What was put while it was off is no loss of its own.
                log = ledger["sinks"]["log"]
                assert log["earlier"] >= 21 + 60 * (turn - 1)
                assert log["dropped"] == 0
                if turn == 2:  # its counts go along with the probe's name
                    named = f"[probes.{probe.name}]\nname = 'tip'\n"
                    reload(daemon, tmp_path, "[log]", f"{named}[log]")
                    daemon.expect("reloaded: probes")
                    after = ledger_when(client, lambda each: each["adds_up"])
                    assert after["sinks"]["log"]["earlier"] == log["earlier"]
                reload(daemon, tmp_path, ROS2_ON, "")
                daemon.expect("reloaded: ros2")
                reload(daemon, tmp_path, LOG_ON, LOG_OFF)
                daemon.expect("reloaded: log")
                port.write(probe.poses(30))
                received = probe.sequence
                ledger = ledger_when(
                    client, lambda each, n=received: each["received"] == n
                )
                assert ledger["adds_up"], ledger["sinks"]
                assert ledger["sinks"].keys() == {"zenoh"}
        daemon.stop()


def test_a_reload_sets_up_a_probe_that_is_there(tmp_path: Path) -> None:
    with running(tmp_path, "# more") as (daemon, probe, port):
        own = "[probes.00112233445566aa]\npose_rate = 50"
        reload(daemon, tmp_path, "# more", own)
        daemon.expect("reloaded: probes")
        port.serve(probe, 1)
        reload(daemon, tmp_path, "pose_rate = 50", "streams = ['raw']")
        daemon.expect("reloaded: probes")
        port.serve(probe, 1)
        heard = [(c["command"], c["arguments"]) for c in probe.commands]
        assert heard == [("rate", (0, 50)), ("fields", (2, 0))]
        daemon.stop()


RELOADS, MEANWHILE = 30, 30  # messages from one to the next


def test_thirty_reloads_under_a_stream_lose_nothing_and_leak_no_descriptor(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    ended = threading.Event()
    changes = (  # the log's sink is made anew, the network's, both
        ("rotate_mb = 1", "rotate_mb = 2", "reloaded: log"),
        ("history = 1", "history = 2", "reloaded: zenoh"),
        ("= 2", "= 1", "reloaded: zenoh, log"),
    )
    text = "[log]\nrotate_mb = 1\n[zenoh]\nhistory = 1\n"
    with running(tmp_path, text) as (daemon, probe, port):

        def stream() -> None:
            while not ended.wait(0.005):
                is_due = probe.sequence % 200 == 0
                port.write(probe.say("hello") if is_due else probe.say("pose"))

        streamer = threading.Thread(target=stream, daemon=True)
        streamer.start()
        folder = Path(f"/proc/{daemon.process.pid}/fd")
        with Client(daemon.endpoint) as client:  # Zenoh opens some for the first
            client.wait_for()
        at_first = len(list(folder.iterdir()))
        slowest_s = 0.0
        try:
            for turn in range(RELOADS):
                before, after, line = changes[turn % len(changes)]
                sent = probe.sequence
                begin = time.monotonic()
                reload(daemon, tmp_path, before, after)
                daemon.expect(line)
                slowest_s = max(slowest_s, time.monotonic() - begin)
                while probe.sequence < sent + MEANWHILE:
                    time.sleep(0.005)
        finally:
            ended.set()
            streamer.join()
        with Client(daemon.endpoint) as client:
            sent = probe.sequence
            ledger = ledger_when(client, lambda each: each["received"] == sent)
            assert ledger["adds_up"], ledger["sinks"]
            assert ledger["lost"] == 0
            assert all(each["dropped"] == 0 for each in ledger["sinks"].values())
        # A log that is closing and the client that left are there for a moment.
        until = time.monotonic() + PATIENCE_S
        while (at_last := len(list(folder.iterdir()))) > at_first + 1:
            assert time.monotonic() < until, (at_first, at_last)
            time.sleep(0.1)
        daemon.stop()
    frames = [
        each.data
        for path in sorted(daemon.logs.glob("*.mcap"))
        for each in read_log(path)
        if isinstance(each, Logged) and each.topic == "frame"
    ]
    record_property("reloads", RELOADS)
    record_property("slowest reload, s", round(slowest_s, 3))
    record_property("descriptors, first and last", (at_first, at_last))
    record_property("messages sent", sent)
    record_property("messages in the logs", len(frames))
    assert len(frames) == sent


def test_a_file_with_a_mistake_is_told_and_changes_nothing(tmp_path: Path) -> None:
    with running(tmp_path, "[journal]\nburst = 3") as (daemon, probe, port):
        reload(daemon, tmp_path, "burst = 3", "burst = 0")
        line = daemon.expect("reload failed")
        assert re.search(r"imud.toml:5: \[journal\] burst: 0 is not", line)
        port.write(probe.say("event"))
        daemon.expect("stream started")
        reload(daemon, tmp_path, "burst = 0", "burst = 4")
        daemon.expect("reloaded: journal")
        daemon.stop()


def test_a_reload_turns_metrics_on_and_off(tmp_path: Path) -> None:
    address = free_address()
    said = f"[metrics]\nlisten = '127.0.0.1:{address[1]}'"
    with running(tmp_path, "# more") as (daemon, _, _):
        reload(daemon, tmp_path, "# more", said)
        daemon.expect("reloaded: metrics")
        with socket.create_connection(address, 10) as end:
            end.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
            assert end.recv(12) == b"HTTP/1.1 200"
        reload(daemon, tmp_path, said, "# more")
        daemon.expect("reloaded: metrics")
        with pytest.raises(OSError, match="refused"):
            socket.create_connection(address, 10).close()
        daemon.stop()


def test_a_mistake_in_the_beginning_is_one_line_and_exit_code_1(tmp_path: Path) -> None:
    (tmp_path / "imud.toml").write_text("twin = 1")
    with DaemonProcess(
        "--config", tmp_path / "imud.toml", directory=tmp_path
    ) as daemon:
        (line,) = daemon.rest()
        assert daemon.process.wait(30) == 1
    assert line.startswith("imud: ")


@pytest.fixture(scope="module")
def commanded(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[DaemonProcess, zenoh.Session]]:
    folder = tmp_path_factory.mktemp("fuzz")
    with running(folder, "[journal]\nburst = 100") as (daemon, _, _):
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([daemon.endpoint]))
        with zenoh.open(config) as session:
            yield daemon, session
        daemon.stop()
        assert not [line for line in daemon.lines if "internal error" in line]
        assert not [line for line in daemon.lines if "Traceback" in line]


_WORDS = st.text(st.characters(exclude_characters="/*$#?", codec="utf-8"), min_size=1)
_NAMES = st.sampled_from(["stream", "hz", "what", "streams", "filter"]) | _WORDS


_NUMBERS = st.integers(-(2**70), 2**70).map(str) | st.just("9" * 5000)
_VALUES = st.sampled_from(["pose", "raw", "all", "undo", "fuse", "pose,raw", ""])
_PARAMETERS = st.dictionaries(_NAMES, _VALUES | _NUMBERS | st.text(max_size=20))
_COMMANDS = st.sampled_from(["rate", "fields", "tare", "restart", "start"])


@given(_COMMANDS, _PARAMETERS)
@example("rate", {"stream": "pose", "hz": str(2**40)})
@example("rate", {"stream": "pose", "hz": "-1"})
def test_no_parameters_are_a_fault(command: str, parameters: dict[str, str]) -> None:
    try:
        arguments = arguments_of(command, parameters)
    except CommandRefused as error:
        assert str(error)
        return
    fields = {"command": command, "token": 1, "arguments": arguments}
    # What no field holds is refused as the daemon refuses it.
    with contextlib.suppress(ValueError):
        messages.encode("command", fields, 1, 1)


@given(_COMMANDS | _WORDS, _PARAMETERS, st.binary(max_size=50))
@settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_no_query_is_a_fault(
    commanded: tuple[DaemonProcess, zenoh.Session],
    command: str,
    parameters: dict[str, str],
    payload: bytes,
) -> None:
    daemon, session = commanded
    # With a name that no command knows, so that the probe is not asked: it is silent.
    said = ";".join(
        f"{key}={value}" for key, value in (parameters | {"x1": ""}).items()
    )
    try:
        selector = zenoh.Selector(f"imud/00112233445566aa/cmd/{command}", said)
    except (zenoh.ZError, ValueError):
        return  # not a key: the library itself refuses it
    replies = list(session.get(selector, payload=payload, timeout=20.0))
    assert all(reply.err is not None for reply in replies)
    # cmd/* is no key that begins with @: Zenoh keeps those apart.
    assert len(replies) == (not command.startswith("@"))
    assert daemon.process.poll() is None


def test_what_is_installed_is_whole_and_says_what_starts_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["install-service", "--prefix", str(tmp_path)]) == 0
    assert "systemctl enable --now imud" in capsys.readouterr().out
    assert main(["config", "--check", str(tmp_path / "etc/imud.toml")]) == 0
    assert (tmp_path / "etc/systemd/system/imud.service").exists()


@pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="another init than systemd is used"
)
def test_the_unit_can_be_taken_by_systemd(tmp_path: Path) -> None:
    assert main(["install-service", "--prefix", str(tmp_path)]) == 0
    unit = tmp_path / "etc/systemd/system/imud.service"
    subprocess.run(["systemd-analyze", "verify", unit], check=True)
    security = ["systemd-analyze", "security", "--offline=true", "--no-pager"]
    # 2.0 of 10 is the threshold, in tenths; the command fails above it.
    subprocess.run(
        [*security, "--threshold=20", unit], check=True, stdout=subprocess.DEVNULL
    )


def test_settings_that_are_there_stay(tmp_path: Path) -> None:
    file = tmp_path / "etc/imud.toml"
    file.parent.mkdir()
    file.write_text("twin = true\n")
    assert main(["install-service", "--prefix", str(tmp_path)]) == 0
    assert file.read_text() == "twin = true\n"


def test_what_is_shown_is_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = ["install-service", "--print", "--prefix", str(tmp_path), "--user", "me"]
    assert main(shown) == 0
    out = capsys.readouterr().out
    assert "User=me\n" in out
    assert "Type=notify\n" in out
    assert list(tmp_path.iterdir()) == []
    assert main(["install-service", "--user", "a b"]) == 1


def test_the_rule_has_what_udev_reads(tmp_path: Path) -> None:
    main(["install-service", "--prefix", str(tmp_path)])
    rules = (tmp_path / "etc/udev/rules.d/70-imu-probe.rules").read_text()
    pair = re.compile(r'[A-Z_]+(\{[A-Za-z_]+\})?(==|!=|\+=|=)"[^"]*"')
    for line in rules.splitlines():
        if line and not line.startswith("#"):
            assert all(pair.fullmatch(part) for part in line.split(", ")), line
    assert 'ATTR{latency_timer}="1"' in rules
    assert rules.count('ENV{ID_MM_DEVICE_IGNORE}="1"') == 5


def test_the_journal_of_systemd_has_levels_and_no_time(tmp_path: Path) -> None:
    read, write = os.pipe()
    file = os.fstat(write)
    (tmp_path / "imud.toml").write_text("[ports]\nfind=false\nnamed=['/dev/none']\n")
    environment = os.environ | {"JOURNAL_STREAM": f"{file.st_dev}:{file.st_ino}"}
    with subprocess.Popen(
        [
            *(sys.executable, "-m", "imud", "run", "--no-log"),
            *("--config", tmp_path / "imud.toml", "--listen", "tcp/127.0.0.1:0"),
        ],
        stderr=write,
        env=environment,
    ) as process:
        os.close(write)
        with os.fdopen(read) as lines:
            assert lines.readline().startswith("<6>imud ")
            assert lines.readline().startswith("<4>/dev/none does not exist")
            process.send_signal(signal.SIGTERM)
            lines.read()
    assert process.returncode == 0
