# SPDX-License-Identifier: MIT
"""Files of text that people write: read whole, or said why not."""

from __future__ import annotations

from pathlib import Path

from imud.errors import FileError


def read_text(path: Path) -> str:
    """The text of a file, UTF-8. FileError if it can't be read or is no text."""
    try:
        return path.read_text("utf-8")
    except OSError as error:
        raise FileError(f"can't read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise FileError(
            f"{path} is no text: byte {error.start} is not UTF-8"
        ) from error
