# SPDX-License-Identifier: MIT
"""The declarations of preprocessed C headers, as cffi's parser accepts them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any


class NativeBuildError(Exception):
    """The C could not be built for the tests; the message is the compiler's."""


def declarations(
    text: str, folders: Sequence[Path], defined: set[str]
) -> Iterator[str]:
    """Turn preprocessed headers into what cffi's parser accepts.

    Only lines from files in `folders` count. A function or a variable is declared only
    if it is static or among the `defined` symbols.
    """
    code: list[str] = []
    macros: dict[str, str] = {}
    is_ours = False
    for line in text.splitlines():
        marker = re.match(r'# \d+ "(.*?)"', line)
        if marker:
            is_ours = any(Path(marker[1]).is_relative_to(path) for path in folders)
        elif is_ours and line.startswith("#"):
            macro = re.match(r"#define (\w+)(?!\()\s+(\S.*)", line)
            if macro:
                macros[macro[1]] = macro[2]
        elif is_ours:
            code.append(line)
    constants: set[str] = set()
    for item in _top_level(_without_attributes("\n".join(code))):
        declaration = _declaration(item, defined, constants)
        if declaration:
            yield declaration
    for name, value in macros.items():
        if _is_integer(value, constants):
            constants.add(name)
            yield f"#define {name} ..."


def _without_attributes(code: str) -> str:
    code = re.sub(r"\b(_Noreturn|__extension__)\b", "", code)
    while found := re.search(r"\b(__attribute__|_Static_assert)\s*\(", code):
        end = _closing(code, found.end() - 1)
        code = code[: found.start()] + code[end + 1 :]
    return code


def _closing(code: str, start: int) -> int:
    """Return the index of the bracket that closes the one at `start`."""
    depth = 0
    for index in range(start, len(code)):
        if code[index] in "([{":
            depth += 1
        elif code[index] in ")]}":
            depth -= 1
            if depth == 0:
                return index
    raise NativeBuildError(f"an unclosed bracket: {code[start : start + 60]}")


def _top_level(code: str) -> Iterator[str]:
    """Split code into top-level declarations, without function bodies."""
    start = index = 0
    while index < len(code):
        if code[index] in "([{":
            end = _closing(code, index)
            head = code[start:index].strip()
            if code[index] == "{" and head.endswith(")"):
                yield head
                start = end + 1
            index = end + 1
        elif code[index] == ";":
            yield code[start:index].strip()
            start = index = index + 1
        else:
            index += 1


def _declaration(item: str, defined: set[str], constants: set[str]) -> str:
    if not item:
        return ""
    is_static = bool(re.match(r"(static|inline)\b", item))
    item = re.sub(r"^((static|inline|extern|__inline__)\s+)+", "", item)
    item = re.sub(r"\benum\b\s*\w*\s*\{[^}]*\}", _open_enum(constants), item)
    if re.match(r"(struct|union|enum)\s+\w*\s*\{", item):
        is_type = not item[_closing(item, item.index("{")) + 1 :].strip()
    else:
        is_type = bool(re.fullmatch(r"(struct|union|enum)\s+\w+", item))
    item = re.sub(r"\[([^\]]*)\]", _open_length, item)
    if item.startswith("typedef") or is_type:
        return item + ";"
    item = re.sub(r"\s*=.*", "", item, flags=re.DOTALL)
    call = re.match(r"[^(\[]*?\b(\w+)\s*(\(|\[|$)", item)
    if call is None or not (is_static or call[1] in defined):
        return ""  # declared, but defined in no file of this library
    if call[2] == "(":
        return item.replace("[...]", "[]") + ";"
    return "extern " + item.replace("[]", "[...]") + ";"


def _open_enum(constants: set[str]) -> Any:
    """Replace an enum's values by "...", which leaves them to the compiler."""

    def opened(match: re.Match[str]) -> str:
        head, body = match[0].rstrip("}").split("{", 1)
        names = re.findall(r"(?:^|,)\s*(\w+)", re.sub(r"\([^()]*\)", "", body))
        constants.update(names)
        return f"{head}{{ {', '.join(names)}, ... }}"

    return opened


def _open_length(match: re.Match[str]) -> str:
    length = match[1].strip()
    return match[0] if not length or length.isdecimal() else "[...]"


def _is_integer(value: str, constants: set[str]) -> bool:
    words = re.findall(r"[A-Za-z_]\w*|\d[\w.]*", value)
    has_sense = all(
        word in constants or re.fullmatch(r"(0[xX][\da-fA-F]+|\d+)[uUlL]*", word)
        for word in words
    )
    return bool(words) and has_sense and not re.search(r"[\"'{};?=,]", value)
