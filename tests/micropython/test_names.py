# SPDX-License-Identifier: MIT
"""The module's names do not clash with macros of other ports' headers."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

# Without a prefix, in headers of pico-sdk that py/mphal.h includes in MicroPython's
# port for the Pico: hardware/clocks.h and pico/platform/common.h.
PICO = {"KHZ", "MHZ", "MIN", "MAX", "count_of", "bool_to_bit"}

COMMENT = re.compile(r"//.*?$|/\*.*?\*/", re.DOTALL | re.MULTILINE)
STRING = re.compile(r'"(?:\\.|[^"\\])*"')


def words(path: Path) -> set[str]:
    """The identifiers of a C file."""
    return set(
        re.findall(r"\b[A-Za-z_]\w*", STRING.sub("", COMMENT.sub("", path.read_text())))
    )


@pytest.mark.parametrize(
    "pattern", ["micropython/imuprobe/*.[ch]", "core/**/*.[ch]", "generic/*.[ch]"]
)
def test_no_name_is_a_macro_of_the_picos_headers(root: Path, pattern: str) -> None:
    files = sorted((root / "firmware").glob(pattern))
    assert files
    found = {path.name: words(path) & PICO for path in files}
    assert {name: clash for name, clash in found.items() if clash} == {}
