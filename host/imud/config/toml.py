# SPDX-License-Identifier: MIT
"""Between msgspec structs and TOML: writes a struct with a comment on each key, and
finds every mistake in a file, with its line and what would be allowed there.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
from msgspec import inspect

Struct = msgspec.Struct

# A message repeats a longer value only up to here.
SHOWN_MAX = 60

_CONTROL = re.compile(r"[\x00-\x1f\x7f]")
_HEADER = re.compile(r"\s*\[\s*([^\[\]]+?)\s*\]\s*(#.*)?$")


@dataclass(frozen=True, slots=True)
class Mistake:
    """An unknown key, or a value that is not allowed."""

    path: tuple[str, ...]
    words: str


def called(path: tuple[str, ...]) -> str:
    """A key as people write it: [log] rotate_mb."""
    *table, key = path
    return f"[{'.'.join(table)}] {key}" if table else key


def parse(text: str) -> dict[str, Any]:
    """A TOML text as a dict. Raises TOMLDecodeError for anything that is not TOML."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise tomllib.TOMLDecodeError("it nests too deep") from error
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:  # a number of thousands of digits, a 30 February
        raise tomllib.TOMLDecodeError(str(error).partition(";")[0]) from error


def mistakes(table: Mapping[str, Any], kind: type[Struct]) -> list[Mistake]:
    """Everything that keeps `table` from being a `kind`."""
    return list(_mistakes(table, kind, kind, ()))


def _mistakes(
    table: Mapping[str, Any],
    kind: type[Struct],
    whole: type[Struct],
    path: tuple[str, ...],
) -> Iterator[Mistake]:
    fields = {field.name: field for field in msgspec.structs.fields(kind)}
    for key, value in table.items():
        here = (*path, key)
        if key not in fields:
            yield Mistake(here, _unknown(key, list(fields), whole, path))
            continue
        section = _section(fields[key].type)
        if section is None:
            yield from _value_mistakes(here, value, fields[key].type)
        elif not isinstance(value, dict):
            yield Mistake(here, f"it is a section: [{key}] on a line of its own")
        elif section.is_many:
            for name, each in value.items():
                if isinstance(each, dict):
                    yield from _mistakes(each, section.kind, whole, (*here, name))
                else:
                    yield Mistake(
                        (*here, name), f"it is a section: [{key}.ID], its keys below"
                    )
        else:
            yield from _mistakes(value, section.kind, whole, here)


def _value_mistakes(
    path: tuple[str, ...], value: object, hint: object
) -> Iterator[Mistake]:
    try:
        msgspec.convert(value, hint)
    except msgspec.ValidationError:
        yield Mistake(path, f"{_shown(value)} is not {allowed(hint)}")
        return
    texts = value if isinstance(value, list) else [value]
    if any(isinstance(text, str) and _CONTROL.search(text) for text in texts):
        yield Mistake(path, f"{_shown(value)} has control characters")


def _unknown(
    key: str, known: list[str], whole: type[Struct], path: tuple[str, ...]
) -> str:
    near = get_close_matches(key, known, 1)
    if near:
        return f"there is no such key; did you mean {called((*path, near[0]))}?"
    for field in msgspec.structs.fields(whole):
        section = _section(field.type)
        if section is None or section.is_many:
            continue
        if key in (inner.name for inner in msgspec.structs.fields(section.kind)):
            return (
                f"there is no such key here; did you mean {called((field.name, key))}?"
            )
    return f"there is no such key; there are {', '.join(known)}"


@dataclass(frozen=True, slots=True)
class _Section:
    kind: type[Struct]
    is_many: bool  # one a name: [probes.ID]


@cache
def _section(hint: Hashable) -> _Section | None:
    info = _bare(inspect.type_info(hint))
    if isinstance(info, inspect.StructType):
        return _Section(info.cls, is_many=False)
    if isinstance(info, inspect.DictType):
        inner = _bare(info.value_type)
        if isinstance(inner, inspect.StructType):
            return _Section(inner.cls, is_many=True)
    return None


def _bare(info: inspect.Type) -> inspect.Type:
    return info.type if isinstance(info, inspect.Metadata) else info


def _description(hint: object) -> str:
    info = inspect.type_info(hint)
    extra = info.extra_json_schema if isinstance(info, inspect.Metadata) else None
    return str((extra or {}).get("description", ""))


def _examples(hint: object) -> list[Any]:
    info = inspect.type_info(hint)
    extra = info.extra_json_schema if isinstance(info, inspect.Metadata) else None
    return list((extra or {}).get("examples", []))


def allowed(hint: object) -> str:
    """The values that a type allows, in words: "a whole number, 1 or more"."""
    bare = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    if get_origin(bare) is Literal:
        # In the declared order: log levels rise.
        return _either([_toml(value) for value in get_args(bare)])
    return _allowed(inspect.type_info(hint))


def _either(texts: list[str]) -> str:
    *first, last = texts
    return f"{', '.join(first)} or {last}" if first else last


def _allowed(info: inspect.Type) -> str:
    info = _bare(info)
    if isinstance(info, inspect.UnionType):
        kinds = [each for each in info.types if not isinstance(each, inspect.NoneType)]
        return " or ".join(_allowed(each) for each in kinds)
    if isinstance(info, inspect.BoolType):
        return "true or false"
    if isinstance(info, inspect.IntType | inspect.FloatType):
        what = "a whole number" if isinstance(info, inspect.IntType) else "a number"
        return what + _range(info)
    if isinstance(info, inspect.LiteralType):
        return _either([_toml(value) for value in info.values])
    if isinstance(info, inspect.VarTupleType):
        count = f" {info.min_length} or more" if info.min_length is not None else ""
        return f"a list of{count}: {_allowed(info.item_type)}"
    return "text in quotes"


def _range(info: inspect.IntType | inspect.FloatType) -> str:
    low, high = info.ge, info.le
    if isinstance(info, inspect.IntType):
        low = info.gt + 1 if info.gt is not None else low
        high = info.lt - 1 if info.lt is not None else high
    above = f" above {info.gt}" if low is None and info.gt is not None else ""
    if low is not None and high is not None:
        return f" from {low} to {high}"
    if low is not None:
        return f", {low} or more"
    return above + (f", {high} or less" if high is not None else "")


def written(value: Struct, about: str) -> str:
    """`value` as a TOML file with a comment on each key. Reading it gives `value`."""
    lines = [f"# {line}" if line else "#" for line in about.splitlines()]
    lines += ["", *_keys(value, is_set=True)]
    for field in msgspec.structs.fields(type(value)):
        section = _section(field.type)
        if section is None:
            continue
        held = getattr(value, field.name)
        head = _sentence(section.kind)
        if not section.is_many:
            lines += ["", f"# {head}", f"[{field.name}]", *_keys(held, is_set=True)]
            continue
        about_many = _description(field.type)
        lines += ["", f"# {head}", f"# [{field.name}.ID]: {about_many}."]
        lines += [f"# {line}" for line in _keys(section.kind(), is_set=False)]
        for name, each in held.items():
            keys = _keys(each, is_set=True)
            lines += ["", f"[{field.name}.{name}]"]
            lines += [line for line in keys if not line.startswith("#")]
    return "\n".join(lines) + "\n"


def changed(value: Struct, default: Struct) -> str:
    """The keys of `value` that are not as in `default`, as TOML; empty: none."""
    lines = [*_changed(value, default)]
    for field in msgspec.structs.fields(type(value)):
        section = _section(field.type)
        if section is None:
            continue
        held, usual = getattr(value, field.name), getattr(default, field.name)
        parts = (
            {
                f"{field.name}.{name}": (each, section.kind())
                for name, each in held.items()
            }
            if section.is_many
            else {field.name: (held, usual)}
        )
        for name, (own, other) in parts.items():
            if keys := [*_changed(own, other)]:
                lines += ["", f"[{name}]", *keys]
    return "\n".join(lines).lstrip("\n") + ("\n" if lines else "")


def _changed(value: Struct, default: Struct) -> Iterator[str]:
    for field in msgspec.structs.fields(type(value)):
        held = getattr(value, field.name)
        if _section(field.type) is None and held != getattr(default, field.name):
            yield f"{field.name} = {_toml(held)}"


def _keys(value: Struct, *, is_set: bool) -> Iterator[str]:
    for field in msgspec.structs.fields(type(value)):
        if _section(field.type) is not None:
            continue
        held = getattr(value, field.name)
        if is_set:
            yield f"# {_comment(field.type)}"
        if held is not None:
            note = "" if is_set else f"  # {_comment(field.type)}"
            examples = [] if is_set else _examples(field.type)
            yield f"{field.name} = {_toml(examples[0] if examples else held)}{note}"
            continue
        example = f"{field.name} = {_toml(next(iter(_examples(field.type)), 0))}"
        # Without a default there is only an example to show.
        yield f"# {example}" if is_set else f"{example}  # {_comment(field.type)}"


def _comment(hint: object) -> str:
    """The purpose of a key, and its allowed values if the default does not show
    them."""
    may_be = allowed(hint)
    info = _bare(inspect.type_info(hint))
    if isinstance(info, inspect.UnionType):
        info = next(
            each for each in info.types if not isinstance(each, inspect.NoneType)
        )
    is_plain = isinstance(_bare(info), inspect.BoolType | inspect.StrType) or (
        isinstance(info, inspect.VarTupleType)
        and isinstance(_bare(info.item_type), inspect.StrType)
    )
    text = _description(hint)
    return text if is_plain else f"{text}: {may_be}" if text else may_be


def _sentence(kind: type[Struct]) -> str:
    return " ".join((kind.__doc__ or "").split())


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(each) for each in value)}]"
    if isinstance(value, str):
        # JSON's escapes are TOML's, but for DEL, which TOML wants escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return "a section"
    try:
        text = _toml(value)
    except ValueError:  # an integer of more digits than Python prints
        return "so large a number"
    return cut(text)


def cut(text: str) -> str:
    """A text for a message, cut to SHOWN_MAX characters."""
    return text if len(text) <= SHOWN_MAX else f"{text[: SHOWN_MAX - 3]}..."


def line_of(text: str, path: tuple[str, ...]) -> int | None:
    """The line of a key, or else of its section; None if neither is found."""
    table: tuple[str, ...] = ()
    found = None
    for number, line in enumerate(text.splitlines(), 1):
        header = _HEADER.match(line)
        if header is not None:
            table = _dotted(header[1])
            if path[: len(table)] == table and (found is None or table == path):
                found = number
                if table == path:
                    return number
            continue
        key, equals, _ = line.partition("=")
        if equals and (*table, *_dotted(key)) == path:
            return number
    return found


def _dotted(text: str) -> tuple[str, ...]:
    return tuple(part.strip().strip("\"'") for part in text.split("."))
