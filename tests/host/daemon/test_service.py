# SPDX-License-Identifier: MIT
"""imud under systemd: what it tells, what is installed."""

from __future__ import annotations

import os
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from configured import running
from fakes import SOON_S, DaemonProcess, Stopwatch
from imud.cli import main
from imud.daemon import install
from imud.daemon.systemd import Notifier
from imud.log.reader import Logged
from imud.ports.adapters import ADAPTERS
from imud.wire.messages import decode
from log_files import read_log


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


def test_systemd_is_told_of_each_step(tmp_path: Path, manager: Manager) -> None:
    with running(tmp_path, "") as (daemon, _, _):
        assert manager.expect("READY=1") == "READY=1"
        manager.expect("WATCHDOG=1")
        assert "1 probe, " in manager.expect("STATUS=1 probe")
        daemon.process.send_signal(signal.SIGHUP)
        assert "MONOTONIC_USEC=" in manager.expect("RELOADING=1")
        manager.expect("READY=1")
        assert daemon.stop() < SOON_S
        manager.expect("STOPPING=1")


def test_a_stop_under_a_stream_is_clean_and_loses_nothing(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """All messages before the signal are in the log, which is intact."""
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
            watch = Stopwatch(daemon.process.pid)
            manager.expect("WATCHDOG=1")
            # systemd waits for ten: WatchdogSec of the unit.
            assert watch.look() < 5.0
        daemon.process.send_signal(signal.SIGSTOP)
        manager.drain()
        manager.expect_none(2.5)
        daemon.process.send_signal(signal.SIGCONT)
        manager.expect("WATCHDOG=1")
        assert daemon.stop() < SOON_S


def test_nothing_is_told_where_nobody_listens(tmp_path: Path) -> None:
    Notifier({}).ready()
    Notifier({"NOTIFY_SOCKET": str(tmp_path / "none")}).ready()


def test_settings_that_cannot_be_end_it_for_good_and_its_status_says_why(
    tmp_path: Path, manager: Manager
) -> None:
    """A service manager would start it again, for ever."""
    (tmp_path / "imud.toml").write_text("twin = 1")
    with DaemonProcess(
        "--config", tmp_path / "imud.toml", directory=tmp_path
    ) as daemon:
        (line,) = daemon.rest()
        assert daemon.process.wait() == 78
    assert line.startswith("imud: ")
    status = manager.expect("STATUS=")
    assert status.startswith(f"STATUS={line.removeprefix('imud: ')}; correct it")
    assert "systemctl restart imu-probe" in status
    main(["install-service", "--prefix", str(tmp_path)])
    unit = (tmp_path / "etc/systemd/system/imu-probe.service").read_text()
    assert re.search(r"^RestartPreventExitStatus=.*\b78$", unit, re.MULTILINE)


def test_a_taken_port_of_poses_ends_it_without_a_log(
    tmp_path: Path, manager: Manager
) -> None:
    """It may become free: a service manager starts the daemon again."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with DaemonProcess(directory=tmp_path, endpoint=endpoint) as daemon:
            daemon.rest()
            assert daemon.process.wait() == 1
    assert not [*tmp_path.rglob("*.mcap")]
    assert endpoint in manager.expect("STATUS=")


@pytest.mark.parametrize("service", ["metrics", "foxglove", "openigtlink"])
def test_a_taken_port_of_another_service_is_told_and_taken_once_it_is_free(
    service: str, tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        host, port = taken.getsockname()
        on = "" if service == "metrics" else "enabled = true\n"
        text = f"[{service}]\n{on}listen = '{host}:{port}'\n"
        # Taken by the time that the daemon starts: it continues with its poses.
        with running(tmp_path, text) as (daemon, _, _):
            (line,) = [each for each in daemon.lines if str(port) in each]
            assert "warning" in line
            assert f"in use; choose another address with [{service}] listen" in line
            taken.close()
            while True:
                try:
                    socket.create_connection((host, port), 1.0).close()
                    break
                except ConnectionRefusedError:
                    time.sleep(0.1)
            assert daemon.stop() < SOON_S
    assert sum("can't serve" in each for each in daemon.lines) == 1


def test_what_was_installed_is_removed_but_for_settings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["install-service", "--prefix", str(tmp_path)]) == 0
    assert main(["install-service", "--remove", "--prefix", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "systemctl disable --now imu-probe" in out
    left = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert left == [tmp_path / "etc/imud.toml"]
    assert main(["install-service", "--remove", "--prefix", str(tmp_path)]) == 0


@pytest.mark.parametrize(
    ("program", "private", "is_warned"),
    [
        ("/opt/imud/bin/imud", "yes", False),
        (f"{install.TEMPORARY[0]}/imud/bin/imud", "no", True),
    ],
)
def test_a_service_sees_its_own_program(
    program: str,
    private: str,
    is_warned: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It would not, in a folder for temporary files, if it had one of its own."""
    monkeypatch.setattr(install, "_program", lambda: Path(program))
    assert main(["install-service", "--prefix", str(tmp_path)]) == 0
    unit = (tmp_path / "etc/systemd/system/imu-probe.service").read_text()
    assert f"PrivateTmp={private}\n" in unit
    assert ("install imud elsewhere" in capsys.readouterr().err) == is_warned


def test_what_is_installed_is_whole_and_says_what_starts_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["install-service", "--prefix", str(tmp_path)]) == 0
    assert "systemctl enable --now imu-probe" in capsys.readouterr().out
    assert main(["config", "--check", str(tmp_path / "etc/imud.toml")]) == 0
    unit = tmp_path / "etc/systemd/system/imu-probe.service"
    assert unit.exists()
    assert not unit.with_name("imud.service").exists()  # which another project has


@pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="another init than systemd is used"
)
def test_the_unit_can_be_taken_by_systemd(tmp_path: Path) -> None:
    assert main(["install-service", "--prefix", str(tmp_path)]) == 0
    units = [*(tmp_path / "etc/systemd/system").glob("imu-probe*.service")]
    assert len(units) == 2
    subprocess.run(["systemd-analyze", "verify", *units], check=True)
    security = ["systemd-analyze", "security", "--offline=true", "--no-pager"]
    # 2.0 of 10 is the threshold, in tenths; the command fails above it.
    subprocess.run(
        [*security, "--threshold=20", *units], check=True, stdout=subprocess.DEVNULL
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
    # Boards only: a chip that may be anybody's may be a modem's.
    boards = [adapter for adapter in ADAPTERS if adapter.is_board]
    assert rules.count('ENV{ID_MM_DEVICE_IGNORE}="1"') == len(boards) > 5
    assert "1a86" not in rules
    assert "imu-probe/by-id/" in rules
    assert "imu-probe/by-path/" in rules


def test_the_journal_of_systemd_has_levels_and_no_time(tmp_path: Path) -> None:
    read, write = os.pipe()
    file = os.fstat(write)
    (tmp_path / "imud.toml").write_text("[ports]\nfind=false\nnamed=['/dev/none']\n")
    environment = os.environ | {"JOURNAL_STREAM": f"{file.st_dev}:{file.st_ino}"}
    with subprocess.Popen(
        [
            *(sys.executable, "-m", "imud", "run", "--no-log", "--no-page"),
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
