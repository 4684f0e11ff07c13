# SPDX-License-Identifier: MIT
"""Problems of a probe's sensors, on the page in Chromium."""

from __future__ import annotations

from streaming import until
from web.desk import Desk, Seen

ADVICE = "accelerometer and gyroscope not calibrated: Calibrate, all sensors"
FAKE = "no magnetometer in this module (an MPU-6500 sold as an MPU-9250): no heading"
FAILED = (
    "the gyroscope failed its self-test (by the probe's own self-test): don't trust "
    "poses; replace the module"
)
ABSENT = "no answer at 0x68: check power, SDA, SCL, AD0 to GND"


def chips(shown: Seen) -> list[list[str]]:
    """The sentences of the view, each with its colour."""
    return shown.page.locator('[data-part="concerns"] .chip').evaluate_all(
        "chips => chips.map(chip => [chip.textContent, chip.classList[1]])"
    )


def tell(desk: Desk, **hello: object) -> None:
    desk.probe.hello_fields = desk.probe.hello_fields | hello
    desk.hand.say("hello", "params")


def test_a_missing_magnetometer_is_named_and_not_to_be_calibrated(
    shown: Seen, desk: Desk
) -> None:
    tell(desk, sensor="mpu6500", who_am_i=(0x70, 0))
    until(lambda: chips(shown) == [[FAKE, "warn"], [ADVICE, "warn"]])
    shown.page.get_by_role("link", name="Probes", exact=True).click()
    until(lambda: chips(shown) == [[FAKE, "warn"], [ADVICE, "warn"]])
    shown.page.get_by_role("link", name="Probe", exact=True).click()


def test_a_failed_self_test_is_red_in_words_and_as_a_flag(
    shown: Seen, desk: Desk
) -> None:
    tell(desk, self_test=("acc_passed", "gyr_failed"))
    until(lambda: chips(shown)[:2] == [[FAKE, "bad"], [FAILED, "bad"]])
    shown.page.locator('[data-part="flags"]').get_by_text("self-test failed").wait_for()


def test_a_sensor_that_is_not_there_is_named_without_advice(
    shown: Seen, desk: Desk
) -> None:
    desk.hand.state = "fault"
    desk.hand.say("event", event="bus_fault", cause="nack", detail=0)
    until(lambda: chips(shown) == [[ABSENT, "bad"]])
