# SPDX-License-Identifier: MIT
"""`imud ports`: what is said of each port, adopting and releasing one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from imud.cli import main
from imud.cli import ports as room
from imud.daemon import install
from imud.machine import system
from imud.ports import adopted, local, udev
from ports_desk import Device

USB = Device("/dev/ttyUSB0", location="1-2")
OTHER = Device(
    "/dev/ttyUSB1", vid=0x403, pid=0x6001, serial_number="A9007UX1", location="1-3"
)


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    found = [USB, OTHER, Device("/dev/ttyS0", vid=None, pid=None)]
    monkeypatch.setattr(local.list_ports, "comports", lambda: found)
    file = tmp_path / "imud.toml"
    file.write_text(f"[ports]\nmemory = '{tmp_path / 'ports.json'}'\n")
    return str(file)


def test_a_port_is_adopted_seen_and_released(
    config: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ports", "--config", config]) == 0
    assert "imud ports adopt /dev/ttyUSB0" in capsys.readouterr().out
    assert main(["ports", "adopt", "/dev/ttyUSB0", "--config", config]) == 0
    assert "/dev/ttyUSB0 is ours from now on" in capsys.readouterr().out
    assert main(["ports", "--config", config, "adopt", "/dev/ttyUSB0"]) == 0
    assert "was ours already" in capsys.readouterr().out
    assert main(["ports", "--config", config, "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    by_port = {row["port"]: row for row in rows}
    assert by_port["/dev/ttyUSB0"]["standing"] == "adopted"
    assert by_port["/dev/ttyUSB0"]["is_opened"] is True
    assert by_port["/dev/ttyUSB1"]["is_opened"] is False
    assert main(["ports", "release", "/dev/ttyUSB0", "--config", config]) == 0
    assert "is left to other programs" in capsys.readouterr().out
    assert main(["ports", "release", "/dev/ttyUSB0", "--config", config]) == 0
    assert "was not ours" in capsys.readouterr().out


def test_what_can_not_be_adopted_is_refused_with_what_to_do(
    config: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ports", "adopt", "/dev/ttyS0", "--config", config]) == 1
    assert "give it explicitly: imud run /dev/ttyS0" in capsys.readouterr().err
    assert main(["ports", "adopt", "/dev/none", "--config", config]) == 1
    assert "/dev/none is not a serial port" in capsys.readouterr().err


@pytest.mark.usefixtures("config")
def test_root_adopts_for_the_service_and_modem_manager_hears_of_it(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(system, "is_administrator", lambda: True)
    monkeypatch.setattr(room, "SERVICE_SETTINGS", tmp_path / "etc" / "imud.toml")
    monkeypatch.setattr(room, "ROOT", tmp_path)
    monkeypatch.setattr(adopted, "SERVICE_FOLDER", tmp_path / "state")
    (tmp_path / "state").mkdir()
    assert main(["install-service", "--prefix", str(tmp_path)]) == 0
    capsys.readouterr()
    for port in (USB, OTHER):
        assert main(["ports", "adopt", port.device]) == 0
    assert "udevadm control --reload" in capsys.readouterr().out
    assert (tmp_path / "state" / "ports.json").exists()
    rules = (tmp_path / udev.ADOPTED_PLACE).read_text()
    assert (
        'ATTRS{idVendor}=="1a86", ATTRS{idProduct}=="7523", ENV{ID_PATH}=="*1-2"'
        in rules
    )
    assert 'ATTRS{serial}=="A9007UX1"' in rules
    assert install.remove(tmp_path) == 0
    assert not (tmp_path / udev.ADOPTED_PLACE).exists()


def test_a_device_can_not_write_rules_by_its_serial_number() -> None:
    evil = '"A", RUN+="/bin/sh'
    port = adopted.AdoptedPort(f"1a86:7523:{evil}", "x*", "CH340", "", "")
    assert "RUN" not in udev.adopted_rules([port])
