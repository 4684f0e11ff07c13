# SPDX-License-Identifier: MIT
"""Zenoh sessions: the daemon's, as its configuration says, and those of its clients;
with the keys that `imud keys` made, and what Zenoh tells of who was refused.
"""

from __future__ import annotations

import json
import logging
import os
import re
import sys
import threading
import time
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import msgspec
import zenoh

from imud.config.settings import Zenoh, listens_on
from imud.defaults import ENDPOINT
from imud.errors import ConfigError, DaemonNotFound, ListenFailed
from imud.net import access
from imud.net.access import Role

# Files of a folder that `imud keys` made.
CA, SERVER, SERVER_KEY = "ca.pem", "server.pem", "server.key"
USERS, ROLES, CLIENTS = "users.txt", "roles.toml", "clients"

# The user that the daemon itself is, where a session of its own is a client of it.
OWN = "imud"

# Microseconds that a put waits for room towards a slow subscriber before the message
# is dropped for it. Zenoh's own 1 ms loses messages when a machine is busy; the wait
# is this sink's thread's and no one else's.
WAIT_BEFORE_DROP_US = 50_000

# A daemon on this machine answers within milliseconds, one across a network in tens.
CONNECT_TIMEOUT_MS = 2000
POLL_S = 0.01

# Of those who came last, to name who is refused.
KNOWN_MAX = 256

_TLS = "transport/link/tls/"
_PASSWORDS = "transport/auth/usrpwd"
_WAIT = "transport/link/tx/queue/congestion_control/drop/wait_before_drop"

logger = logging.getLogger("imud")


class Credentials(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A client's file: where the daemon is, how to know it, and who asks."""

    endpoint: str
    user: str
    password: str
    role: Role
    ca: str  # PEM
    certificate: str  # PEM, with the user's name
    private_key: str  # PEM


def read_credentials(path: Path) -> Credentials:
    try:
        return msgspec.toml.decode(path.read_bytes(), type=Credentials)
    except OSError as error:
        raise ConfigError(f"can't read {path}: {error.strerror}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{path} is not a file of `imud keys`: clients/NAME.toml in its folder"
        ) from error


def read_roles(folder: Path) -> dict[str, Role]:
    """The users of a folder."""
    path = folder / ROLES
    try:
        return msgspec.toml.decode(path.read_bytes(), type=dict[str, Role])
    except OSError as error:
        raise ConfigError(
            f"can't read {path}: {error.strerror}; imud keys init {folder} makes it"
        ) from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{path}: a line is NAME = ROLE, one of {', '.join(get_args(Role))}"
        ) from error


def is_guest(settings: Zenoh) -> bool:
    """Whether it has no network but that of others, which may come and go."""
    return settings.mode != "router" and not listens_on(settings)


def is_connected(session: zenoh.Session) -> bool:
    """A client connects again by itself, a peer too."""
    info = session.info
    return bool(info.routers_zid()) or bool(info.peers_zid())


def open_daemon(settings: Zenoh) -> zenoh.Session:
    """The session of `imud run`; DaemonNotFound where a guest finds nobody."""
    session = _open_daemon(settings)
    if is_guest(settings) and not _connects(session):
        session.close()
        raise _nobody_at(settings.connect)
    return session


def open_node(connect: Sequence[str], mine: Credentials | None) -> zenoh.Session:
    """A session as nodes of rmw_zenoh have it: a peer, which waits for no router."""
    wanted: dict[str, Any] = {
        "mode": "peer",
        "listen/endpoints": [],
        "connect/endpoints": list(connect),
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
        _WAIT: WAIT_BEFORE_DROP_US,
    }
    if mine is not None:
        wanted |= _known_as(mine, {})
    try:
        return zenoh.open(_config(wanted))
    except (zenoh.ZError, ConfigError) as error:
        raise ConfigError(
            f"can't connect ROS 2 to {', '.join(connect) or 'nothing'}; "
            'try ros2.connect = ["tcp/127.0.0.1:7447"]'
        ) from error


def own_credentials(settings: Zenoh, *, is_abroad: bool) -> Credentials | None:
    """By which another session of the daemon's comes into its own network, or into one
    that it is a guest of. Abroad nobody is shown what opens its own.
    """
    if settings.credentials:
        return read_credentials(Path(settings.credentials))
    if settings.keys and listens_on(settings) and not is_abroad:
        folder = Path(settings.keys)
        path = folder / CLIENTS / f"{OWN}.toml"
        if not path.exists():
            raise ConfigError(
                f"{path} is not there: imud keys add {folder} daemon {OWN}"
            )
        return read_credentials(path)
    return None


def _connects(session: zenoh.Session) -> bool:
    """Within a while: a peer's session opens before it is connected."""
    until_s = time.monotonic() + CONNECT_TIMEOUT_MS / 1000
    while not is_connected(session):
        if time.monotonic() > until_s:
            return False
        time.sleep(POLL_S)
    return True


def _nobody_at(connect: Sequence[str]) -> DaemonNotFound:
    return DaemonNotFound(f"no Zenoh router lets it in at {', '.join(connect)}")


def _open_daemon(settings: Zenoh) -> zenoh.Session:
    listen = listens_on(settings)
    wanted: dict[str, Any] = {
        "mode": settings.mode,
        "listen/endpoints": list(listen),
        "listen/exit_on_failure": True,
        "connect/endpoints": list(settings.connect),
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
        _WAIT: WAIT_BEFORE_DROP_US,
    }
    if settings.mode == "client":
        wanted |= _at_once()
    if settings.keys and listen:
        wanted |= _guard(Path(settings.keys), settings)
    if settings.credentials:
        mine = read_credentials(Path(settings.credentials))
        wanted |= _known_as(mine, wanted.get(_PASSWORDS, {}))
    config = _config(wanted)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        if settings.mode == "client":
            raise _nobody_at(settings.connect) from error
        raise ListenFailed(
            f"can't listen on {', '.join(listen)}: it is taken or not an "
            "address of this machine; stop the other imud run or name another "
            "with --listen"
        ) from error


def open_client(where: str, mine: Credentials | None = None) -> zenoh.Session:
    """A session with the daemon there."""
    wanted: dict[str, Any] = {
        "mode": "client",
        "connect/endpoints": [where],
        "scouting/multicast/enabled": False,
        **_at_once(),
    }
    if mine is not None:
        wanted |= _known_as(mine, {})
    try:
        config = _config(wanted)
    except ConfigError as error:
        raise DaemonNotFound(f"{where} is no endpoint; try {ENDPOINT}") from error
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        advice = (
            f"or it does not let {mine.user} in: see what it writes"
            if mine is not None
            else "or say where it is with --connect, and who you are with --keys FILE"
        )
        raise DaemonNotFound(
            f"no imud at {where}; start one with imud run, {advice}"
        ) from error


def _at_once() -> dict[str, Any]:
    return {"connect/timeout_ms": CONNECT_TIMEOUT_MS, "connect/exit_on_failure": True}


def _config(wanted: Mapping[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in wanted.items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            part = key.rpartition("/")[0] if "endpoints" in key else key
            raise ConfigError(f"zenoh.{part}: Zenoh can't use {value}") from error
    return config


def _guard(folder: Path, settings: Zenoh) -> dict[str, Any]:
    """Lets in who has keys, to what its role allows."""
    roles = read_roles(folder)
    for name in (CA, SERVER, SERVER_KEY, USERS):
        if not os.access(folder / name, os.R_OK):
            raise ConfigError(
                f"can't read {folder / name}; imud keys init {folder} makes it, and "
                "imud runs as its owner"
            )
    return {
        _TLS + "root_ca_certificate": str(folder / CA),
        _TLS + "listen_certificate": str(folder / SERVER),
        _TLS + "listen_private_key": str(folder / SERVER_KEY),
        _TLS + "enable_mtls": settings.mutual_tls,
        _PASSWORDS: {"dictionary_file": str(folder / USERS)},
        "access_control": access.rules(
            roles, settings.prefix, has_certificates=settings.mutual_tls
        ),
    }


def _known_as(mine: Credentials, passwords: Mapping[str, Any]) -> dict[str, Any]:
    """The certificate is sent only to who asks for one."""
    pem = {
        "root_ca_certificate": mine.ca,
        "connect_certificate": mine.certificate,
        "connect_private_key": mine.private_key,
    }
    coded = {
        f"{_TLS}{name}_base64": b64encode(text.encode()).decode()
        for name, text in pem.items()
    }
    return {
        **coded,
        _TLS + "enable_mtls": True,
        _PASSWORDS: {**passwords, "user": mine.user, "password": mine.password},
    }


# What Zenoh's log says of a link that it takes, and of one that it then refuses.
_LINK = re.compile(r"Accepted \w+ connection on \S+?: (?P<who>[^\s.]\S*?)\.?(?:\s|$)")
_REFUSED = re.compile(r"establishment::accept: (?P<why>.*?)\.?(?: at /.*)?$")
# Before it is known who: Zenoh doesn't say. Its hint is about another cause.
_NO_TLS = re.compile(r"WARN .*zenoh_link_tls::unicast: (?P<why>.*?)(?:\. Hint: .*)?$")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")

# A message that no rule allows, with the beginning of its session's id. What it was
# Zenoh tells only beside a line for each message that is allowed: too dear.
_DENIED = re.compile(r"demux\{.* src=\S*?/(?P<session>[0-9a-f]+)\S*: .*intercepted")
_LOGGED = (
    "zenoh_transport::unicast::establishment::accept=debug,"
    "zenoh_link_tcp::unicast=debug,zenoh_link_tls::unicast=debug,"
    "zenoh::net::routing::interceptor=trace,"
    "zenoh::net::routing::interceptor::access_control=off,"
    "zenoh::net::primitives=trace"
)
# Digits of a session's id to know it by: the log has 8, of which the first may be a
# zero that Zenoh leaves out wherever else it tells the id.
_SESSION_DIGITS = 7

# Sessions that came, by the beginning of their ids. A process has one log of Zenoh's.
_known: dict[str, str] = {}


def know(session_id: str, who: str) -> None:
    """By which name a session that is refused something is told of."""
    while len(_known) >= KNOWN_MAX:
        _known.pop(next(iter(_known)), None)
    _known[session_id[:_SESSION_DIGITS]] = who


def tell_refusals(tell: Callable[[str, str], None]) -> None:
    """Has `tell` called, in a thread of its own, with each client that is refused, and
    each message that is; first of which of the two kinds it is.

    Zenoh tells of them only in its log, which goes to stdout: that is read here, and
    what else comes by it goes on to stderr. Who has set RUST_LOG gets it as it is. Once
    in a process.
    """
    if "RUST_LOG" in os.environ:
        zenoh.try_init_log_from_env()
        return
    os.environ["RUST_LOG"] = _LOGGED
    zenoh.try_init_log_from_env()
    del os.environ["RUST_LOG"]
    source, end = os.pipe()
    os.dup2(end, 1)
    os.close(end)
    thread = threading.Thread(
        target=_read_log, args=(source, tell), name="imud-refusals", daemon=True
    )
    thread.start()


def _read_log(source: int, tell: Callable[[str, str], None]) -> None:
    who = "somebody"
    with os.fdopen(source, encoding="utf-8", errors="replace") as lines:
        for coloured in lines:
            line = _COLOUR.sub("", coloured).rstrip()
            if link := _LINK.search(line):
                who = link["who"]
            elif failed := _NO_TLS.search(line):
                tell("refused", f"network: somebody was refused: TLS: {failed['why']}")
            elif refused := _REFUSED.search(line):
                if not refused["why"].startswith("New transport"):
                    tell("refused", f"network: {who} was refused: {refused['why']}")
            elif denied := _DENIED.search(line):
                session = denied["session"].lstrip("0")[:_SESSION_DIGITS]
                by = _known.get(session, "somebody")
                tell("denied", f"network: {by} asked for what its role does not allow")
            elif "zenoh" not in line:
                sys.stderr.write(f"{line}\n")
