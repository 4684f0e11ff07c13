# SPDX-License-Identifier: MIT
"""Changes the source a little, again and again, and says which changes no test
notices: each is a fact that no test states, or a change of nothing, which belongs into
tests/equivalents.toml with the reason. Works in copies below build/.

A room is a folder of firmware/core (math, fusion, params, probe, storage, wire,
drivers) or of host/imud (log, net, ports, ...); core/params and host/params are two of
one name. Tests of the firmware are chosen by what they run of a file, counted once.
Generated files are left out: a test compares them with what generates them.

example: make mutate ROOM=math SEED=7 COUNT=20
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import io
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import tokenize
import tomllib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

import sanitizer

ROOT = Path(__file__).resolve().parent.parent
WORK = ROOT / "build" / "mutants"
COUNTED = WORK / "counted.json"
EQUIVALENTS = Path("tests/equivalents.toml")

CORE, HOST = Path("firmware/core"), Path("host/imud")
CORE_TESTS = ("tests/core", "tests/protocol")
# Tests of host rooms that are not only in tests/host/ROOM.
HOST_TESTS = {
    "log": ("tests/host/log", "tests/host/recordings"),
    "web": tuple(
        f"tests/web/test_{name}.py"
        for name in (
            "server",
            "browsers",
            "serving",
            "calibrating",
            "playing",
            "stream",
        )
    ),
    "ports": ("tests/host/ports", "tests/host/cli/test_ports.py"),
    "params": ("tests/host/params", "tests/host/cli/test_params.py"),
}

# A change may make a loop endless: so many times as long as without a change, and so
# many seconds more, in which programs start.
PATIENCE, START_S = 5.0, 20.0


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


@dataclass(frozen=True, slots=True)
class Verdict:
    mutation: Mutation
    what: str  # one of _WORDS
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="tools/mutate.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("room", help="folder of firmware/core or host/imud")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=20, help="changes (default: 20)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--file", help="only in files whose name contains this")
    options = parser.parse_args()
    found = list(_sites(options.room, options.file))
    if not found:
        sys.exit(f"there is no room {options.room} with code to change")
    count = min(options.count, len(found))
    chosen = random.Random(options.seed).sample(found, count)  # noqa: S311
    WORK.mkdir(parents=True, exist_ok=True)
    is_core = chosen[0].path.is_relative_to(CORE)
    counted = _counted() if is_core else {}
    trees: SimpleQueue[Path] = SimpleQueue()
    for number in range(options.workers):
        trees.put(_tree(number))
    known = _equivalents()

    def judge(mutation: Mutation) -> Verdict:
        tree = trees.get()
        try:
            return _judge(tree, mutation, counted, known)
        finally:
            trees.put(tree)

    verdicts = []
    with ThreadPoolExecutor(options.workers) as pool:
        for verdict in pool.map(judge, chosen):
            verdicts.append(verdict)
            change = verdict.mutation
            sys.stderr.write(
                f"{len(verdicts):3} of {len(chosen)}  {verdict.what:14} "
                f"{verdict.seconds:5.1f} s  {change.path}:{change.line}\n"
            )
    sys.exit(_tell(options.room, verdicts))


def _tell(room: str, verdicts: Sequence[Verdict]) -> int:
    """The score, and each change that no test notices; the exit code."""
    by = {what: sum(v.what == what for v in verdicts) for what in _WORDS}
    missed = [v.mutation for v in verdicts if v.what in ("unnoticed", "endless")]
    for change in missed:
        sys.stdout.write(
            f"{change.path}:{change.line}\n  - {change.before}\n  + {change.after}\n"
        )
    tried = by["noticed"] + len(missed)
    sys.stdout.write(
        f"{room}: {by['noticed']} of {tried} noticed, {by['endless']} took "
        f"{PATIENCE:g} times as long; "
        f"{by['equivalent']} change nothing, {by['not compiled']} do not compile\n"
    )
    return 1 if by["unnoticed"] else 0


_WORDS = ("noticed", "unnoticed", "endless", "equivalent", "not compiled")


def _sites(room: str, name: str | None) -> Iterator[Mutation]:
    for side, base, kind in (("core", CORE, "*.c"), ("host", HOST, "*.py")):
        folder = ROOT / base / room.removeprefix(f"{side}/")
        for path in sorted(folder.rglob(kind)):
            if (name is None or name in path.name) and not _is_generated(path):
                yield from mutations(path, path.relative_to(ROOT))


def _is_generated(path: Path) -> bool:
    return "Generated from schema.toml" in path.read_text("utf-8")[:400]


def _judge(
    tree: Path,
    change: Mutation,
    counted: dict[str, dict[str, list[int]]],
    known: set[tuple[str, str, str]],
) -> Verdict:
    begin = time.monotonic()
    if (str(change.path), change.before, change.after) in known:
        return Verdict(change, "equivalent", 0.0)
    target = tree / change.path
    source = target.read_text("utf-8")
    runs = _runs_of(tree, change, counted)
    # Before the change: what these tests take without it.
    limits_s = [PATIENCE * _usual_s(tree, *run) + START_S for run in runs]
    target.write_text(change.apply(source), "utf-8")
    try:
        what = _try(tree, runs, limits_s)
    finally:
        target.write_text(source, "utf-8")
    return Verdict(change, what, time.monotonic() - begin)


Run = tuple[Sequence[str], dict[str, str]]  # tests, and their environment


def _runs_of(
    tree: Path, change: Mutation, counted: dict[str, dict[str, list[int]]]
) -> list[Run]:
    groups = list(_tests_of(change, counted))
    # The host's own C is not built again for each change of the firmware.
    is_host = change.path.is_relative_to(HOST)
    plain = host_environment(tree) if is_host else {}
    runs = [(tests, plain) for tests in groups]
    if not is_host and groups:
        # What reaches beyond an array shows in `make test`, under this sanitizer.
        runs.append((groups[0], sanitizer.environment()))
    return runs


def _usual_s(tree: Path, tests: Sequence[str], environment: dict[str, str]) -> float:
    """The seconds of these tests without a change, by the first who asks."""
    key = (*tests, *environment)
    if key not in _known_s:
        begin = time.monotonic()
        _run(tree, tests, None, **environment)
        _known_s[key] = time.monotonic() - begin
    return _known_s[key]


_known_s: dict[tuple[str, ...], float] = {}


def _try(tree: Path, runs: Sequence[Run], limits_s: Sequence[float]) -> str:
    for (tests, environment), limit_s in zip(runs, limits_s, strict=True):
        code, text = _run(tree, tests, limit_s, **environment)
        if "NativeBuildError" in text or "SyntaxError" in text:
            return "not compiled"
        if code is None:
            return "endless"
        if code != 0:
            return "noticed"
    return "unnoticed"


def host_environment(tree: Path) -> dict[str, str]:
    """With which Python loads the package of that copy, not the one that is installed:
    tools/mutants/sitecustomize.py.
    """
    return {"PYTHONPATH": f"{ROOT / 'tools' / 'mutants'}:{tree / 'host'}"}


def _tests_of(
    change: Mutation, counted: dict[str, dict[str, list[int]]]
) -> Iterator[Sequence[str]]:
    """Test files, those that run the changed line first, a few at a time."""
    if not change.path.is_relative_to(CORE):
        room = change.path.parts[2]
        yield HOST_TESTS.get(room, (f"tests/host/{room}",))
        return
    lines = {test: files.get(str(change.path), []) for test, files in counted.items()}
    direct = [t for t, found in lines.items() if change.line in found]
    # The shortest lists first: tests of that part alone.
    direct.sort(key=lambda test: sum(map(len, counted[test].values())))
    others = [t for t, found in lines.items() if found and t not in direct]
    for group in (direct[:3], direct[3:], others):
        if group:
            yield group


def _run(
    tree: Path, tests: Sequence[str], limit_s: float | None, **environment: str
) -> tuple[int | None, str]:
    """Exit code and output of the tests; no code if they were ended at the limit."""
    words = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:xdist", *tests]
    process = subprocess.Popen(
        [*words, "-p", "no:cacheprovider"],
        cwd=tree,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"} | environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        text, _ = process.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return None, ""
    return process.returncode, text


def _tree(number: int) -> Path:
    """A copy of what git knows, as it is now, and of what is built in its folders."""
    tree = WORK / f"tree{number}"
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split("\0")
    core = importlib.util.find_spec("imud._core")
    files = [(ROOT / name, tree / name) for name in filter(None, listed)]
    if core is not None and core.origin is not None:
        files.append((Path(core.origin), tree / HOST / Path(core.origin).name))
    for source, target in files:
        if not source.is_file():
            continue
        if target.is_file() and target.read_bytes() == source.read_bytes():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(source, target)
    return tree


def _counted() -> dict[str, dict[str, list[int]]]:
    """For each test file, the lines of the firmware's files that it runs. Counted once
    for each content of those tests and files; takes some minutes.
    """
    tests = sorted(
        str(path.relative_to(ROOT))
        for folder in CORE_TESTS
        for path in (ROOT / folder).glob("test_*.py")
    )
    known = json.loads(COUNTED.read_text()) if COUNTED.exists() else {}
    tree = _tree(0)
    sources = b"".join(
        path.read_bytes() for path in sorted((ROOT / CORE).rglob("*.[ch]"))
    )
    for number, test in enumerate(tests):
        stamp = hashlib.sha256(sources + (ROOT / test).read_bytes()).hexdigest()
        if known.get(test, {}).get("stamp") == stamp:
            continue
        if sys.stderr.isatty():
            sys.stderr.write(f"\rcounting {number + 1} of {len(tests)}  {test:60}")
        known[test] = {"stamp": stamp, "files": _lines_of(tree, test)}
        COUNTED.write_text(json.dumps(known))
    return {test: known[test]["files"] for test in tests}


def _lines_of(tree: Path, test: str) -> dict[str, list[int]]:
    cache = tree / "build" / "native"
    for path in cache.glob("*.gcda"):
        path.unlink()
    _run(tree, [test], None, IMU_COVERAGE="1", IMU_SAMPLE="1")
    out = subprocess.run(
        ["gcov", "--json-format", "--stdout", *map(str, cache.glob("*.gcda"))],
        cwd=tree,
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    found: dict[str, set[int]] = {}
    for line in out.splitlines():
        for file in json.loads(line)["files"] if line.startswith("{") else ():
            path = Path(file["file"])
            if path.is_absolute() and path.is_relative_to(tree / CORE):
                name = str(path.relative_to(tree))
                ran = {each["line_number"] for each in file["lines"] if each["count"]}
                found.setdefault(name, set()).update(ran)
    return {name: sorted(lines) for name, lines in found.items() if lines}


def _equivalents() -> set[tuple[str, str, str]]:
    """Changes that change nothing, with the reason in the file."""
    table = tomllib.loads((ROOT / EQUIVALENTS).read_text("utf-8"))
    return {
        (each["file"], each["before"], each["after"])
        for each in table.get("equivalent", ())
    }


def mutations(path: Path, name: Path) -> list[Mutation]:
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


if __name__ == "__main__":
    main()
