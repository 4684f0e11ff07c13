# SPDX-License-Identifier: MIT
"""The params of a probe that is flashed: kept in a file until they are known to be in
force again, also by a later run than the one that was cut.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from imud.cli.flash_client import FlashClient
from imud.config.settings import state_home
from imud.errors import FlashError, ImudError
from imud.params import file
from imud.params.value import Params

PARAMS_S = 10.0  # a probe sends a part of its params after each hello
TICK_S = 0.2


def keep(client: FlashClient, status: dict[str, Any], *, is_forced: bool) -> None:
    """Saves the params in force to the probe's file. Those of other firmware can't be
    read. FlashError if ours can't either, unless that `is_forced`.
    """
    name = str(status["probe"])
    if status["state"] == "gone":
        return
    if status["state"] == "other schema":
        _say("this imud can't read its params: flashing does not change them")
        return
    try:
        before = _of(client, name)
    except FlashError as error:
        if is_forced:
            return
        raise FlashError(
            f"{error}; flash it without saving them with --force"
        ) from error
    path = _path(status)
    path.parent.mkdir(parents=True, exist_ok=True)
    file.write(path, before, str(status["probe_id"]))
    _say(f"{_named(before)}, saved to {path}")


def restore(client: FlashClient, status: dict[str, Any]) -> None:
    """Compares the active params with those of the probe's file, if there is one, and
    loads these if they differ. FlashError with where they are if that does not work.
    """
    name = str(status["probe"])
    now, path = _of(client, name), _path(status)
    if not path.exists():
        _say(f"active: {_named(now)}")
        return
    before = file.read(path).params
    if now.digest != before.digest:
        _say(f"active: {_named(now)}; loading the previous ones")
        try:
            client.change_params(name, before.encode())
        except ImudError as error:
            raise FlashError(
                f"the params were not restored ({error}): imud params load {name} "
                f"{path}"
            ) from error
    _say(f"active, as before: {_named(before)}")
    path.unlink(missing_ok=True)


def _path(status: dict[str, Any]) -> Path:
    folder = Path(state_home()).expanduser() / "imud" / "flash"
    return folder / f"{status['probe_id']}.toml"


def _of(client: FlashClient, name: str) -> Params:
    """The active params, once the probe has sent them all; FlashError if it does not,
    or if they can't be read.
    """
    until_s = time.monotonic() + PARAMS_S
    while True:
        try:
            return Params.decode(bytes.fromhex(client.params(name)["bytes"]))
        except ImudError as error:
            if time.monotonic() > until_s:
                text = f"{name} does not send its params ({error})"
                raise FlashError(text) from error
        time.sleep(TICK_S)


def _named(params: Params) -> str:
    return f"params {params.digest:08x}" if params.records else "no params"


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
