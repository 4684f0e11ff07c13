# SPDX-License-Identifier: MIT
"""A probe's settings in a configuration file, against the firmware that gets them."""

from __future__ import annotations

import itertools
import tomllib

import msgspec
import pytest

from core import desk
from core.desk import lib
from core.probe_bench import MPU9250, Bench
from imud.config.reader import as_toml
from imud.config.settings import Config, ProbeSettings
from imud.config.toml import mistakes
from imud.daemon.commands import arguments_of, orders_of
from imud.wire import schema

STREAMS = ("pose", "raw")


def replies(settings: ProbeSettings, bench: Bench) -> list[int]:
    """The firmware's result of each command that these settings become."""
    return [
        bench.command(schema.Command[name.upper()], *arguments_of(name, parameters))[0]
        for name, parameters in orders_of(settings, {})
    ]


@pytest.mark.parametrize("sensor", [MPU9250, desk.identity_of(rate_hz=380)])
def test_each_value_that_imud_config_shows_is_accepted_by_the_firmware(sensor):
    text = as_toml(Config())
    lines = text[text.index("# name = ") :].splitlines()
    shown = tomllib.loads("\n".join(line.removeprefix("# ") for line in lines))
    assert shown.keys() == set(ProbeSettings.__struct_fields__)
    settings = msgspec.convert(shown, ProbeSettings)
    bench = Bench().find_sensor(sensor)
    commands = [name for name, _ in orders_of(settings, {})]
    assert commands == ["rate", "rate", "fields"]
    assert replies(settings, bench) == [lib.RESULT_OK] * 3


@pytest.mark.parametrize("rate_hz", [-1, 0, 1, 1000, 1001])
@pytest.mark.parametrize("key", ["pose_rate", "raw_rate"])
def test_a_rate_may_be_in_a_file_just_where_the_firmware_accepts_it(key, rate_hz):
    """Before its sensor is known: at most that one's rate is accepted later."""
    is_allowed = not mistakes({key: rate_hz}, ProbeSettings)
    (result,) = replies(ProbeSettings(**{key: rate_hz}), Bench())
    assert is_allowed == (result == lib.RESULT_OK)


@pytest.mark.parametrize("count", range(len(STREAMS) + 1))
def test_streams_may_be_in_a_file_just_where_the_firmware_accepts_them(count):
    for streams in itertools.combinations(STREAMS, count):
        is_allowed = not mistakes({"streams": list(streams)}, ProbeSettings)
        (result,) = replies(ProbeSettings(streams=streams), Bench())
        assert is_allowed == (result == lib.RESULT_OK)
