# SPDX-License-Identifier: MIT
"""The inputs that the fuzzer found worth keeping, through the same checks under both
sanitizers; `make fuzz` looks for more."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

import native
from fuzz import corpus
from native import CORE, ROOT
from programs import ran

HERE = Path(__file__).resolve().parent

# As in the Makefile, which has them for clang.
SOURCES = {
    "pose": [
        *(path for path in CORE.rglob("*.c") if path.stem != "fixed_mul"),
        ROOT / "tests" / "core" / "checked_mul.c",
    ],
    "wire": [CORE / "wire" / "frame.c", CORE / "wire" / "messages.c"],
}


def built(target: str, slip: Path | None = None) -> Path:
    """The program that replays inputs; a slip is compiled in place of its namesake."""
    sources = [HERE / "replay.c", HERE / f"fuzz_{target}.c", *SOURCES[target]]
    if slip is not None:
        sources = [path for path in sources if path.name != slip.name] + [slip]
    return native.program(sources)


def replayed(program: Path, inputs: list[Path]) -> subprocess.CompletedProcess[str]:
    """Without the options by which `make test` has complaints written to files."""
    return ran(program, *inputs, env={})


@pytest.mark.parametrize("target", corpus.TARGETS)
def test_no_input_of_the_corpus_breaks_a_promise(target: str, tmp_path: Path) -> None:
    inputs = corpus.unpack(target, tmp_path)
    done = replayed(built(target), inputs)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{len(inputs)} inputs\n"
    assert len(inputs) > 50


# A line of the core, and what a slip would make of it.
SLIPS = {
    "pose": ("math/quat.c", "3 * (Q2_30_ONE / 2)", "3 * (Q2_30_ONE / 2) - 5912"),
    "wire": ("wire/frame.c", "length == decoder->room", "length == 255"),
}


@pytest.mark.parametrize("target", corpus.TARGETS)
def test_a_slip_in_the_core_is_seen_by_the_corpus(target: str, tmp_path: Path) -> None:
    name, line, slip = SLIPS[target]
    text = (CORE / name).read_text()
    assert text.count(line) == 1, f"{name} reads otherwise: choose another slip"
    changed = tmp_path / Path(name).name
    changed.write_text(text.replace(line, slip))
    inputs = corpus.unpack(target, tmp_path / "corpus")
    done = replayed(built(target, changed), inputs)
    assert done.returncode != 0
    assert "not so" in done.stderr or "AddressSanitizer" in done.stderr


def test_the_corpus_stays_small_and_is_packed_the_same_everywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed = {target: corpus.archive(target).read_bytes() for target in corpus.TARGETS}
    inputs = [p for t in corpus.TARGETS for p in corpus.unpack(t, tmp_path / t)]
    assert sum(path.stat().st_size for path in inputs) < 100_000
    monkeypatch.setattr(corpus, "HERE", tmp_path)
    for target, data in packed.items():
        corpus.pack(target, tmp_path / target)
        assert corpus.archive(target).read_bytes() == data
