# SPDX-License-Identifier: MIT
"""The tests' own C loader: what it reads from a header, what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

import native

HEADER = """
#ifndef PLANTED_H
#define PLANTED_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#define PLANTED_MAX 5
#define PLANTED_MASK (PLANTED_MAX | 0x10u)
#define PLANTED_NAME "planted"
enum planted { PLANTED_LOW = -(2 + 1), PLANTED_NEXT, PLANTED_WIDE = sizeof(int) };
enum { PLANTED_SIZE = 2 * PLANTED_MAX };
struct planted_row {
    uint16_t values[PLANTED_SIZE + 1];
    bool (*is_good)(void *context, uint8_t value);
};
extern const struct planted_row planted_default;
static const uint8_t planted_table[] = {1, 2, 3};
int16_t planted_add(int16_t a, int16_t b) __attribute__((warn_unused_result));
_Noreturn void planted_elsewhere(void);
static inline uint8_t planted_sum(const uint8_t bytes[PLANTED_SIZE]) {
    uint8_t sum = 0;
    for (size_t i = 0; i < 2; i++) {
        sum = (uint8_t)(sum + bytes[i]);
    }
    return sum;
}
_Static_assert(sizeof(struct planted_row) > 2, "a row; has (values)");
#endif
"""

SOURCE = """
#include "planted.h"
const struct planted_row planted_default = {.values = {7}};
int16_t planted_add(int16_t a, int16_t b) {
    return (int16_t)(a + b);
}
"""


@pytest.fixture
def planted(tmp_path: Path) -> tuple[Path, Path]:
    header, source = tmp_path / "planted.h", tmp_path / "planted.c"
    header.write_text(HEADER)
    source.write_text(SOURCE)
    return header, source


def test_a_header_is_enough_to_reach_all_it_declares(planted):
    header, source = planted
    ffi, lib = native.load([source], [header])
    assert lib.planted_add(2, 3) == 5
    assert lib.planted_sum([200, 100] + [0] * 8) == 300 - 256
    assert (lib.PLANTED_LOW, lib.PLANTED_NEXT, lib.PLANTED_WIDE) == (-3, -2, 4)
    assert (lib.PLANTED_MAX, lib.PLANTED_MASK) == (5, 0x15)
    assert list(lib.planted_table) == [1, 2, 3]
    assert lib.planted_default.values[0] == 7
    assert len(ffi.new("struct planted_row *").values) == 11
    assert not hasattr(lib, "planted_elsewhere")


def test_a_changed_file_is_compiled_again(planted):
    header, source = planted
    _, before = native.load([source], [header])
    source.write_text(SOURCE.replace("a + b", "a - b"))
    native.forget()
    _, after = native.load([source], [header])
    assert (before.planted_add(2, 3), after.planted_add(2, 3)) == (5, -1)


@pytest.mark.parametrize(
    ("fault", "complaint"),
    [
        ("int planted_shadow(int a) { int b = a; { int b = 1; a = b; } return a + b; }",
         "shadow"),
        ("unsigned char planted_narrow(int a) { return a; }", "conversion"),
        ("int planted_unused(int a) { return 0; }", "unused"),
    ],
)  # fmt: skip
def test_a_warning_stops_the_build(planted, fault, complaint):
    header, source = planted
    source.write_text(SOURCE + fault)
    with pytest.raises(native.NativeBuildError, match=complaint):
        native.load([source], [header])


def test_two_headers_with_one_guard_are_refused(planted, tmp_path):
    header, source = planted
    twin = tmp_path / "twin.h"
    twin.write_text(HEADER)
    with pytest.raises(native.NativeBuildError, match="both guard by PLANTED_H"):
        native.load([source], [header, twin])
