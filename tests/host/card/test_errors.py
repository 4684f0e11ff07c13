# SPDX-License-Identifier: MIT
"""A card that can't be prepared, read or written causes a one-line error."""

from __future__ import annotations

import errno
import os
import re
import struct
import sys
from pathlib import Path

import pytest

from card_files import (
    SMALL,
    Terminal,
    bare,
    blocks_of,
    error_of,
    prepared,
    run,
    sealed,
    start_of,
    with_log,
)
from fakes import FakeProbe
from imud.card import prepare
from imud.card.disk import Disk
from imud.errors import FileError


def test_what_can_not_be_prepared_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = tmp_path / "small.img"
    assert error_of(capsys, "prepare", small, "--size", SMALL - 2**19) == (
        f"{small}: {SMALL - 2**19} bytes are too small: FAT32 needs {SMALL} (34 MiB)"
    )
    assert not small.exists()
    assert error_of(capsys, "prepare", small) == (
        f"{small} does not exist; --size BYTES creates an image"
    )
    assert error_of(capsys, "prepare", "/dev/nothing") == (
        "can't look at /dev/nothing: No such file or directory; put the card in, and "
        "look for its name with lsblk"
    )
    for place in ("/dev/null", tmp_path):
        assert error_of(capsys, "prepare", place) == (
            f"{place} is neither a card nor a file"
        )
    small.write_bytes(b"a letter")
    assert "too small" in error_of(capsys, "prepare", small, "--yes")
    assert error_of(capsys, "prepare", small, "--size", "64M") == (
        f"{small} already exists; --size is for a new image"
    )
    assert small.read_bytes() == b"a letter"
    assert "multiple of 512K" in error_of(
        capsys, "prepare", tmp_path / "odd.img", "--size", SMALL + 1
    )
    far = tmp_path / "no" / "card.img"
    assert error_of(capsys, "prepare", far, "--size", SMALL) == (
        f"can't write {far}: No such file or directory"
    )


@pytest.mark.parametrize("text", ["", "M", "8T", "-1", "1.5G", "0x200"])
def test_a_size_is_a_number(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        run("prepare", "card.img", f"--size={text}")
    assert "is not a number of bytes" in capsys.readouterr().err


def test_nothing_is_overwritten_without_a_yes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    capsys.readouterr()
    before = path.read_bytes()
    assert re.fullmatch(
        re.escape(str(path)) + r" \(35.7 MB, the log of a probe, 2.\d kB of it "
        r"written\) would be overwritten; pass --yes",
        error_of(capsys, "prepare", path),
    )
    for answer in ("", "\n", "y\n", "no\n"):
        monkeypatch.setattr(sys, "stdin", Terminal(answer))
        assert run("prepare", path) == 1
        told = capsys.readouterr().err
        assert "has 35.7 MB and holds the log of a probe" in told
        assert told.endswith(f"imud: {path} was not changed\n")
    assert path.read_bytes() == before
    monkeypatch.setattr(sys, "stdin", Terminal("yes\n"))
    assert run("prepare", path) == 0
    assert path.read_bytes() != before


def test_what_is_on_a_card_is_named(tmp_path: Path) -> None:
    path = tmp_path / "card.img"

    def named() -> str:
        return error_of_ask(path)

    prepared(path)
    assert "the empty log of a probe" in named()
    with path.open("r+b") as file:
        start = start_of(path) * 512
        file.seek(start)
        boot = file.read(512)
        file.seek(start)
        file.write(bytes(512))
    assert "1 partition (type 0x0c)" in named()
    with path.open("r+b") as file:
        file.write(boot)
    assert "a FAT32 file system" in named()
    with path.open("r+b") as file:
        file.write(b"\x01" * 512)
    assert "something else" in named()
    path.write_bytes(b"")
    os.truncate(path, SMALL)
    assert "no file system" in named()


def error_of_ask(path: Path) -> str:
    with pytest.raises(FileError, match="pass --yes") as caught:
        prepare.prepare(path, size=None, log_size=None, is_agreed=False)
    return str(caught.value)


def test_a_card_that_does_not_keep_what_is_written_is_found_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "card.img"
    real = Disk.write

    def write(self: Disk, sector: int, data: bytes) -> None:
        if sector == 128:  # where the partition begins
            data = data[:-1] + b"\x01"
        real(self, sector, data)

    monkeypatch.setattr(Disk, "write", write)
    told = error_of(capsys, "prepare", path, "--size", SMALL)
    assert told.endswith(
        "does not store what is written (sector 128); use another card"
    )
    assert not path.exists()


def test_a_preparation_that_is_cut_leaves_no_card_of_a_probe(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = prepared(tmp_path / "card.img")
    places: list[int] = []
    monkeypatch.setattr(Disk, "write", lambda _, sector, __: places.append(sector))
    monkeypatch.setattr(Disk, "read", lambda *_: b"")
    with pytest.raises(FileError, match="does not store"):
        prepare.prepare(path, size=None, log_size=None, is_agreed=True)
    monkeypatch.undo()
    assert places[0] == places[-1] == 0
    for cut in range(1, len(places)):
        left = iter(range(cut))
        real = Disk.write

        def write(self: Disk, sector: int, data: bytes) -> None:
            if next(left, None) is None:  # noqa: B023 - used up within this turn
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            real(self, sector, data)  # noqa: B023 - the same in each turn

        with monkeypatch.context() as patch:
            patch.setattr(Disk, "write", write)
            told = error_of(capsys, "prepare", path, "--yes")
            assert told == f"can't write {path}: Input/output error"
        assert "is not a probe's card" in error_of(capsys, "list", path)
    assert run("prepare", path, "--yes") == 0


def test_what_can_not_be_read_is_told_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "some.file"
    assert error_of(capsys, "list", file) == (
        f"can't read {file}: No such file or directory"
    )
    assert error_of(capsys, "read", tmp_path) == (
        f"can't read {tmp_path}: Is a directory; name a file that is in it"
    )
    for data in (b"", b"a letter", bytes(4096), b"\x55\xaa" * 4096):
        file.write_bytes(data)
        assert error_of(capsys, "list", file).startswith(
            f"{file} is not a probe's card: "
        )
    head = struct.pack("<8sHHIII", b"IMUPROBE", 2, 512, 5, 8192, 100)
    file.write_bytes(sealed(head.ljust(508, b"\0")))
    assert "has a log of version 2, this imud reads 1" in error_of(capsys, "list", file)
    file.write_bytes(head.ljust(512, b"\0"))
    assert "was not prepared for a probe" in error_of(capsys, "read", file)
    path = bare(tmp_path, blocks_of([FakeProbe(), FakeProbe()], 0x1234))
    assert error_of(capsys, "read", path, "--recording", 7) == (
        f"{path} has no recording 7; it has 1, 2"
    )
    assert error_of(capsys, "read", path, "--started", "2026-01-02") == (
        "--started applies to one recording: add --recording N"
    )
    with pytest.raises(SystemExit, match="2"):
        run("read", path, "--started", "yesterday")


def test_a_full_disk_is_told_and_leaves_no_half_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bare(tmp_path, blocks_of([FakeProbe()], 0x1234, 400))
    to = tmp_path / "logs"
    to.mkdir()
    log = to / f"card-00001234-{FakeProbe().name}-1.mcap"
    (to / f"{log.name}.part").symlink_to("/dev/full")
    assert error_of(capsys, "read", path, "--to", to) == (
        f"can't write {log}: No space left on device; choose another folder with "
        "--to DIR"
    )
    assert list(to.iterdir()) == []
    (tmp_path / "file").touch()
    assert "choose another folder with --to DIR" in error_of(
        capsys, "read", path, "--to", tmp_path / "file"
    )
