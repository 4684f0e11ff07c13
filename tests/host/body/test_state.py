# SPDX-License-Identifier: MIT
"""The state of a body as JSON: what the document shows is what programs read."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from imud.body.state import BodyState

DOCUMENT = Path(__file__).parents[3] / "docs" / "limb.md"


def test_the_document_shows_all_of_a_state():
    example = re.search(r"```json\n(\{.*?)```", DOCUMENT.read_text(), re.DOTALL)
    state = msgspec.json.decode(example[1], type=BodyState)
    # Nothing is left to defaults, and nothing is shown that a state has not.
    assert msgspec.json.decode(msgspec.json.encode(state)) == msgspec.json.decode(
        example[1]
    )
    thigh, foot = state.segments
    assert thigh.end_m == pytest.approx(foot.start_m)
