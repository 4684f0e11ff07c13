# SPDX-License-Identifier: MIT
"""The end of a calibration in the page."""

from __future__ import annotations

from benchmarks.calibration.simulated import affine_errors
from imud.calibration.affine import affine_of
from imud.params.value import Params
from imud.virtual.calibrating import SCALE
from raw_probe import module
from web.desk import Desk, Seen


def apply_and_undo(shown: Seen, desk: Desk) -> None:
    """Judges the calibration under way, applies it, and takes it back."""
    page = shown.page
    page.get_by_role("button", name="Finish now").click()
    page.get_by_text("not active yet").wait_for()
    assert not desk.probe.params.records
    page.get_by_role("button", name="Apply").click()
    page.get_by_text("The calibration is active").wait_for()
    found = Params.decode(desk.probe.params.records)
    acc, mag = found.calibration("acc"), found.calibration("mag")
    left = affine_errors(
        module(), affine_of(acc, SCALE.acc_m_s2), affine_of(mag, SCALE.mag_ut)
    )
    assert left["tilt"] < 0.1
    page.locator("button:enabled").get_by_text("Undo", exact=True).click()
    page.get_by_text("The previous params are active again").wait_for()
    assert not desk.probe.params.records
