# SPDX-License-Identifier: MIT
"""The place of the probes: its magnetic field, and true north."""

from __future__ import annotations

import datetime
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.calibration.simulated import recorded
from configured import running
from fakes import PATIENCE_S, FakeProbe, status_of
from imud import rotation
from imud.calibration.earth import Earth, earth_at, strangeness, with_field
from imud.calibration.guided import whole
from imud.calibration.guided.result import result_of_fit
from imud.client import Client, subscribe
from imud.config.reader import load
from imud.config.settings import Config, PlaceSettings
from imud.daemon.params_watch import ParamsWatch
from imud.daemon.registry import Registry
from imud.errors import ConfigError
from imud.params.value import ROOM, Params, ParamsRecord
from imud.probes.north import North
from imud.virtual.calibrating import SCALE
from imud.wire.params import calibrated_by
from raw_probe import calibrating

DAY = datetime.date(2026, 7, 2)
WARSAW = Earth(50.575, 68.32, 7.0)


def test_the_model_gives_the_field_of_its_test_values() -> None:
    """WMM2025 at 80 N, 0 E, 0 km, 2025.0: X 6521.6, Y 145.9, Z 54791.5 nT."""
    found = earth_at(80.0, 0.0, 0.0, datetime.date(2025, 1, 1))
    x, y, z = 6521.6, 145.9, 54791.5
    assert found.declination_deg == pytest.approx(
        math.degrees(math.atan2(y, x)), abs=0.002
    )
    level = math.hypot(x, y)
    assert found.dip_deg == pytest.approx(math.degrees(math.atan2(z, level)), abs=0.002)
    assert found.norm_uT == pytest.approx(math.hypot(level, z) / 1000.0, abs=0.001)


def test_it_goes_on_after_the_models_end() -> None:
    assert earth_at(52.2, 21.0, 100.0, datetime.date(2033, 1, 1)).norm_uT > 45.0


@pytest.mark.parametrize(
    ("norm", "dip", "words"),
    [
        (50.0, 68.0, None),
        (56.0, 71.0, None),
        (57.7, 68.0, "14 % too strong: iron nearby"),
        (40.0, 68.0, "21 % too weak"),
        (50.0, 75.0, "7 degrees too steep"),
        (50.0, 60.0, "8 degrees too flat"),
    ],
)
def test_a_field_that_is_not_of_the_place_is_strange(
    norm: float, dip: float, words: str | None
) -> None:
    found = strangeness(WARSAW, norm, dip)
    assert found is None if words is None else words in (found or "")


def test_the_place_gives_the_magnetometer_its_scale() -> None:
    fit = whole.fit(recorded(calibrating()))
    here = Earth(50.0, fit.mag.dip_deg, 0.0)
    found = result_of_fit(fit, SCALE, Params(), earth=here)
    assert found.note is None
    assert found.params.mag.norm_ut == pytest.approx(50.0, abs=0.01)
    away = result_of_fit(fit, SCALE, Params(), earth=other_norm(here))
    assert away.note is not None
    assert "iron nearby" in away.note
    assert away.params.mag.norm_ut == pytest.approx(fit.mag.norm_ut, abs=0.01)


def test_the_place_is_stated_until_a_calibration_states_its_errors() -> None:
    """Also after the probe was carried to another place, beside what else there is."""
    tip = Params().replaced("tip", {"offset_m": (0.1, 0.0, 0.0), "method": "typed"})
    records = with_field(tip.encode(), WARSAW)
    here, sydney = Params.decode(records), Earth(57.0, -64.4, 12.6)
    assert here.mag.norm_ut == pytest.approx(WARSAW.norm_uT, abs=0.01)
    assert here.mag.dip_deg == pytest.approx(WARSAW.dip_deg, abs=0.01)
    assert here.without("mag") == tip
    assert calibrated_by(records) == []
    assert with_field(records, WARSAW) == records
    there = Params.decode(with_field(records, sydney))
    assert there.mag.dip_deg == pytest.approx(-64.4, abs=0.01)
    typed = here.plain("mag") | {"bias_counts": (9.0, 0.0, 0.0)}
    assert calibrated_by(here.replaced("mag", typed).encode()) == ["mag"]
    found = here.replaced("mag", typed | {"sigma_uT": 0.8, "norm_uT": None}).encode()
    full = Params((ParamsRecord(200, bytes(ROOM - 8)),)).encode()
    for other in (found, full, b"torn"):
        assert with_field(other, sydney) == other


def test_each_probe_is_sent_the_place_once_and_one_asks_for_it() -> None:
    registry = Registry(Config())
    watch = ParamsWatch(registry, None)  # type: ignore[arg-type]  # publishes nothing
    for name in ("1" * 16, "2" * 16):
        entry = registry.add(name)
        entry.is_alive, entry.probe.params_digest = True, 0
        entry.probe.hello = FakeProbe().hello_fields
    first, other = registry
    assert list(watch.unplaced()) == [(first, b"")]
    assert list(watch.unplaced()) == []
    registry.configure(
        Config(place=PlaceSettings(latitude_deg=52.2, longitude_deg=21.0))
    )
    located = with_field(b"", first.earth)
    assert list(watch.unplaced()) == [(first, located), (other, located)]
    assert list(watch.unplaced()) == []


def other_norm(earth: Earth) -> Earth:
    return Earth(30.0, earth.dip_deg, 0.0)


def test_poses_turn_to_true_north() -> None:
    """A probe that points to magnetic north points by the declination east of it."""
    north = North(7.0)
    ahead = rotation.from_heading_pitch_roll(math.pi / 2, 0.1, 0.2)
    values = {
        "q": tuple(ahead.tolist()),
        "position_m": (0.0, 2.0, 1.0),
        "normal": None,
        "flags": (),
    }
    turned = north.turned(values)
    yaw, pitch, roll = rotation.to_yaw_pitch_roll(np.array(turned["q"]))
    assert math.degrees(yaw) == pytest.approx(90.0 - 7.0)
    assert (pitch, roll) == pytest.approx((0.1, 0.2))
    east = 2.0 * math.sin(math.radians(7.0))
    assert turned["position_m"][0] == pytest.approx(east)
    assert turned["position_m"][2] == 1.0
    assert turned["normal"] is None
    for flag in ("tared", "heading_free"):
        assert north.turned(values | {"flags": (flag,)})["q"] == values["q"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("latitude_deg = 52", "longitude_deg"),
        ("longitude_deg = 21", "latitude_deg"),
        ("latitude_deg = 91\nlongitude_deg = 0", "latitude_deg"),
        ('north = "true"', "true north needs latitude_deg and longitude_deg"),
    ],
)
def test_half_a_place_is_a_mistake(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "imud.toml"
    path.write_text(f"[place]\n{text}\n")
    with pytest.raises(ConfigError, match=words):
        load(path)


def test_a_daemon_publishes_true_north_and_the_field(tmp_path: Path) -> None:
    place = '[place]\nlatitude_deg = 52.2\nlongitude_deg = 21.0\nnorth = "true"\n'
    with (
        running(tmp_path, place) as (daemon, probe, port),
        Client(daemon.endpoint) as client,
    ):
        client.wait_for(seconds=PATIENCE_S)
        while not probe.params.records:  # the daemon sends the field
            port.write(port.answers(probe))
        found = status_of(client)["place"]
        assert found["declination_deg"] == pytest.approx(7.0, abs=0.5)
        assert found["norm_uT"] == pytest.approx(50.6, abs=0.5)
        sent = Params.decode(probe.params.records).mag
        assert sent.norm_ut == pytest.approx(found["norm_uT"], abs=0.01)
        with subscribe(endpoint=daemon.endpoint) as poses:
            pose = None
            while pose is None:
                port.write(port.answers(probe) + probe.poses(1))
                pose = poses.get(0.1)
    magnetic = rotation.angles_deg((0.5, 0.5, -0.5, 0.5), "nautical")
    assert pose.yaw_pitch_roll_deg[0] == pytest.approx(
        magnetic.yaw_deg - found["declination_deg"], abs=1e-6
    )
