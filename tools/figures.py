# SPDX-License-Identifier: MIT
"""Compares figures in documents with results of benchmarks; --write updates them.

A comment names the place of the figure that follows it in benchmarks/results/:

    <!-- figure: recordings:means_deg:all:host:total -->1.49

A comment above a table names a file and has a line for each row, with the places of
the figures in the row after its first cell. {a,b} are two places, - is a row without
figures, _ a number that is not checked:

    <!-- figures: recordings
    means_deg:{undisturbed,all}:host:{total,heading}
    figures:tilt inside 1.96 sigma, %, all; _
    -->

A line `@ one; two = groups:@:count` stands for a row with `one` and a row with `two` in
place of the @. A place may be multiplied, as in `coverage:all:host:tilt * 100`, or
divided, as in `a:x over a:y`. The document decides the number of decimals. A null in
the results is a dash.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
COMMAND = "python tools/figures.py --write"

# 1.49, 50 100 or 34,560,000; not the 9 of LSM9DS0 or the 2 of RP2040.
NUMBER = re.compile(
    r"(?<![\w.])(?:\d{1,3}(?:[ ,]\d{3})+|\d+(?:\.\d+)?)(?![\w]*\d)|(?<= )-(?= )"
)
INLINE = re.compile(r"<!-- figure: (?P<place>[^>]+?) -->\**")
TABLE = re.compile(r"<!-- figures: (?P<file>[\w-]+)\n(?P<rows>.*?)\n-->\n", re.DOTALL)
RULE = re.compile(r"\|[-| :]+\|\n")
BRACES = re.compile(r"\{([^{}]*)\}")
SKIPPED = "_"


class Figure(NamedTuple):
    """A number in a document, and the place whose value it must be."""

    start: int
    text: str
    place: str  # file:key:...

    @property
    def value(self) -> str:
        """Of the results, with the document's decimals and its thousands separator."""
        value = value_of(self.place)
        if value is None:
            return "-"
        decimals = len(self.text.partition(".")[2])
        separator = next((each for each in " ," if each in self.text), "")
        return f"{value:,.{decimals}f}".replace(",", separator)


class BadFigureError(Exception):
    """A place or a table that does not fit; the message says which."""


@functools.cache
def results(name: str) -> Any:
    """The contents of a file of results."""
    path = RESULTS / f"{name}.json"
    if not path.exists():
        raise BadFigureError(f"there is no {path.relative_to(ROOT)}")
    return json.loads(path.read_text("utf-8"))


def value_of(place: str) -> float | None:
    """The number at a place, multiplied or divided; None for null."""
    where, _, divisor = place.partition(" over ")
    if divisor:
        above, below = value_of(where), value_of(divisor)
        return None if above is None or not below else above / below
    where, _, factor = place.partition(" * ")
    name, *keys = where.split(":")
    found = results(name)
    for key in keys:
        try:
            found = found[int(key)] if isinstance(found, list) else found[key]
        except (KeyError, IndexError, ValueError, TypeError):
            raise BadFigureError(f"{where}: there is no {key}") from None
    if found is None:
        return None
    if not isinstance(found, int | float):
        raise BadFigureError(f"{where} is no number")
    return found * float(factor or 1.0)


def expanded(place: str) -> list[str]:
    """The places that braces stand for, the first braces outermost."""
    braces = BRACES.search(place)
    if braces is None:
        return [place]
    return [
        each
        for word in braces[1].split(",")
        for each in expanded(place[: braces.start()] + word + place[braces.end() :])
    ]


def rows_of(text: str) -> Iterator[str]:
    """The places of each row, line by line or by a line with @ for several."""
    for line in text.splitlines():
        if not line.startswith("@"):
            yield line
            continue
        names, _, places = line.removeprefix("@").partition(" = ")
        for name in names.split("; "):
            yield places.replace("@", name.strip())


def inline(text: str) -> Iterator[Figure]:
    """Figures behind a comment of their own."""
    for comment in INLINE.finditer(text):
        if text[: comment.start()].endswith("\n"):
            # CommonMark takes the line for HTML, and shows its Markdown as it is.
            raise BadFigureError(f"put a word on the line before {comment[0]}")
        number = NUMBER.match(text, comment.end())
        if number is None:
            raise BadFigureError(f"no number follows {comment[0]}")
        yield Figure(number.start(), number[0], comment["place"])


def in_tables(text: str) -> Iterator[Figure]:
    """Figures of tables below a comment."""
    for comment in TABLE.finditer(text):
        rule = RULE.search(text, comment.end())
        if rule is None:
            raise BadFigureError(f"no table follows the figures of {comment['file']}")
        start = rule.end()
        for places in rows_of(comment["rows"]):
            row, _, _ = text[start:].partition("\n")
            if not row.startswith("|"):
                raise BadFigureError(f"no row of the table for {places}")
            if places.strip() != "-":
                yield from of_row(row, start, places, comment["file"])
            start += len(row) + 1
        if text.startswith("|", start):
            row = text[start:].partition("\n")[0]
            raise BadFigureError(f"no places for the row {row[:60]}")


def of_row(row: str, start: int, places: str, file: str) -> Iterator[Figure]:
    """Figures of a row, whose first cell is its name."""
    names = [each for place in places.split("; ") for each in expanded(place.strip())]
    numbers = list(NUMBER.finditer(row, row.index("|", 1)))
    if len(names) != len(numbers):
        raise BadFigureError(f"{len(names)} places, {len(numbers)} numbers: {row[:60]}")
    for name, number in zip(names, numbers, strict=True):
        if name != SKIPPED:
            place = f"{file}:{name}".replace(" over ", f" over {file}:")
            yield Figure(start + number.start(), number[0], place)


def figures(text: str) -> list[Figure]:
    """All of a document, in its order."""
    return sorted([*inline(text), *in_tables(text)])


def documents() -> list[Path]:
    """Those that may have figures."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def differences(text: str) -> Iterator[str]:
    """A line for each figure that differs from the results."""
    for figure in figures(text):
        line = text.count("\n", 0, figure.start) + 1
        try:
            value = figure.value
        except BadFigureError as error:
            yield f"{line}: {error}"
            continue
        if figure.text != value:
            yield f"{line}: {figure.text}, but {figure.place} is {value}"


def updated(text: str) -> str:
    """The document with the figures of the results that exist."""
    for figure in reversed(figures(text)):
        end = figure.start + len(figure.text)
        with contextlib.suppress(BadFigureError):
            text = text[: figure.start] + figure.value + text[end:]
    return text


def main() -> int:
    """Print or update the figures that differ; return 1 if one does."""
    parser = argparse.ArgumentParser(
        prog="tools/figures.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--write", action="store_true", help="update the documents")
    is_written = parser.parse_args().write
    status = 0
    for path in documents():
        name, text = path.relative_to(ROOT), path.read_text("utf-8")
        try:
            if is_written and (better := updated(text)) != text:
                path.write_text(better, "utf-8")
            found = list(differences(updated(text) if is_written else text))
        except BadFigureError as error:
            found = [str(error)]
        for each in found:
            print(f"{name}:{each}")
            status = 1
    if status and not is_written:
        print(f"{COMMAND} updates the documents")
    return status


if __name__ == "__main__":
    sys.exit(main())
