# SPDX-License-Identifier: MIT
"""Files of text that people write: read whole, or said why not."""

from __future__ import annotations

from pathlib import Path

from imud.errors import FileError, ImudError

# People write some kilobytes. Python's TOML takes minutes for megabytes of some texts.
BYTES_MAX = 256 * 1024


def read_text(path: Path, kind: type[ImudError] = FileError) -> str:
    """The text of a file, UTF-8. An error of that kind if it can't be read, is no text,
    or longer than people write.
    """
    try:
        with path.open("rb") as file:
            data = file.read(BYTES_MAX + 1)
        if len(data) > BYTES_MAX:
            raise kind(
                f"{path} is longer than {BYTES_MAX // 1024} kB; check that it is the "
                "right file"
            )
        return data.decode("utf-8")
    except OSError as error:
        raise kind(f"can't read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise kind(
            f"{path} is not a text file: byte {error.start} is not UTF-8"
        ) from error
