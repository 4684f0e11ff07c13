# SPDX-License-Identifier: MIT
"""Words that strangers stumble over don't come back: tools/words.toml lists them, with
what an engineer of the field writes."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
WORDS = ROOT / "tools" / "words.toml"
CODE = (
    *("benchmarks", "examples", "firmware", "host", "packages", "protocol"),
    *("sim", "tests", "tools", "Makefile", "platformio.ini", "pyproject.toml"),
)
DOCUMENTS = ("README.md", "CONTRIBUTING.md", "docs", "protocol/PROTOCOL.md")
KINDS = {
    *(".c", ".h", ".ld", ".S", ".py", ".pyi", ".sh", ".js", ".mjs", ".css", ".html"),
    *(".toml", ".ini", ".md", ""),
}
# The lists themselves, and the libraries of others.
LEFT_OUT = {"words.toml", "test_words.py"}
OF_OTHERS = {"vendor", "__pycache__", "build", "node_modules"}

# Where a sentence goes on in the next line: marks of comments, and quotes of strings.
_CONTINUED = re.compile(r"""["']?[ \t]*\n[ \t]*(?:#|//|\*|[rf]?["'])?[ \t]*""")


def pairs() -> list[tuple[str, dict[str, Any]]]:
    with WORDS.open("rb") as file:
        listed = tomllib.load(file)
    return [(kind, each) for kind in ("phrase", "name") for each in listed[kind]]


def pattern_of(kind: str, old: str) -> re.Pattern[str]:
    if kind == "name":
        return re.compile(rf"\b{re.escape(old)}\b")
    words = r"\s+".join(map(re.escape, old.split()))
    return re.compile(rf"(?<![\w-]){words}(?!\w)", re.IGNORECASE)


def texts(root: Path) -> Iterator[tuple[str, str]]:
    """Each file by its path, as sentences: marks at the ends of lines are spaces."""
    for top in (*CODE, *DOCUMENTS):
        at = root / top
        for path in [at] if at.is_file() else sorted(at.rglob("*")):
            is_ours = path.name not in LEFT_OUT and not OF_OTHERS & {*path.parts}
            if is_ours and path.is_file() and path.suffix in KINDS:
                text = path.read_text(errors="ignore")
                text = _CONTINUED.sub(_blank, text)
                yield path.relative_to(root).as_posix(), text


def _blank(mark: re.Match[str]) -> str:
    """As long, so that a place is the same in both texts."""
    return re.sub(r"[^\n]", " ", mark[0])


def is_about(each: dict[str, Any], path: str) -> bool:
    if path.endswith(".md") and not each.get("documents", True):
        return False
    rooms = each.get("rooms")
    return rooms is None or any(path.startswith(f"{room}/") for room in rooms)


def found(root: Path) -> list[str]:
    wanted = [
        # A search for its longest word first: most files have none of them.
        (max(each["old"].lower().split(), key=len), each, pattern_of(kind, each["old"]))
        for kind, each in pairs()
    ]
    lines = []
    for path, text in texts(root):
        lower = text.lower()
        for word, each, pattern in wanted:
            if word not in lower or not is_about(each, path):
                continue
            for match in pattern.finditer(text):
                line = text.count("\n", 0, match.start()) + 1
                words = f"{each['old']!r}: better {each['new']!r}"
                lines.append(f"{path}:{line}: {words}")
    return lines


def test_no_old_word_has_come_back():
    lines = found(ROOT)
    assert not lines, "\n".join(lines)


def test_each_pair_is_of_two_texts_and_is_listed_once():
    assert {key for _, each in pairs() for key in each} <= {
        *("old", "new", "rooms", "documents")
    }
    old = [each["old"] for _, each in pairs()]
    assert len(set(old)) == len(old)
    assert not [each for _, each in pairs() if each["old"] in each["new"]]


def planted(root: Path, path: str, text: str) -> list[str]:
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).write_text(text)
    return found(root)


@pytest.mark.parametrize(("kind", "each"), pairs(), ids=lambda each: str(each))
def test_a_planted_old_word_fails(kind, each, tmp_path):
    room = each.get("rooms", ["host/imud"])[-1]
    text = {"phrase": f"# It {each['old']}.\n", "name": f"x = {each['old']}(1)\n"}[kind]
    assert planted(tmp_path, f"{room}/one.py", text)


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("host/one.py", '"""Gaps that are MISSING\n    by number."""\n'),
        (
            "host/one.py",
            'raise Error(\n    "what is missing "\n    f"by number: {x}"\n)\n',
        ),
        ("firmware/one.c", "    // What is missing\n    // by number.\n"),
        ("firmware/one.h", "/* What is missing\n * by number. */\n"),
        ("docs/one.md", "What is missing\nby number.\n"),
        ("protocol/one.toml", 'meaning = "missing by number"\n'),
    ],
)
def test_a_phrase_is_found_over_the_ends_of_lines(path, text, tmp_path):
    (line,) = planted(tmp_path, path, text)
    assert line.startswith(f"{path}:1: 'missing by number'") or ":2: " in line


@pytest.mark.parametrize(
    "text",
    [
        "# Missing, by number 7.\n",
        "x = goes_on_here\n",
        "# It fell, and all the sameness.\n",
        "# A fault-of its own.\n",
    ],
)
def test_other_words_pass(text, tmp_path):
    assert not planted(tmp_path, "firmware/one.py", text)
