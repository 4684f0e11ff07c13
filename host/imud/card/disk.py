# SPDX-License-Identifier: MIT
"""A card in a reader or its image in a file, read and written by sectors. A disk is
only opened for writing if it is a card that nothing uses.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from imud.card.fat import SECTOR
from imud.errors import FileError

# Where Linux lists disks, and what is mounted.
BLOCKS = Path("/sys/dev/block")
MOUNTS = Path("/proc/self/mountinfo")

_REREAD = 0x125F  # BLKRRPART of <linux/fs.h>

_DEVICES = Path("/dev")

# Which not every system has or needs.
_PLAIN = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)

# A disk that is mounted at one of these is what this computer runs from.
_SYSTEM = {"/", "/boot", "/boot/efi", "/boot/firmware", "/etc", "/home", "/usr", "/var"}


class Disk:
    """An open card or image. Its methods raise OSError; `told` makes it a FileError."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self.path = path
        self._descriptor = descriptor
        self.bytes = os.lseek(descriptor, 0, os.SEEK_END)

    @property
    def sectors(self) -> int:
        return self.bytes // SECTOR

    def read_at(self, offset: int, size: int) -> bytes:
        """`size` bytes from `offset`, fewer at the end of the card."""
        parts = []
        os.lseek(self._descriptor, offset, os.SEEK_SET)
        while size > 0 and (part := os.read(self._descriptor, size)):
            parts.append(part)
            size -= len(part)
        return b"".join(parts)

    def read(self, sector: int, count: int) -> bytes:
        """`count` sectors from `sector`, fewer at the end of the card."""
        return self.read_at(sector * SECTOR, count * SECTOR)

    def write(self, sector: int, data: bytes) -> None:
        """Writes all of `data` from the start of `sector`."""
        os.lseek(self._descriptor, sector * SECTOR, os.SEEK_SET)
        while data:
            data = data[os.write(self._descriptor, data) :]

    def settle(self) -> None:
        """Waits until all is on the card, and has reads come from the card itself."""
        os.fsync(self._descriptor)
        if hasattr(os, "posix_fadvise"):
            os.posix_fadvise(self._descriptor, 0, 0, os.POSIX_FADV_DONTNEED)

    def reread(self) -> None:
        """Has the kernel read the partition table again."""
        if stat.S_ISBLK(os.fstat(self._descriptor).st_mode):
            # Where this fails, it does so when the card is put in again.
            with contextlib.suppress(OSError, ImportError):
                import fcntl

                fcntl.ioctl(self._descriptor, _REREAD)


@contextlib.contextmanager
def as_file_error(doing: str, hint: str = "") -> Iterator[None]:
    """Turns an OSError into a FileError: can't `doing`, the reason, `hint`."""
    try:
        yield
    except OSError as error:
        raise FileError(f"can't {doing}: {error.strerror}{hint}") from error


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Disk]:
    """Opens a card or a file for reading; FileError if it can't."""
    with as_file_error(f"read {path}", _hint(path)):
        descriptor = os.open(path, os.O_RDONLY | _PLAIN)
        try:
            if stat.S_ISDIR(os.fstat(descriptor).st_mode):
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            yield Disk(path, descriptor)
        finally:
            os.close(descriptor)


@contextlib.contextmanager
def created(path: Path, size: int) -> Iterator[Disk]:
    """Makes an image of `size` zero bytes, and removes it again after an error."""
    with as_file_error(f"write {path}"):
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | _PLAIN
        descriptor = os.open(path, flags, 0o666)
        try:
            os.truncate(descriptor, size)
            yield Disk(path, descriptor)
        except BaseException:
            path.unlink()
            raise
        finally:
            os.close(descriptor)


@contextlib.contextmanager
def claimed(path: Path) -> Iterator[Disk]:
    """Opens an existing card or image for writing; FileError where that is unsafe."""
    with as_file_error(f"look at {path}", _hint(path)):
        status = path.stat()
    flags = os.O_RDWR | _PLAIN
    if stat.S_ISBLK(status.st_mode):
        number = f"{os.major(status.st_rdev)}:{os.minor(status.st_rdev)}"
        refuse_unless_card(path, number)
        flags |= os.O_EXCL  # fails if anything uses any part of the card
    elif not stat.S_ISREG(status.st_mode):
        raise FileError(f"{path} is neither a card nor a file")
    with as_file_error(f"write {path}", _hint(path)):
        try:
            descriptor = os.open(path, flags)
        except OSError as error:
            raise _refused(path, error) from error
        try:
            yield Disk(path, descriptor)
        finally:
            os.close(descriptor)


def _refused(path: Path, error: OSError) -> OSError | FileError:
    if error.errno == errno.EBUSY:
        return FileError(f"{path} is in use; unmount all of it first")
    if error.errno == errno.EROFS:
        return FileError(f"{path} is read-only; slide the lock at the card's side")
    if error.errno == errno.ENOMEDIUM:
        return FileError(f"no card is in {path}; put it in")
    return error


def _hint(path: Path) -> str:
    is_device = _DEVICES in path.absolute().parents
    if not is_device:
        return ""
    if not path.exists():
        return "; put the card in, and look for its name with lsblk"
    return "" if os.access(path, os.R_OK | os.W_OK) else "; try sudo"


def refuse_unless_card(
    path: Path, number: str, blocks: Path = BLOCKS, mounts: Path = MOUNTS
) -> None:
    """FileError for a disk that is no card, is in use, or is read-only.

    `number`: of its block device, MAJOR:MINOR.
    """
    if not (blocks / number).exists():
        raise FileError(
            f"{path} can't be checked on this system; prepare cards under Linux, "
            "images anywhere"
        )
    disk = (blocks / number).resolve()
    if (disk / "partition").exists():
        whole = path.with_name(disk.parent.name)
        raise FileError(f"{path} is a partition; name the card itself: {whole}")
    numbers = {number} | {_text_of(part) for part in disk.glob("*/dev")}
    places = [place for at, place in _mounted(mounts) if at in numbers]
    if _SYSTEM.intersection(places):
        raise FileError(f"{path} is this computer's system disk")
    if places:
        raise FileError(
            f"{path} is mounted at {', '.join(places)}; umount {' '.join(places)}"
        )
    holders = [*disk.glob("holders/*"), *disk.glob("*/holders/*")]
    if holders:
        users = ", ".join(sorted({holder.name for holder in holders}))
        raise FileError(f"{path} is in use by {users}")
    is_card = (
        _text_of(disk / "removable") == "1" or _text_of(disk / "device/type") == "SD"
    )
    if not is_card and not disk.name.startswith("loop"):
        raise FileError(f"{path} is not a card: it is not removable")
    if _text_of(disk / "size") == "0":
        raise FileError(f"no card is in {path}; put it in")
    if _text_of(disk / "ro") == "1":
        raise FileError(f"{path} is read-only; slide the lock at the card's side")


def _text_of(file: Path) -> str:
    try:
        return file.read_text().strip()
    except OSError:
        return ""


def _mounted(mounts: Path) -> Iterator[tuple[str, str]]:
    """Device number and place of each mount: proc(5), /proc/pid/mountinfo."""
    for line in _text_of(mounts).splitlines():
        fields = line.split()
        if len(fields) > 4:
            yield fields[2], fields[4].replace("\\040", " ")
