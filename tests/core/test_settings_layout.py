# SPDX-License-Identifier: MIT
"""The layout of a slot, and what is refused in one with a good CRC."""

from __future__ import annotations

from typing import Any

import pytest

from core.settings_desk import SIZE, Memory, Probe, ffi, lib, saved

PAYLOAD = ffi.sizeof("struct settings")


def crc(data: bytes) -> int:
    """CRC-16 of the document: 0x1021, first bit first, from 0xFFFF."""
    register = 0xFFFF
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = register << 1 ^ (0x1021 if register & 0x8000 else 0)
            register &= 0xFFFF
    return register


def forged(
    payload: bytes, version: int | None = None, length: int | None = None
) -> Memory:
    header = bytes(
        [
            lib.SETTINGS_VERSION if version is None else version,
            PAYLOAD if length is None else length,
            9,
        ]
    )
    slot = header + payload + crc(header + payload).to_bytes(2, "little")
    return Memory((slot + b"\xff" * SIZE)[:SIZE])


def test_a_slot_is_laid_out_as_documented():
    _, image = saved(3)
    probe = Probe(forged(image))
    assert probe.loaded == lib.SETTINGS_OK
    assert probe.image == image


@pytest.mark.parametrize(("version", "length"), [(0, None), (2, None), (255, None),
                                                 (None, 0), (None, PAYLOAD - 1),
                                                 (None, PAYLOAD + 1)])  # fmt: skip
def test_another_version_or_length_is_refused(version, length):
    image = saved(3)[1]
    assert Probe(forged(image, version, length)).loaded == lib.SETTINGS_NONE


def spoil_calibration(settings: Any) -> None:
    settings.calibration.mag.matrix[2][0] = 32_767
    settings.calibration.mag.matrix[2][1] = 32_767


@pytest.mark.parametrize(
    "spoil",
    [
        lambda settings: setattr(settings, "pose_rate_hz", 0),
        lambda settings: setattr(settings, "pose_rate_hz", 1001),
        lambda settings: setattr(settings, "raw_rate_hz", 0),
        lambda settings: setattr(settings, "raw_rate_hz", 65535),
        lambda settings: setattr(settings, "streams", 4),
        spoil_calibration,
    ],
)
def test_values_out_of_range_are_refused_and_the_older_slot_taken(spoil):
    memory = Memory()
    probe = Probe(memory)
    good = probe.change(1)
    assert probe.save() == lib.SETTINGS_OK
    spoil(probe.settings)
    assert not lib.settings_are_valid(probe.settings)
    assert probe.save() == lib.SETTINGS_OK
    probe = Probe(memory)
    assert probe.loaded == lib.SETTINGS_OK
    assert probe.image == good
    # The refused slot is the next to be written.
    last = probe.change(2)
    assert probe.save() == lib.SETTINGS_OK
    assert Probe(memory).image == last


@pytest.mark.parametrize("rate", [1, 1000])
def test_rates_at_their_limits_are_valid(rate):
    probe = Probe(Memory())
    probe.settings.pose_rate_hz = probe.settings.raw_rate_hz = rate
    assert lib.settings_are_valid(probe.settings)
