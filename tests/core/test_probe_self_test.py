# SPDX-License-Identifier: MIT
"""The sensor's responses to its self-test, as the probe sends them."""

from __future__ import annotations

from itertools import pairwise

from core.desk import ffi, lib
from core.params_desk import FULL
from core.probe_bench import MPU9250, Bench
from core.test_probe_params import change, go


def test_the_self_test_comes_in_turn_with_the_parts():
    bench = Bench()
    found = ffi.new("struct message_self_test *")
    found.before, found.factory = (1, 2, 3, 4, 5, 6), (7,) * 6
    found.mag_response = (-8, 9, -10)
    identity = ffi.new("struct sensor_identity *", MPU9250[0])
    identity.answers = found
    bench.find_sensor(identity)
    change(bench, FULL)
    go(bench, 2)
    start = len(bench.messages)
    bench.run(2 * (len(FULL) // lib.PARAMS_PART + 2), samples=False)
    turns = [m for m in bench.messages[start:] if m.name in ("params", "self_test")]
    told_at = [at for at, message in enumerate(turns) if message.name == "self_test"]
    parts = -(-len(FULL) // lib.PARAMS_PART)
    assert [b - a for a, b in pairwise(told_at)] == [parts + 1]
    assert list(turns[told_at[0]].fields["before"]) == [1, 2, 3, 4, 5, 6]
    assert list(turns[told_at[0]].fields["mag_response"]) == [-8, 9, -10]


def test_a_sensor_whose_driver_judges_has_no_self_test_to_send():
    bench = Bench().find_sensor()
    bench.run(5, samples=False)
    assert bench.of("params")
    assert not bench.of("self_test")
