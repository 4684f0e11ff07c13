# SPDX-License-Identifier: MIT
"""The proof can fail: where a driver reads beyond an array, or is no C."""

from __future__ import annotations

import shutil
from pathlib import Path

import prove
import pytest

pytestmark = pytest.mark.skipif(
    shutil.which(prove.FRAMA_C) is None, reason="frama-c-base is not there"
)

WRONG = """
#include "any.h"
static uint8_t room[4];
void read(void) {
    const uint8_t at = any_up_to(4);
    any_byte = room[at];
}
void add(void) {
    const int most = 32767;
    any_word = (uint16_t)(most + any_u8());
}
"""


def test_a_byte_beyond_an_array_is_an_alarm(tmp_path: Path) -> None:
    (tmp_path / "wrong.c").write_text(WRONG)
    wrong = prove.Proof(str(tmp_path / "wrong"), ("read",), (), ())
    (alarm,) = prove.prove(wrong, "read", prove.HOST).alarms
    assert "out of bounds" in alarm


def test_a_sum_that_fits_32_bits_is_an_alarm_with_16(tmp_path: Path) -> None:
    (tmp_path / "wrong.c").write_text(WRONG)
    wrong = prove.Proof(str(tmp_path / "wrong"), ("add",), (), ())
    assert prove.prove(wrong, "add", prove.HOST).alarms == []
    (alarm,) = prove.prove(wrong, "add", prove.AVR).alarms
    assert "signed overflow" in alarm


def test_a_driver_that_is_no_c_proves_nothing(tmp_path: Path) -> None:
    (tmp_path / "wrong.c").write_text("nonsense")
    wrong = prove.Proof(str(tmp_path / "wrong"), ("read",), (), ())
    assert prove.prove(wrong, "read", prove.HOST).alarms


def test_every_function_of_a_driver_is_proved() -> None:
    for each in prove.PROOFS:
        text = (prove.ROOT / prove.DRIVERS / f"{each.driver}.c").read_text()
        for function in each.functions:
            assert f"void {function}(void)" in text or f"PARSER({function})" in text
    drivers = {path.stem for path in (prove.ROOT / prove.DRIVERS).glob("*.c")}
    assert drivers == {each.driver for each in prove.PROOFS}


def test_the_fewest_statements_that_a_machine_reached_are_summed() -> None:
    lines = (
        ("frame.encode", prove.HOST, "71/71"),
        ("frame.encode", prove.AVR, "69/70"),
        ("frame.crc", prove.AVR, "44/44"),
    )
    outcomes = [prove.Outcome(*each[:2], [], each[2], 1.0) for each in lines]
    assert prove._summary(outcomes).rows == [("`frame.c`", 113, 114)]
