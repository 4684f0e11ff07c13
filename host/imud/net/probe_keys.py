# SPDX-License-Identifier: MIT
"""`imud keys probe`: the keys of probes that send datagrams, one file each."""

from __future__ import annotations

import os
import re
import secrets
import sys
from pathlib import Path

from imud.errors import ConfigError, FileError

PROBES = "probes"  # in a folder of `imud keys`
KEY_BYTES = 32

_NAME = re.compile(r"([0-9a-f]{16})\.key")
_ID = re.compile(r"[0-9a-f]{16}")
_KEY = re.compile(rf"[0-9a-f]{{{2 * KEY_BYTES}}}")


def make(folder: Path, probe_id: str) -> Path:
    """Makes the key of a probe; returns its file. Raises ConfigError for a bad or known
    id, FileError if the folder can't be used.
    """
    if not _ID.fullmatch(probe_id):
        raise ConfigError(
            f"{probe_id!r} is not a probe id, which has 16 hexadecimal digits; imud "
            "list shows it"
        )
    path = folder / PROBES / f"{probe_id}.key"
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise ConfigError(
            f"{path} already exists; delete it to create another"
        ) from None
    except OSError as error:
        raise FileError(f"can't write {path}: {error.strerror}") from error
    with os.fdopen(handle, "w", encoding="ascii") as file:
        file.write(f"{secrets.token_hex(KEY_BYTES)}\n")
    return path


def read(folder: Path) -> dict[bytes, bytes]:
    """Keys by the ids of their probes. Raises ConfigError where one can't be read."""
    found: dict[bytes, bytes] = {}
    place = folder / PROBES
    try:
        for path in sorted(place.iterdir()):
            name = _NAME.fullmatch(path.name)
            if name is None:
                continue
            text = path.read_text("ascii").strip()
            if not _KEY.fullmatch(text):
                raise ConfigError(f"{path} was not created by imud keys probe")
            found[bytes.fromhex(name[1])] = bytes.fromhex(text)
    except OSError as error:
        raise ConfigError(
            f"can't read {error.filename}: {error.strerror}; create it with imud keys "
            f"probe {folder} ID"
        ) from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} was not created by imud keys probe") from error
    return found


def run_make(folder: Path, probe_id: str) -> int:
    path = make(folder, probe_id)
    sys.stdout.write(
        f"{path}: a secret of the probe and the daemon\n"
        f"probe:  mpremote cp {path} :probe.key\n"
        f'daemon: [ports] udp = "0.0.0.0:8736", udp_keys = "{folder}"\n'
    )
    return 0
