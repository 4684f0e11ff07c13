# SPDX-License-Identifier: MIT
"""The checks are checked: planted faults must kill a process under the tests' flags."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from programs import ran

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))
import sanitizer

HEADER = """
#include <stdint.h>
int32_t planted_add(int32_t a, int32_t b);
uint8_t planted_read(uint8_t index);
static inline int32_t planted_shift(int32_t value, int32_t bits) {
    return value << bits;
}
"""

SOURCE = """
#include "planted.h"
#include <stdlib.h>
int32_t planted_add(int32_t a, int32_t b) {
    return a + b;
}
uint8_t planted_read(uint8_t index) {
    // Volatile, so that no size is known at compile time and UBSan has no say.
    uint8_t *volatile bytes = calloc(4, 1);
    const uint8_t value = bytes ? bytes[index] : 0;
    free(bytes);
    return value;
}
"""

CALLER = """
import sys
import native
folder, call = sys.argv[1:]
ffi, lib = native.load([folder + "/planted.c"], [folder + "/planted.h"])
print("loaded", flush=True)
eval(call, {"lib": lib})
print("survived", flush=True)
"""


def run(folder: Path, call: str, *, asan: bool) -> subprocess.CompletedProcess[str]:
    (folder / "planted.h").write_text(HEADER)
    (folder / "planted.c").write_text(SOURCE)
    env = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    env["PYTHONPATH"] = str(Path(__file__).parent)
    if asan:
        env |= sanitizer.environment()
    return ran(sys.executable, "-c", CALLER, str(folder), call, env=env)


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        ("lib.planted_add(2**31 - 1, 1)", "signed integer overflow"),
        ("lib.planted_shift(-1, 3)", "left shift of negative value"),  # inlined
    ],
)
def test_undefined_behaviour_kills_the_process(tmp_path, call, complaint):
    done = run(tmp_path, call, asan=False)
    assert (done.stdout, done.returncode != 0) == ("loaded\n", True)
    assert complaint in done.stderr


def test_a_read_past_the_end_kills_the_process(tmp_path):
    done = run(tmp_path, "lib.planted_read(4)", asan=True)
    assert (done.stdout, done.returncode != 0) == ("loaded\n", True)
    assert "heap-buffer-overflow" in done.stderr


@pytest.mark.sampled(2)
@pytest.mark.parametrize("asan", [False, True])
def test_sound_code_lives_under_the_same_flags(tmp_path, asan):
    call = "lib.planted_add(2**31 - 2, 1), lib.planted_shift(1, 3), lib.planted_read(3)"
    done = run(tmp_path, call, asan=asan)
    assert (done.stdout, done.returncode) == ("loaded\nsurvived\n", 0), done.stderr
