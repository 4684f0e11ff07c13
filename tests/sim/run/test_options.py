# SPDX-License-Identifier: MIT
"""The virtual Nano reports each mistake in its options and files in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from nano_desk import NANO, image
from programs import ran


@pytest.fixture(scope="module")
def desk() -> Path:
    return image()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "--image is missing"),
        (["--image"], "value is missing"),
        (["--image", "x", "--pty", "a", "--record", "b"], "exclude each other"),
        (["--image", "x", "--now", "a"], "--now needs --pty and real time"),
        (["--image", "x", "--now", "a", "--pty", "b", "--fast"], "--now needs --pty"),
        (["--image", "{desk}", "--now", "/", "--pty", "b"], "/ can't be written"),
        (["--image", "x", "--reset-on-open"], "--reset-on-open needs --pty"),
        (["--image", "/nowhere"], "is no image"),
        (["--image", "/bin/true"], "is no image"),
        (["--image", "{desk}", "--press", "5:5"], "START_US:END_US"),
        (["--image", "{desk}", "--send", "5:123"], "TIME_US:HEXBYTES"),
        (["--image", "{desk}", "--seconds", "soon"], "takes a number"),
        (["--image", "{desk}", "--motion", "/dev/null"], "is no motion stream"),
        (["--image", "{desk}", "--eeprom", "{desk}"], "is no EEPROM"),
        (["--image", "{desk}", "--wings", "2"], "is no option"),
        (
            ["--image", "{desk}", "--sensor", "nones"],
            "--sensor is one of mpu9250",
        ),
        (["--image", "{desk}", "--ready", "nones"], "--ready is wire or none"),
        (["--self-test", "--fast"], "does not go with"),
    ],
)
def test_a_mistake_is_told_in_a_line(
    desk: Path, arguments: list[str], expected: str
) -> None:
    given = [argument.format(desk=desk) for argument in arguments]
    done = ran(NANO, *given)
    assert done.returncode == 2
    assert done.stderr.startswith("nano: ")
    assert expected in done.stderr.splitlines()[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{}", "list in brackets"),
        ('[{"at_us": 5}]', "has no kind"),
        ('[{"kind": "rain"}]', "no such kind of fault: rain"),
        ('[{"kind": "nack", "color": 5}]', "no such key: color"),
        ('[{"kind": "nack", "at_us": -5}]', "at_us is no whole number"),
        ('[{"kind": "nack", "byte": 300}]', "byte is above 255"),
        ('[{"kind": "nack"}', "comma or bracket"),
        ('[{"kind": "nack"} {"kind": "nack"}]', "comma or bracket"),
    ],
)
def test_a_mistake_in_the_faults_is_named(
    desk: Path, tmp_path: Path, text: str, expected: str
) -> None:
    path = tmp_path / "faults.json"
    path.write_text(text)
    done = ran(NANO, "--image", desk, "--faults", path)
    assert done.returncode == 2
    assert expected in done.stderr


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "is no Intel HEX file"),
        ("a bootloader", "is no Intel HEX file"),
        (":017E000000FF\n:00000001FF\n", "is no Intel HEX file"),  # its sum is wrong
        (":017E00000081\n", "is no Intel HEX file"),  # has no end
        (":00000001FF\n", "has no bytes"),
        (":0177FF000089\n:00000001FF\n", "outside the bootloader's part of flash"),
        (":027FFF00000080\n:00000001FF\n", "outside the bootloader's part of flash"),
        (":020000040001F9\n:017FFF000081\n", "outside the bootloader's part of flash"),
        (":020000021000EC\n:017FFF000081\n", "outside the bootloader's part of flash"),
        (":00000006FA\n", "has records of no known type"),
    ],
)
def test_what_is_wrong_with_a_bootloader_is_told(
    desk: Path, tmp_path: Path, text: str, expected: str
) -> None:
    path = tmp_path / "bootloader.hex"
    path.write_text(text)
    done = ran(
        NANO, "--image", desk, "--bootloader", path, "--seconds", "0.1", "--fast"
    )
    assert done.returncode == 2
    assert done.stderr == f"nano: {path} {done.stderr.split(' ', 2)[2]}"
    assert expected in done.stderr
