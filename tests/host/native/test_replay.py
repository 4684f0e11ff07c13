# SPDX-License-Identifier: MIT
"""_core.Replay of any filter: the same bits as the firmware's own, from the start and
after a restart."""

from __future__ import annotations

import pytest

from core import desk
from core.desk import lib
from core.scenes import scene, tumble
from imud import _core
from replay_bench import KINDS, LSM6DSOX, LSM9DS0, SAMPLES, hello, poses, replayed


@pytest.mark.parametrize("kind", KINDS)
def test_the_hellos_filter_is_replayed_to_the_last_bit(kind):
    assert replayed(_core.Replay(hello(kind)), SAMPLES) == poses(kind, SAMPLES)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("identity", [LSM9DS0, LSM6DSOX], ids=["lsm9ds0", "lsm6dsox"])
def test_other_sensors_are_replayed_to_the_last_bit(kind, identity):
    rate_hz = identity.rate_hz
    rows = scene(tumble(8, rate_hz, 4), rate_hz, seed=4).samples(identity)
    replay = _core.Replay(hello(kind, identity))
    assert replayed(replay, rows) == poses(kind, rows, identity)


@pytest.mark.parametrize("sensor", [lib.SENSOR_NONE, lib.SENSOR_LSM6DSOX + 1, 255])
def test_a_hello_of_no_sensor_is_refused(sensor):
    unknown = desk.identity_of(kind=sensor)
    with pytest.raises(ValueError, match=f"sensor {sensor} is not one that can be"):
        _core.Replay(hello(lib.FILTER_FUSE, unknown))


def test_a_restart_begins_anew_with_the_filter_that_it_names():
    replay = _core.Replay(hello(lib.FILTER_FUSE))
    assert replayed(replay, SAMPLES[:700]) == poses(lib.FILTER_FUSE, SAMPLES[:700])
    for kind in reversed(KINDS):
        replay.restart(kind)
        assert replayed(replay, SAMPLES) == poses(kind, SAMPLES)


@pytest.mark.parametrize("kind", [0, 6, 255])
def test_a_hello_of_no_filter_is_refused(kind):
    with pytest.raises(ValueError, match=f"filter {kind} is not one that can be"):
        _core.Replay(hello(kind))


@pytest.mark.parametrize("kind", [-1, 0, 6, 256 + lib.FILTER_FUSE, 2**32 + 1])
def test_a_restart_of_no_filter_is_refused_and_changes_nothing(kind):
    replay = _core.Replay(hello(lib.FILTER_MAHONY))
    before = replayed(replay, SAMPLES[:100])
    with pytest.raises(ValueError, match=f"filter {kind} is not one that can be"):
        replay.restart(kind)
    after = replayed(replay, SAMPLES[100:200])
    assert before + after == poses(lib.FILTER_MAHONY, SAMPLES[:200])
