# SPDX-License-Identifier: MIT
"""The page of a daemon, and that of `imud view` for a daemon elsewhere."""

from __future__ import annotations

import json
import socket
import subprocess
from pathlib import Path

import pytest
from websockets.sync.client import connect

from chain import Chain
from fakes import DaemonProcess, FakeProbe, Forked, Port
from imud.config import reader
from imud.errors import ConfigError
from web.served import Live


def test_a_taken_port_is_one_line_and_the_page_comes_when_it_is_free(
    tmp_path: Path,
) -> None:
    port, probe = Port(tmp_path / "port"), FakeProbe()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        daemon = DaemonProcess(
            *(port.path, "--page", address), directory=tmp_path, page=None
        )
        with daemon:
            daemon.expect(
                f"warning: can't serve the page on {address}: Address .* in use; "
                "choose another address with --page"
            )
            port.wait_open()
            port.write(probe.say("hello"))
            daemon.expect("found on")
            taken.close()
            daemon.expect(f"the page is at http://{address}")
            daemon.stop()
            assert sum("can't serve" in line for line in daemon.lines) == 1
    port.vanish()


def test_view_serves_a_daemon_elsewhere_and_passes_commands_on(tmp_path: Path) -> None:
    chain = Chain(tmp_path)
    view = Forked(
        *("-m", "imud", "view", "--no-open"),
        *("--connect", chain.daemon.endpoint, "--page", "127.0.0.1:0"),
        stdout=subprocess.PIPE,
    )
    try:
        url = view.stdout.readline().rpartition(" ")[2].strip()
        socket_url = url.replace("http", "ws", 1) + "/live"
        with connect(socket_url, origin=url, max_size=None) as connection:
            browser = Live(connection)
            assert browser.next("page")["connect"] == chain.daemon.endpoint
            assert browser.next("status")["probe"] == chain.probe.name
            chain.port.write(chain.probe.poses(3))
            assert browser.next("pose")["number"] >= 1
            with chain.serving():
                browser.say(do="ask", id=1, probe=chain.probe.name, command="start")
                assert browser.next("answer")["answer"]["ok"]
            browser.say(do="ask", id=2, probe=chain.probe.name, command="fly")
            assert "there is no command" in browser.next("answer")["error"]
    finally:
        view.kill()
        view.communicate()
        chain.close()


@pytest.mark.parametrize(
    "listen", ["0.0.0.0:8735", "192.0.2.1:8735", "[::]:1", "8735", "127.0.0.1"]
)
def test_the_page_listens_on_this_machine_only(tmp_path: Path, listen: str) -> None:
    path = tmp_path / "imud.toml"
    path.write_text(f'[web]\nlisten = "{listen}"\n')
    with pytest.raises(ConfigError, match=r"\[web\] listen"):
        reader.load(path)
    with pytest.raises(ConfigError, match=r"\[web\] listen"):
        reader.load(None, page=listen)


def test_the_page_gets_what_is_published(tmp_path: Path) -> None:
    chain = Chain(tmp_path, page=True)
    try:
        line = next(each for each in chain.daemon.lines if "the page is at" in each)
        url = line.rpartition(" ")[2]
        heard = chain.hear("pose")
        with connect(url.replace("http", "ws", 1) + "/live", origin=url) as connection:
            browser = Live(connection)
            browser.say(do="watch", every=[[chain.probe.name, "pose"]])
            browser.next("status")
            chain.port.write(chain.probe.poses(5))
            for _ in range(5):
                assert browser.next("pose") == json.loads(heard.get())
    finally:
        chain.close()
