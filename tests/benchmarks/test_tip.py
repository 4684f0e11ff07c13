# SPDX-License-Identifier: MIT
"""The picture and the benchmark of the tip."""

from __future__ import annotations

import picture_wobble


def test_the_picture_is_as_the_script_draws_it() -> None:
    assert picture_wobble.OUTPUT.read_text() == picture_wobble.drawn()
    assert picture_wobble.drawn().count("<text") == 5
