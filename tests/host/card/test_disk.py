# SPDX-License-Identifier: MIT
"""A disk is only written to if it is a card that nothing uses."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from card_files import (
    MIB,
    contents_of,
    error_of,
    frames_of,
    laid,
    logs_in,
    program,
    run,
    tape,
    with_log,
)
from fakes import FakeProbe
from imud.card import disk
from imud.errors import FileError
from programs import ran


@pytest.fixture
def kernel(tmp_path: Path) -> Iterator[Path]:
    """What Linux says of a card reader, /dev/sdb, with a card of two partitions."""
    sdb = tmp_path / "devices" / "usb1" / "sdb"
    blocks = tmp_path / "blocks"
    blocks.mkdir()
    for folder, number in (
        (sdb, "8:16"),
        (sdb / "sdb1", "8:17"),
        (sdb / "sdb2", "8:18"),
    ):
        folder.mkdir(parents=True)
        (folder / "holders").mkdir()
        (folder / "dev").write_text(f"{number}\n")
        (blocks / number).symlink_to(folder)
    for part in ("sdb1", "sdb2"):
        (sdb / part / "partition").write_text("1\n")
    for name, text in (("removable", "1"), ("ro", "0"), ("size", "62333952")):
        (sdb / name).write_text(f"{text}\n")
    yield sdb


def refusal(tmp_path: Path, number: str = "8:16", mounts: str = "") -> str:
    table = tmp_path / "mountinfo"
    table.write_text(mounts)
    try:
        disk.refuse_unless_card(Path("/dev/sdb"), number, tmp_path / "blocks", table)
    except FileError as error:
        return str(error)
    return ""


def mount(number: str, place: str) -> str:
    return f"36 35 {number} / {place} rw,noatime shared:1 - vfat /dev/x rw\n"


def test_a_card_in_a_reader_is_taken(tmp_path: Path, kernel: Path) -> None:
    others = mount("8:1", "/") + mount("0:22", "/proc")
    assert refusal(tmp_path, mounts=others) == ""
    (kernel / "removable").write_text("0\n")
    (kernel / "device").mkdir()
    (kernel / "device" / "type").write_text("SD\n")  # a reader of the board's own
    assert refusal(tmp_path) == ""


@pytest.mark.parametrize("number", ["8:16", "8:17", "8:18"])
def test_a_mounted_card_is_refused(tmp_path: Path, kernel: Path, number: str) -> None:
    assert kernel.is_dir()
    mounts = mount("8:1", "/") + mount(number, "/media/a\\040card")
    assert refusal(tmp_path, mounts=mounts) == (
        "/dev/sdb is mounted at /media/a card; umount /media/a card"
    )
    assert refusal(tmp_path, mounts=mount(number, "/")) == (
        "/dev/sdb is this computer's system disk"
    )


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("removable", "0", "/dev/sdb is not a card: it is not removable"),
        ("ro", "1", "/dev/sdb is read-only; slide the lock at the card's side"),
        ("size", "0", "no card is in /dev/sdb; put it in"),
        ("sdb2/holders/dm-0", "", "/dev/sdb is in use by dm-0"),
        ("partition", "1", "/dev/sdb is a partition; name the card itself: /dev/usb1"),
    ],
)
def test_a_disk_that_is_no_free_card_is_refused(
    tmp_path: Path, kernel: Path, name: str, text: str, told: str
) -> None:
    (kernel / name).write_text(f"{text}\n")
    assert refusal(tmp_path) == told


def test_a_partition_is_not_taken_for_a_card(tmp_path: Path, kernel: Path) -> None:
    assert kernel.is_dir()
    table = tmp_path / "mountinfo"
    table.write_text("")
    with pytest.raises(FileError, match=r"the card itself: /dev/sdb$"):
        disk.refuse_unless_card(Path("/dev/sdb1"), "8:17", tmp_path / "blocks", table)
    assert "prepare cards under Linux" in refusal(tmp_path, "9:9")


@pytest.fixture
def loop(tmp_path: Path) -> Iterator[Path]:
    """A block device of the kernel's over a file."""
    losetup = program("losetup", "mount")
    image = tmp_path / "loop.img"
    with image.open("wb") as file:
        file.truncate(64 * MIB)
    command = [losetup, "--find", "--show", str(image)]
    done = ran(*command)
    if done.returncode:
        # Containers and plain users have none: no code of ours can make one. What a
        # device is refused for is tested on made-up tables of the kernel above.
        pytest.skip("no loop device can be set up here: it takes root")
    device = Path(done.stdout.strip())
    yield device
    subprocess.run([losetup, "--detach", str(device)], check=True)


def test_a_block_device_is_prepared_and_read(
    tmp_path: Path, loop: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "(67.1 MB, no file system)" in error_of(capsys, "prepare", loop)
    descriptor = os.open(loop, os.O_RDONLY | os.O_EXCL)  # as a mount holds it
    assert error_of(capsys, "prepare", loop, "--yes") == (
        f"{loop} is in use; unmount all of it first"
    )
    os.close(descriptor)
    assert run("prepare", loop, "--yes") == 0
    each = tape(contents_of(FakeProbe(), 500))
    with_log(loop, laid([each]))
    assert run("read", loop, "--to", tmp_path) == 0
    assert frames_of(logs_in(tmp_path)[1]) == [
        message.content for message in each.messages
    ]
