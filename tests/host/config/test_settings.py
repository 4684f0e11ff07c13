# SPDX-License-Identifier: MIT
"""Settings: what is said wins over what is not, and mistakes are named on one line."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imud.cli import main
from imud.config.reader import as_toml, check, load
from imud.config.settings import (
    Config,
    LogSettings,
    PortSettings,
    ProbeSettings,
    port_and_baud,
)
from imud.errors import ConfigError

WHOLE = """
twin = true
[ports]
named = ["/dev/ttyUSB0", "/dev/ttyUSB1"]
rates = [115200]
[zenoh]
prefix = "lab/imud"
listen = ["tcp/127.0.0.1:7500"]
[log]
enabled = true
dir = "/tmp/x"
[probes.00112233445566aa]
name = "stylus"
"""


def written(path: Path, text: str) -> Path:
    file = path / "imud.toml"
    file.write_text(text)
    return file


def test_arguments_win_over_the_file_and_the_file_over_defaults(tmp_path: Path) -> None:
    file = written(tmp_path, WHOLE)
    config = load(file)
    assert config.name_of("00112233445566aa") == "stylus"
    assert config.name_of("00112233445566ab") == "00112233445566ab"
    assert (config.ports.rates, config.log.dir) == ((115200,), "/tmp/x")  # noqa: S108 - a name
    config = load(file, ports=["/dev/x"], listen="tcp/127.0.0.1:1", log_dir=Path("l"))
    assert (config.ports.named, config.ports.find) == (("/dev/x",), False)
    assert config.zenoh.listen == ("tcp/127.0.0.1:1",)
    assert (config.log.dir, config.log.enabled) == ("l", True)
    assert (config.zenoh.prefix, config.twin) == ("lab/imud", True)
    assert not load(file, is_logging=False).log.enabled


def test_nothing_said_is_loopback_and_a_log() -> None:
    config = load(None)
    assert config == Config()
    assert config.ports.find
    assert config.zenoh.listen == ("tcp/127.0.0.1:7447",)
    assert config.log.enabled
    assert not config.twin
    assert load(None, ports=["/dev/x"], is_twin=True).twin


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("/dev/a", ("/dev/a", None)),
        ("/dev/b@921600", ("/dev/b", 921_600)),
        ("/dev/serial/by-id/c@d", ("/dev/serial/by-id/c@d", None)),
    ],
)
def test_a_port_may_have_a_rate_of_its_own(
    text: str, found: tuple[str, int | None]
) -> None:
    assert port_and_baud(text) == found


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "[ports]\nnamed = ['a', 'a@9600']",
            ":2: [ports] named: a port is listed twice",
        ),
        ("[ports]\nnamed = ['a@5000000']", "[ports] named: baud 5000000 is not in 1.."),
        ("[ports]\nfind = false", ":2: [ports] find: is off and no port is listed"),
        ("[ports]\nnamed = 'a'", '"a" is not a list of: text in quotes'),
        (
            "\n[ports]\nnmed = ['a']",
            ":3: [ports] nmed: there is no such key; did you mean",
        ),
        ("[log]\nprefix = 'x'", "no such key here; did you mean [zenoh] prefix?"),
        ("[log]\nzzz = 'x'", "no such key; there are enabled, dir, "),
        ("[logs]\ndir = 'x'", ":1: logs: there is no such key; did you mean log?"),
        ("log = 7", ":1: log: it is a section: [log] on a line of its own"),
        ("[probes]\nname = 'x'", "[probes] name: it is a section: [probes.ID]"),
        ("[log]\nenabled = 'yes'", '[log] enabled: "yes" is not true or false'),
        ("[log]\nrotate_mb = 0", ":2: [log] rotate_mb: 0 is not a whole number, 1 or"),
        ("log.rotate_mb = 1.5", ":1: [log] rotate_mb: 1.5 is not a whole number"),
        ("[log]\nrotate_minutes = nan", "nan is not a number above 0"),
        ("[log]\ndir = 'x\\u0000'", None),
        ('[log]\ndir = "x\\u0000"', "has control characters"),
        ("[ports]\nrates = [0]", "[ports] rates: [0] is not a list of: a whole number"),
        ("twin = 1", ":1: twin: 1 is not true or false"),
        ("[zenoh]\nmode = 'x'", '"x" is not "router", "peer" or "client"'),
        ("[zenoh]\nprefix = 'a//b *'", "/ * $ # ? and no @ first; try a-b"),
        (
            "[zenoh]\nlisten = ['tcp/::1']",
            "'tcp/::1' is not an endpoint: try tcp/[::1]",
        ),
        (
            "[zenoh]\nconnect = ['h']",
            ":2: [zenoh] connect: 'h' is not an endpoint: try",
        ),
        ("[ros2]\nconnect = ['h']", ":2: [ros2] connect: 'h' is not an endpoint: try"),
        ("[web]\nlisten = '::1'", "is not HOST:PORT: try [::1]:8735"),
        ("[zenoh]\nlisten = []", "[zenoh] listen: is empty"),
        ("[metrics]\nlisten = '9735'", "is not HOST:PORT: try 127.0.0.1:9735"),
        (
            "[web]\norigins = ['https://a.example:8443', 'null', 'a.example/x']",
            ':2: [web] origins: "a.example/x" is not an origin such as https://example.org',
        ),
        (
            "[metrics]\nlisten = '0.0.0.0:9735'",
            "0.0.0.0 is reachable from other machines",
        ),
        (
            "[zenoh]\nkeys = 'k'\nlisten = []\n[foxglove]\nenabled = true",
            "Foxglove has no login",
        ),
        (
            "[openigtlink]\nenabled = true\nlisten = '0.0.0.0:18944'",
            "0.0.0.0 is reachable from other machines",
        ),
        (
            "[zenoh]\nkeys = 'k'\nlisten = []\n[openigtlink]\nenabled = true",
            "OpenIGTLink has no users",
        ),
        (
            "[openigtlink]\nenabled = true\n[probes.00112233445566aa]\n"
            "name = 'ultrasound'",
            ":4: [probes.00112233445566aa] name: 'ultrasound' does not fit",
        ),
        (
            "[openigtlink]\nenabled = true\n[probes.00112233445566aa]\n"
            "name = 'tip-1'\n[probes.00112233445566ab]\nname = 'Tip1'",
            "'Tip1' and 'tip-1' are both Tip1 in OpenIGTLink",
        ),
        ("[journal]\nquiet_s = -1", "-1 is not a number from 0 to 3600"),
        ("[probes.stylus]\nname = 'x'", ":1: [probes] stylus: an id has 16"),
        (
            "[probes.00112233445566aa]\npose_rate = 1001",
            ":2: [probes.00112233445566aa] pose_rate: 1001 is not a whole number from",
        ),
        (
            "[probes.00112233445566aa]\nraw_rate = 0",
            "raw_rate: 0 is not a whole number from 1 to 1000",
        ),
        (
            "[probes.00112233445566aa]\nstreams = []",
            'streams: [] is not a list of 1 or more: "pose" or "raw"',
        ),
        ("[probes.00112233445566aa]\nname = 'a/b'", "'a/b' can't be part"),
        ("[probes.00112233445566aa]\nname = '@b'", "'@b' can't be part"),
        (
            "[probes.00112233445566aa]\nname = '00112233445566ab'",
            '"00112233445566ab" could be the id of another probe',
        ),
        (
            "[probes.00112233445566aa]\nname = 'x'\n"
            "[probes.00112233445566ab]\nname = 'x'",
            ':4: [probes.00112233445566ab] name: "x" is also the name of another',
        ),
        ("ports = [", "is not TOML"),
        ("x = 2026-02-30", "is not TOML"),
        ("x = " + 5000 * "9", "is not TOML"),
        ("x = " + 3000 * "[", "is not TOML"),
    ],
)
def test_a_mistake_is_named_on_one_line(
    tmp_path: Path, text: str, words: str | None
) -> None:
    file = written(tmp_path, text)
    if words is None:
        load(file)
        return
    try:
        lines = check(file)
    except ConfigError as error:
        lines = [str(error)]
    assert any(words in line for line in lines), lines
    with pytest.raises(ConfigError) as caught:
        load(file)
    assert str(caught.value).isprintable()


def test_all_mistakes_of_a_file_are_told(tmp_path: Path) -> None:
    file = written(tmp_path, "twin = 3\n[log]\nrotate_mb = 0\nfoo = 1")
    first, *others = check(file)
    assert len(others) == 2
    with pytest.raises(ConfigError) as caught:
        load(file)
    assert str(caught.value) == f"{first} (and 2 more: imud config --check FILE)"


def test_what_is_printed_is_all_of_it_and_says_just_the_defaults(
    tmp_path: Path,
) -> None:
    text = as_toml(Config())
    assert load(written(tmp_path, text)) == Config()
    for section in Config.__struct_fields__:
        held = getattr(Config(), section)
        for key in getattr(held, "__struct_fields__", ()):
            assert re.search(rf"\n(# )?{key} = ", text)
    # What is commented out is TOML, too.
    start = text.index("# name = ")
    keys = "\n".join(line.removeprefix("# ") for line in text[start:].splitlines())
    load(written(tmp_path, f"[probes.00112233445566aa]\n{keys}"))


_TEXT = st.text(st.characters(exclude_categories=["C"]), max_size=20)


@given(
    st.builds(
        Config,
        twin=st.booleans(),
        ports=st.builds(PortSettings, named=st.lists(_TEXT, max_size=3).map(tuple)),
        log=st.builds(
            LogSettings,
            dir=_TEXT,
            rotate_minutes=st.floats(0, 240, exclude_min=True),
        ),
        probes=st.dictionaries(
            st.from_regex("[0-9a-f]{16}", fullmatch=True),
            st.builds(
                ProbeSettings,
                name=_TEXT,
                pose_rate=st.none() | st.integers(1, 1000),
                streams=st.sampled_from([None, ("raw",), ("pose",), ("pose", "raw")]),
            ),
            max_size=3,
        ),
    )
)
def test_any_settings_are_read_back_as_they_were_written(config: Config) -> None:
    assert msgspec.convert(tomllib.loads(as_toml(config)), Config) == config


def test_the_command_prints_and_checks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config"]) == 0
    file = written(tmp_path, capsys.readouterr().out)
    assert main(["config", "--check", str(file)]) == 0
    assert main(["config", "--check", str(written(tmp_path, "twin = 1"))]) == 1
    assert ":1: twin: 1 is not true" in capsys.readouterr().err
