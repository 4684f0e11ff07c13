# SPDX-License-Identifier: MIT
"""The probe that a command means: by the daemon that runs, or by one of its own on the
port that is named, or that is the only one.
"""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from imud.cli import check_ports
from imud.client import Client
from imud.defaults import ENDPOINT
from imud.errors import DaemonNotFound, ProbeUnknown
from imud.ports.standing import same_port

TICK_S = 0.1
FIRST_S = 5.0  # the first status comes a second after the probe was found


class NoProbeHere(ProbeUnknown):
    """Nobody answers as a probe on a port."""


@dataclass(frozen=True, slots=True)
class Reached:
    client: Client
    status: dict[str, Any]
    title: str  # for people: the probe or port, and by which daemon


def probe(
    args: argparse.Namespace,
    wanted: str | None,
    command: str,
    stack: contextlib.ExitStack,
    *,
    also_gone: bool = False,
) -> Reached:
    """The probe of that name or on that port; without one, the only probe. The client,
    and a daemon of its own, end with `stack`.

    ImudError with what to do if there is none: `command` is what is typed, as
    "imud check". `also_gone`: a probe that does not answer now counts too.
    """
    is_port = wanted is not None and "/" in wanted
    try:
        client = stack.enter_context(Client(args.connect, args.prefix, args.keys))
    except DaemonNotFound:
        if args.keys is not None or args.connect != ENDPOINT:
            raise
        if wanted is not None and not is_port:
            raise DaemonNotFound(
                f"no running daemon knows probe {wanted}; give its port instead: "
                f"{command} /dev/ttyUSB0"
            ) from None
    else:
        if not is_port:
            status = _status(client, wanted, command, also_gone=also_gone)
            return Reached(client, status, f"{status['probe']} (by imud run)")
        for status in client.statuses():
            if is_on(status, str(wanted)):
                return Reached(client, status, f"{status['probe']} (by imud run)")
    port = wanted if wanted is not None else check_ports.only_port(command)
    daemon = stack.enter_context(check_ports.OwnDaemon(port))
    client = stack.enter_context(daemon.client())
    return Reached(client, _status(client, None, command, daemon), port)


def is_on(status: Mapping[str, Any], port: str) -> bool:
    """Whether a probe is on that port."""
    return status["port"] is not None and same_port(status["port"], port)


def _status(
    client: Client,
    name: str | None,
    command: str,
    daemon: check_ports.OwnDaemon | None = None,
    *,
    also_gone: bool = False,
) -> dict[str, Any]:
    """The status of the probe that is meant, once there is one."""
    wait_s = FIRST_S if daemon is None else check_ports.PROBE_S
    until_s = time.monotonic() + wait_s
    while True:
        found = [
            each for each in client.statuses() if also_gone or each["state"] != "gone"
        ]
        named = [
            each for each in found if name in (None, each["probe"], each["probe_id"])
        ]
        if len(named) == 1:
            return named[0]
        names = ", ".join(str(each["probe"]) for each in found)
        if len(named) > 1:
            raise ProbeUnknown(f"there are {len(named)} probes; choose one: {names}")
        if daemon is not None:
            daemon.check()
        if time.monotonic() > until_s:
            break
        time.sleep(TICK_S)
    if daemon is not None:
        raise NoProbeHere(
            f"no probe on {daemon.port}: check that it is flashed (docs/flash.md) and "
            "that this is its port"
        )
    if name is not None and names:
        raise ProbeUnknown(f"no probe {name}; choose one: {names}")
    raise ProbeUnknown(
        f"imud run has no probe; plug one in, or give its port: {command} /dev/ttyUSB0"
    )
