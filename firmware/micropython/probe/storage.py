# SPDX-License-Identifier: MIT
"""Where settings and params survive without power: a file.

A file is written under another name and then renamed, so that a power cut leaves the
old one or the new one whole.
"""

try:
    import os
except ImportError:  # a port without files
    os = None


class FileStorage:
    """A probe's 1024 bytes in the file at `path`."""

    def __init__(self, path="probe.settings"):
        self._path = path
        self._part = path + ".part"

    def load(self, cells):
        """Fills `cells`; leaves them alone where there is no such file."""
        for path in (self._path, self._part):
            try:
                with _opened(path, "rb") as file:
                    saved = file.read()
            except OSError:
                continue
            if len(saved) == len(cells):
                cells[:] = saved
                return

    def save(self, cells):
        """Raises OSError if the file system does not store them."""
        with _opened(self._part, "wb") as file:
            if file.write(cells) != len(cells):
                raise OSError(28)  # ENOSPC
        _sync()
        try:
            os.rename(self._part, self._path)
        except OSError:  # FAT renames to no name that is taken
            os.remove(self._path)
            os.rename(self._part, self._path)
        _sync()


def _opened(path, mode):
    try:
        return open(path, mode)
    except NameError:  # a port without files
        raise OSError(19)  # noqa: B904 - ENODEV; nothing is chained there


def _sync():
    """Has the port write what it holds back, where it does such a thing."""
    if hasattr(os, "sync"):
        os.sync()
