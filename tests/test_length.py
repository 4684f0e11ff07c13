# SPDX-License-Identifier: MIT
"""Of the cases of sampled tests, `make test` runs a part, and some of each test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import pytest

from length import left_out


@dataclass(frozen=True)
class Case:
    """The part of a test that left_out() needs."""

    nodeid: str
    step: int | None = None
    is_nightly: bool = False

    def get_closest_marker(self, name: str) -> pytest.Mark | None:
        if name == "nightly":
            return pytest.mark.nightly.mark if self.is_nightly else None
        assert name == "sampled"
        return pytest.mark.sampled(self.step).mark if self.step else None


def kept(cases: list[Case]) -> list[str]:
    left = left_out(cast("Any", cases))
    return [case.nodeid for case in cases if case not in cast("Any", left)]


def test_every_nth_case_is_kept_and_one_of_each_test_at_least() -> None:
    many = [Case(f"a.py::many[{number}]", 3) for number in range(30)]
    few = [Case(f"a.py::few[{number}]", 3) for number in range(2)]
    alone = [Case("a.py::alone", 3), Case("b.py::other")]
    names = kept([*many, *few, *alone])
    assert sum(name.startswith("a.py::many") for name in names) == 10
    assert sum(name.startswith("a.py::few") for name in names) == 1
    assert names[-2:] == ["a.py::alone", "b.py::other"]


def test_what_is_for_the_night_is_left_out() -> None:
    assert kept([Case("a.py::one"), Case("a.py::two[1]", is_nightly=True)]) == [
        "a.py::one"
    ]


def test_each_case_of_a_pair_is_kept_by_some_tests() -> None:
    names = kept(
        [Case(f"a.py::test_{n}[{board}]", 2) for n in range(40) for board in "nf"]
    )
    assert len(names) == 40
    assert {name[-2] for name in names} == {"n", "f"}
