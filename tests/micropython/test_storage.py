# SPDX-License-Identifier: MIT
"""Settings in a file: whole after any power cut, and never half written."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

SOURCE = Path(__file__).resolve().parents[2] / "firmware/micropython/probe/storage.py"
OLD, NEW = b"o" * 1024, b"n" * 1024


class PowerCutError(Exception):
    """The program ends here."""


@pytest.fixture
def storage() -> ModuleType:
    """The module, which is Python for both."""
    spec = importlib.util.spec_from_file_location("storage", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class FakeFiles:
    """The functions that a save calls; the power is cut before call number `cut`."""

    def __init__(self, cut: int, *, is_fat: bool = False) -> None:
        self.left = cut
        self.is_fat = is_fat

    def _count(self) -> None:
        if self.left == 0:
            raise PowerCutError
        self.left -= 1

    def rename(self, old: str, new: str) -> None:
        self._count()
        if self.is_fat and Path(new).exists():
            raise OSError(17)  # EEXIST
        os.replace(old, new)  # noqa: PTH105 - as the module calls it

    def remove(self, path: str) -> None:
        self._count()
        Path(path).unlink()

    def sync(self) -> None:
        self._count()

    def open(self, path: str, mode: str) -> Any:
        if "w" not in mode:
            return open(path, mode)  # noqa: PTH123 - as the module calls it
        self._count()
        return TornFile(path, self._count)


class TornFile:
    """Writes half of what it gets, and the rest after the next count."""

    def __init__(self, path: str, count: Callable[[], None]) -> None:
        self._file = Path(path).open("wb")  # noqa: SIM115 - closed below
        self._count = count

    def __enter__(self) -> TornFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, data: bytes) -> int:
        half = len(data) // 2
        self._file.write(data[:half])
        self._count()
        return half + self._file.write(data[half:])


def loaded(storage: ModuleType, path: Path) -> bytes:
    cells = bytearray(1024)
    storage.FileStorage(str(path)).load(cells)
    return bytes(cells)


@pytest.mark.parametrize("is_fat", [False, True])
@pytest.mark.parametrize("cut", range(8))
def test_a_power_cut_leaves_the_old_settings_or_the_new(
    storage: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    cut: int,
    is_fat: bool,
) -> None:
    path = tmp_path / "settings"
    storage.FileStorage(str(path)).save(OLD)
    files = FakeFiles(cut, is_fat=is_fat)
    with monkeypatch.context() as patch:
        patch.setattr(storage, "os", files)
        patch.setattr(storage, "open", files.open, raising=False)
        try:
            storage.FileStorage(str(path)).save(NEW)
            is_cut = False
        except PowerCutError:
            is_cut = True
    found = loaded(storage, path)
    assert found in (OLD, NEW)
    assert is_cut or found == NEW
    assert is_cut == (cut < (7 if is_fat else 5))


def test_a_full_file_system_is_an_error_and_keeps_the_old_settings(
    storage: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "settings"
    storage.FileStorage(str(path)).save(OLD)

    class Full(TornFile):
        def write(self, data: bytes) -> int:
            return self._file.write(data[:100])

    with monkeypatch.context() as patch:
        patch.setattr(
            storage, "open", lambda name, _: Full(name, lambda: None), raising=False
        )
        with pytest.raises(OSError, match="28"):
            storage.FileStorage(str(path)).save(NEW)
    assert loaded(storage, path) == OLD


def test_without_a_file_nothing_is_loaded(storage: ModuleType, tmp_path: Path) -> None:
    assert loaded(storage, tmp_path / "settings") == bytes(1024)


def test_a_port_without_files_is_an_error_of_the_storage(
    storage: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(*_: object) -> None:
        raise NameError

    monkeypatch.setattr(storage, "open", missing, raising=False)
    assert loaded(storage, tmp_path / "settings") == bytes(1024)
    with pytest.raises(OSError, match="19"):
        storage.FileStorage(str(tmp_path / "settings")).save(NEW)
