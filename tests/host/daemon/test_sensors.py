# SPDX-License-Identifier: MIT
"""Problems of a probe's sensors are reported in words in the status, the journal and
the commands."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from chain import Chain
from fakes import FakeProbe, Forked, messages
from imud.probes.chip import chip_of
from imud.probes.self_test import verdicts_of
from imud.probes.sensors import (
    findings_of,
    has_magnetometer,
    identity_words,
    missing_magnetometer,
    sensor_words,
)
from imud.recordings.decode import Tally, decode_file, words

FAKE = "no magnetometer in this module (an MPU-6500 sold as an MPU-9250): no heading"
ABSENT = "no answer at 0x68: check power, SDA, SCL, AD0 to GND"
JUDGED = {"self_test": ("host_judges",)}
# The y axis of the accelerometer answers nothing.
DEAD_Y = {"stimulated": (6500, 339, 22800, 8000, -7900, 8150)}
DEAD_WORDS = (
    "the accelerometer failed its self-test (y response 0 mg, expected 204 to 611): "
    "don't trust tilt; replace the module"
)


def hello_of(sensor: str, *who_am_i: int, **fields: Any) -> dict[str, Any]:
    return messages.HELLO | {"sensor": sensor, "who_am_i": who_am_i} | fields


def becomes(chain: Chain, sensor: str, *who_am_i: int, **fields: Any) -> None:
    """The probe of a chain says that it has that sensor."""
    changed = {"sensor": sensor, "who_am_i": who_am_i} | fields
    chain.probe.hello_fields = chain.probe.hello_fields | changed
    chain.port.write(chain.probe.say("hello"))


def output_of(chain: Chain, *names: str) -> str:
    """The output of a command of imud."""
    words = ("-m", "imud", *names, "--connect", chain.daemon.endpoint)
    with Forked(*words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as program:
        return program.communicate()[0]


@pytest.mark.parametrize(
    ("hello", "words"),
    [
        (hello_of("mpu9250", 0x71, 0x48), ""),
        (hello_of("mpu9250", 0x75, 0x48), ""),
        (hello_of("lsm9ds0", 0xD4, 0x49), ""),
        (hello_of("mpu9250", 0, 0), ""),
        (hello_of("mpu6500", 0x70, 0), FAKE),
        (
            hello_of("mpu6500", 0x71, 0),
            "the magnetometer of this MPU-9250 does not answer: no heading; switch the "
            "power off and on; if that does not help, replace the module",
        ),
        (
            hello_of("mpu9250", 0x73, 0),
            "the magnetometer of this MPU-9255 does not answer: no heading; switch the "
            "power off and on; if that does not help, replace the module",
        ),
        (
            hello_of("lsm9ds0", 0xD4, 0),
            "the magnetometer of this LSM9DS0 does not answer: no heading; switch the "
            "power off and on; if that does not help, replace the module",
        ),
        (hello_of("lsm6dsox", 0x6C, 0x3D), ""),
        (hello_of("lsm6dsv16x", 0x70, 0x3D), ""),
        (
            hello_of("lsm6dsv16x", 0x70, 0),
            "no LIS3MDL answers beside this sensor (at 0x1C or 0x1E), or it measures "
            "nothing: no heading",
        ),
        (
            hello_of("lsm6dsox", 0x6C, 0),
            "no LIS3MDL answers beside this sensor (at 0x1C or 0x1E), or it measures "
            "nothing: no heading",
        ),
        (
            hello_of("mpu6500", 0x74, 0),
            "no magnetometer in this module (it answers 0x74 (MPU-6515); an MPU-9250 "
            "answers 0x71): no heading",
        ),
        (
            hello_of("mpu6500", 0x75, 0),
            "no magnetometer in this module (it answers 0x75; an MPU-9250 answers "
            "0x71): no heading",
        ),
        (hello_of("none", 0, 0), "no sensor was found"),
    ],
)
def test_a_missing_magnetometer_is_explained(hello: dict[str, Any], words: str) -> None:
    assert missing_magnetometer(hello) == words
    assert has_magnetometer(hello) == (not words)


def test_a_relative_has_limits_of_its_own() -> None:
    found = [chip_of(hello_of("lsm6dsox", who, 0x3D)) for who in (0x6B, 0x6C, 0)]
    assert [each.acc_noise_mg for each in found] == [3.0, 5.0, 5.0]
    assert chip_of(hello_of("mpu9250", 0x6B, 0)).acc_noise_mg == 8.0


def test_two_chips_of_one_identity_are_told_apart_by_their_driver() -> None:
    found = [chip_of(hello_of(word, 0x70, 0)) for word in ("mpu6500", "lsm6dsv16x")]
    assert [each.name for each in found] == ["MPU-9250", "LSM6DSV16X"]
    assert identity_words(0x70, "mpu6500") == "0x70 (MPU-6500)"
    assert identity_words(0x70) == "0x70 (MPU-6500 or LSM6DSV16X or LSM6DSV)"


@pytest.mark.parametrize(
    ("hello", "words"),
    [
        (hello_of("mpu9250", 0x73, 0x48), "mpu9250"),
        (hello_of("mpu6500", 0x70, 0), "mpu6500"),
        (hello_of("lsm6dsox", 0x6C, 0x3D), "lsm6dsox"),
        (hello_of("lsm6dsox", 0x6B, 0x3D), "lsm6dsox, answers 0x6B (ISM330DHCX)"),
        (hello_of("lsm6dsv16x", 0x70, 0x3D), "lsm6dsv16x (untried)"),
        (hello_of("mpu6500", 0x78, 0), "mpu6500, answers 0x78 (MPU-6880)"),
        (hello_of("mpu9250", 0x75, 0x48), "mpu9250, answers 0x75"),
    ],
)
def test_an_unusual_identity_is_told(hello: dict[str, Any], words: str) -> None:
    assert sensor_words(hello) == words


def test_an_untried_chip_is_told_wherever_faults_are() -> None:
    (found,) = findings_of(hello_of("lsm6dsv16x", 0x70, 0x3D), [])
    assert found.words.startswith("LSM6DSV16X or LSM6DSV: untried, ")
    assert not found.is_fault


def test_nothing_is_said_of_a_sensor_that_is_not_found_yet() -> None:
    hello = hello_of("none", 0, 0, self_test=("host_judges",))
    assert findings_of(hello, verdicts_of(hello, None)) == []


def test_a_failed_self_test_is_told_once_a_boot_and_flags_poses(chain: Chain) -> None:
    poses = chain.hear("pose")
    chain.probe.hello_fields = chain.probe.hello_fields | JUDGED
    chain.port.write(chain.probe.say("hello") + chain.probe.say("self_test", **DEAD_Y))
    line = chain.daemon.expect("failed its self-test")
    assert line.split(" ", 1)[1] == f"warning: probe {chain.probe.name}: {DEAD_WORDS}"
    status = chain.status_when(lambda status: status["sensors"]["flags"])
    assert status["sensors"]["words"] == [DEAD_WORDS]
    verdicts = status["sensors"]["self_test"]
    assert {name: of["outcome"] for name, of in verdicts.items()} == {
        "accelerometer": "failed",
        "gyroscope": "passed",
        "magnetometer": "passed",
    }
    chain.port.write(chain.probe.say("pose"))
    flags = json.loads(poses.get())["flags"]
    assert flags == ["at_rest", "self_test_failed"]
    assert f"{chain.probe.name}: {DEAD_WORDS}\n" in output_of(chain, "list")
    again = chain.probe.say("hello") + chain.probe.say("self_test", **DEAD_Y)
    chain.port.write(again + chain.probe.say("event"))
    chain.daemon.expect("stream started")
    assert sum(DEAD_WORDS in line for line in chain.daemon.lines) == 1
    chain.probe.restart()
    chain.port.write(chain.probe.say("hello") + chain.probe.say("self_test", **DEAD_Y))
    chain.daemon.expect("restarted on")
    chain.daemon.expect("failed its self-test")


def test_the_responses_of_the_boot_before_are_forgotten(chain: Chain) -> None:
    chain.probe.hello_fields = chain.probe.hello_fields | JUDGED
    chain.port.write(chain.probe.say("hello") + chain.probe.say("self_test", **DEAD_Y))
    chain.status_when(lambda status: status["sensors"]["flags"])
    chain.probe.restart()
    chain.port.write(chain.probe.say("hello"))
    status = chain.status_when(lambda status: not status["sensors"]["flags"])
    assert status["sensors"]["self_test"]["accelerometer"] == {
        "outcome": "not judged",
        "reason": "its responses were not received",
    }
    assert status["sensors"]["words"] == []


def test_a_module_without_magnetometer_is_named_and_not_to_be_calibrated(
    chain: Chain,
) -> None:
    chain.port.write(chain.probe.say("params"))
    chain.status_when(
        lambda status: "magnetometer" in status["params"].get("advice", "")
    )
    becomes(chain, "mpu6500", 0x70, 0)
    line = chain.daemon.expect("no magnetometer in this module")
    assert line.split(" ", 1)[1] == f"warning: probe {chain.probe.name}: {FAKE}"
    status = chain.status_when(lambda status: status["sensors"]["words"] == [FAKE])
    advice = "accelerometer and gyroscope not calibrated: imud calibrate"
    assert status["params"]["advice"] == advice
    listed = output_of(chain, "list")
    assert f"{chain.probe.name}: {FAKE}\n{chain.probe.name}: {advice}\n" in listed
    assert FAKE in output_of(chain, "monitor", "--seconds", "1.5")
    refusal = f"imud: probe {chain.probe.name}: {FAKE}\n"
    assert output_of(chain, "calibrate", "mag", chain.probe.name) == refusal
    assert not chain.probe.commands


def test_a_sensor_that_does_not_answer_is_named_until_it_does(chain: Chain) -> None:
    probe = chain.probe
    chain.port.write(probe.say("params"))
    chain.status_when(lambda status: status["params"].get("advice"))
    fault = {"event": "bus_fault", "cause": "nack", "detail": 0}
    chain.port.write(probe.say("event", **fault) + probe.say("status", state="fault"))
    line = chain.daemon.expect("bus fault")
    words = f"warning: probe {probe.name}: bus fault: {ABSENT}"
    assert line.split(" ", 1)[1] == words
    status = chain.status_when(lambda status: status["sensors"]["words"] == [ABSENT])
    assert status["params"]["advice"] == ""
    assert not status["sensors"]["is_working"]
    assert f"{probe.name}: {ABSENT}\n" in output_of(chain, "list")
    refusal = f"imud: probe {probe.name} can not be calibrated: {ABSENT}\n"
    assert output_of(chain, "calibrate", "mag", probe.name) == refusal
    good = {"event": "bus_recovered", "cause": "none", "detail": 1}
    chain.port.write(probe.say("event", **good) + probe.say("status"))
    status = chain.status_when(lambda status: status["sensors"]["is_working"])
    assert status["sensors"]["words"] == []
    assert "calibrate" in status["params"]["advice"]
    assert not [line for line in chain.daemon.lines if "its calibration is" in line]


def test_a_hello_in_the_midst_of_a_set_up_names_nothing_missing(chain: Chain) -> None:
    probe = chain.probe
    fault = {"event": "sensor_fault", "cause": "no_data_ready", "detail": 0}
    chain.port.write(probe.say("event", **fault))
    becomes(chain, "mpu9250", 0x71, 0)
    chain.port.write(probe.say("status", state="fault"))
    words = "the sensor signals no samples: check INT to D2, then power, SDA, SCL, AD0"
    chain.status_when(lambda status: words in "".join(status["sensors"]["words"]))
    becomes(chain, "mpu9250", 0x71, 0x48)
    good = {"event": "bus_recovered", "cause": "none", "detail": 1}
    chain.port.write(probe.say("event", **good) + probe.say("status"))
    chain.status_when(lambda status: status["sensors"]["is_working"])
    assert not [line for line in chain.daemon.lines if "magnetometer of" in line]


def test_one_failed_transfer_is_no_sensor_out_of_work(chain: Chain) -> None:
    fault = {"event": "bus_fault", "cause": "nack", "detail": 1}
    becomes(chain, "mpu6500", 0x70, 0)
    chain.status_when(lambda status: status["sensors"]["words"] == [FAKE])
    chain.port.write(chain.probe.say("event", **fault))
    chain.daemon.expect("bus fault: no answer at 0x68: check")
    status = chain.status_when(lambda status: status["sensors"]["words"] == [FAKE])
    assert status["sensors"]["is_working"]
    chain.port.write(chain.probe.say("event", **fault | {"detail": 5}))
    chain.status_when(lambda status: not status["sensors"]["is_working"])


def test_a_fault_whose_event_was_not_heard_is_told_all_the_same(chain: Chain) -> None:
    chain.port.write(chain.probe.say("status", state="fault"))
    status = chain.status_when(lambda status: not status["sensors"]["is_working"])
    words = ["the sensor does not work: restart the probe to find the reason"]
    assert status["sensors"]["words"] == words


@pytest.mark.parametrize(
    ("responses", "verdict"),
    [({}, "passed"), (DEAD_Y, "failed: y response 0 mg, expected 204 to 611")],
)
def test_a_capture_shows_the_same_verdict(
    tmp_path: Path, responses: dict[str, Any], verdict: str
) -> None:
    probe = FakeProbe(**JUDGED)
    path = tmp_path / "capture"
    path.write_bytes(probe.say("hello") + probe.say("self_test", **responses))
    record = list(decode_file(path, Tally()))[-1]
    assert f"verdicts accelerometer {verdict}; gyroscope passed" in words(record)
    assert record["type"] == "self_test"
    assert record["factory"] == messages.SELF_TEST["factory"]
    assert record["verdicts"] == {
        "accelerometer": verdict,
        "gyroscope": "passed",
        "magnetometer": "passed",
    }
