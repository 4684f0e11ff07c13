# SPDX-License-Identifier: MIT
"""Whether results are those of a whole benchmark, and what is made of their names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

Results = dict[str, Any]


class NotWholeError(Exception):
    """The results are those of a part of the benchmark; the message says which."""


def named(figures: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """The values of required figures by their names."""
    return {figure["name"]: figure["value"] for figure in figures}


def without_colons(found: Results) -> Results:
    """With other names: a place in a document has colons between its keys."""
    return {name.replace(": ", " "): value for name, value in found.items()}


def demand(is_whole: bool, what: str) -> None:
    """Raise NotWholeError if the results are partial."""
    if not is_whole:
        raise NotWholeError(what)
