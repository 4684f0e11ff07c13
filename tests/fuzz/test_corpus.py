# SPDX-License-Identifier: MIT
"""The inputs that the fuzzer found worth keeping, through the same checks under both
sanitizers; `make fuzz` looks for more."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from fuzz import corpus

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
CORE = ROOT / "firmware" / "core"


def built(target: str, out: Path, core: Path = CORE) -> Path:
    program = out / f"replay_{target}"
    subprocess.run(
        ["make", "--silent", "-C", HERE, f"OUT={out}", f"CORE={core}", program],
        check=True,
    )
    return program


def replayed(program: Path, inputs: list[Path]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [program, *inputs], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("target", corpus.TARGETS)
def test_no_input_of_the_corpus_breaks_a_promise(target: str, tmp_path: Path) -> None:
    inputs = corpus.unpack(target, tmp_path)
    done = replayed(built(target, ROOT / "build" / "fuzz"), inputs)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{len(inputs)} inputs\n"
    assert len(inputs) > 50


# A line of the core, and what a slip would make of it.
SLIPS = {
    "pose": ("math/fixed.h", "INT32_C(1073741824)", "INT32_C(1073730000)"),
    "wire": ("wire/frame.c", "length == decoder->room", "length == 255"),
}


@pytest.mark.parametrize("target", corpus.TARGETS)
def test_a_slip_in_the_core_is_seen_by_the_corpus(target: str, tmp_path: Path) -> None:
    name, line, slip = SLIPS[target]
    core = shutil.copytree(CORE, tmp_path / "core")
    text = (core / name).read_text()
    assert text.count(line) == 1, f"{name} reads otherwise: choose another slip"
    (core / name).write_text(text.replace(line, slip))
    inputs = corpus.unpack(target, tmp_path / "corpus")
    done = replayed(built(target, tmp_path, core), inputs)
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
