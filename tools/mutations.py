# SPDX-License-Identifier: MIT
"""Small changes of a source file, each of which a test should notice: other operators,
a number one more, a condition turned round, a statement left out.
"""

from __future__ import annotations

import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

# As clang-format and ruff lay them out, operators of two operands have spaces around
# them; pointers, signs and templates do not.
C_OPERATORS = {
    "<": "<=",
    "<=": "<",
    ">": ">=",
    ">=": ">",
    "==": "!=",
    "!=": "==",
    "+": "-",
    "-": "+",
    "*": "+",
    "/": "*",
    "&&": "||",
    "||": "&&",
    "&": "|",
    "|": "&",
    "<<": ">>",
    ">>": "<<",
    "+=": "-=",
    "-=": "+=",
    "|=": "&=",
}
PYTHON_OPERATORS = C_OPERATORS | {"//": "*", "%": "+", "and": "or", "or": "and"}
PYTHON_NAMES = {"and": "or", "or": "and", "True": "False", "False": "True", "not": ""}

_C_HIDDEN = re.compile(
    r"""//[^\n]* | /\*.*?\*/                 # comments
    | "(?:\\.|[^"\\\n])*" | '(?:\\.|[^'\\\n])*'  # texts and letters
    | ^[ \t]*\#(?:\\\n|[^\n])*              # lines of the preprocessor""",
    re.DOTALL | re.MULTILINE | re.VERBOSE,
)
_C_ASSERTED = re.compile(
    r"_Static_assert\(.*?\);|^enum \w*\s*\{.*?\};", re.DOTALL | re.MULTILINE
)
_C_OPERATOR = re.compile(
    r"(?<= )(<<|>>|<=|>=|==|!=|&&|\|\||\+=|-=|\|=|<|>|\+|-|\*|/|&|\|)(?= )"
)
_C_NUMBER = re.compile(r"(?<![\w.])(\d+)(?=[uUlL]*\b)(?![.\w])")
_C_CONDITION = re.compile(r"\b(if|while) \(")
_C_STATEMENT = re.compile(
    r"""^[ \t]+[\w>.\[\]*()&-]+  # what is changed, or called
    (?:\ (?:[-+*|&^]|<<|>>)?=\ [^;{}]+ | \([^;{}]*\) | \+\+ | --);$""",
    re.MULTILINE | re.VERBOSE,
)


@dataclass(frozen=True, slots=True)
class Mutation:
    """`length` characters from `at` on become `text`."""

    path: Path
    at: int
    length: int
    text: str
    line: int
    before: str  # the line, without the space around it
    after: str

    def apply(self, source: str) -> str:
        return source[: self.at] + self.text + source[self.at + self.length :]


def of(path: Path, name: Path) -> list[Mutation]:
    """All of a file, in its order; `name` is what they call it."""
    source = path.read_text("utf-8")
    places = _in_python(source) if path.suffix == ".py" else _in_c(source)
    return [_mutation(name, source, *place) for place in sorted(set(places))]


def _mutation(path: Path, source: str, at: int, length: int, text: str) -> Mutation:
    line = source.count("\n", 0, at) + 1
    begin = source.rfind("\n", 0, at) + 1
    end = source.find("\n", at + length)
    after = source[begin:at] + text + source[at + length : end]
    return Mutation(
        path, at, length, text, line, source[begin:end].strip(), after.strip()
    )


def _in_c(source: str) -> Iterator[tuple[int, int, str]]:
    # What is hidden keeps its place, as spaces.
    seen = source
    for pattern in (_C_HIDDEN, _C_ASSERTED):
        seen = pattern.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), seen)
    for found in _C_OPERATOR.finditer(seen):
        yield found.start(), len(found[0]), C_OPERATORS[found[0]]
    for found in _C_NUMBER.finditer(seen):
        yield found.start(1), len(found[1]), str(int(found[1]) + 1)
    for found in _C_CONDITION.finditer(seen):
        if (end := _closing(seen, found.end() - 1)) is not None:
            condition = source[found.end() : end]
            yield found.end(), len(condition), f"!({condition})"
    for found in _C_STATEMENT.finditer(seen):
        text = found[0].lstrip()
        if not text.startswith(("return", "else", "case", "const ", "typedef")):
            yield found.end() - len(text), len(text), ";"


def _closing(text: str, at: int) -> int | None:
    """Where the bracket that opens at `at` is closed."""
    depth = 0
    for place in range(at, len(text)):
        depth += (text[place] == "(") - (text[place] == ")")
        if depth == 0:
            return place
    return None


def _in_python(source: str) -> Iterator[tuple[int, int, str]]:
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    tokens = [
        token
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type not in (tokenize.COMMENT, tokenize.NL)
    ]
    for index, token in enumerate(tokens):
        at = starts[token.start[0] - 1] + token.start[1]
        text, size = token.string, len(token.string)
        spaced = source[at - 1 : at] == " " and source[at + size : at + size + 1] == " "
        if token.type == tokenize.OP and text in PYTHON_OPERATORS and spaced:
            if not _is_annotation(tokens, index):
                yield at, size, PYTHON_OPERATORS[text]
        elif token.type == tokenize.NAME and text in PYTHON_NAMES:
            if text != "not" or tokens[index - 1].string != "is":
                yield at, size, PYTHON_NAMES[text]
        elif token.type == tokenize.NUMBER and text.isdecimal():
            yield at, size, str(int(text) + 1)


def _is_annotation(tokens: list[tokenize.TokenInfo], index: int) -> bool:
    """Whether a `|` is between types."""
    if tokens[index].string != "|":
        return False
    before = tokens[index - 1].string, tokens[index + 1].string
    return any(
        name == "None" or name[:1].isupper() or name in _TYPES for name in before
    )


_TYPES = {"str", "int", "float", "bool", "bytes", "list", "dict", "tuple"}
