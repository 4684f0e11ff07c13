# SPDX-License-Identifier: MIT
"""Settings: what is said wins over what is not, and mistakes are named on one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from imud.config import Config, load
from imud.errors import ConfigError

WHOLE = """
ports = ["/dev/ttyUSB0", "/dev/ttyUSB1"]
baud = 115200
prefix = "lab/imud"
twin = true
listen = ["tcp/127.0.0.1:7500"]
[log]
enabled = true
dir = "/tmp/x"
[names]
00112233445566aa = "stylus"
"""


def written(path: Path, text: str) -> Path:
    file = path / "imud.toml"
    file.write_text(text)
    return file


def test_arguments_win_over_the_file_and_the_file_over_defaults(tmp_path: Path) -> None:
    file = written(tmp_path, WHOLE)
    config = load(file)
    assert config.names == {"00112233445566aa": "stylus"}
    assert (config.baud, config.log.dir) == (115200, "/tmp/x")  # noqa: S108 - a name
    config = load(file, ports=["/dev/x"], listen="tcp/127.0.0.1:1", log_dir=Path("l"))
    assert config.ports == ("/dev/x",)
    assert config.listen == ("tcp/127.0.0.1:1",)
    assert (config.log.dir, config.log.enabled) == ("l", True)
    assert (config.prefix, config.twin) == ("lab/imud", True)
    assert not load(file, is_logging=False).log.enabled


def test_nothing_said_is_loopback_and_a_log() -> None:
    config = load(None, ports=["/dev/x"])
    assert config == Config(ports=("/dev/x",))
    assert config.listen == ("tcp/127.0.0.1:7447",)
    assert config.log.enabled
    assert not config.twin
    assert load(None, ports=["/dev/x"], is_twin=True).twin


def test_a_port_may_have_a_rate_of_its_own() -> None:
    ports = ["/dev/a", "/dev/b@921600", "/dev/serial/by-id/c@d"]
    assert load(None, ports=ports).ports_and_bauds() == [
        ("/dev/a", 500_000),
        ("/dev/b", 921_600),
        ("/dev/serial/by-id/c@d", 500_000),
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ports = ['a', 'a@9600']", "a port is named twice"),
        ("ports = ['a@5000000']", "baud 5000000"),
        ("", "no port is named"),
        ("ports = ['a', 'a']", "a port is named twice"),
        ("ports = 'a'", r"Expected `array`, got `str` - at `\$.ports`"),
        ("ports = ['a']\nbuad = 9600", "unknown field `buad`"),
        ("ports = ['a']\n[log]\nfolder = 'x'", r"`folder` - at `\$.log`"),
        ("ports = ['a']\n[log]\nenabled = 'yes'", r"at `\$.log.enabled`"),
        ("ports = ['a']\nbaud = 0", "baud 0"),
        ("ports = ['a']\ntwin = 1", r"at `\$.twin`"),
        ("ports = ['a']\nprefix = 'a/*'", "prefix 'a/\\*'"),
        ("ports = ['a']\nlisten = []", "listen is empty"),
        ("ports = ['a']\n[names]\nstylus = 'x'", "names.stylus: an id is 16"),
        ("ports = ['a']\n[names]\n00112233445566aa = 'a/b'", "'a/b' can't be part"),
        (
            "ports = ['a']\n[names]\n00112233445566aa = 'x'\n00112233445566ab = 'x'",
            "two probes have one name",
        ),
        ("ports = [", "is not TOML"),
    ],
)
def test_a_mistake_is_named_on_one_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        load(written(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"can't read .*none\.toml: No such file"):
        load(tmp_path / "none.toml")
