# SPDX-License-Identifier: MIT
"""Opens Zenoh sessions: the daemon's own and those of its clients, with the keys that
`imud keys` made.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import secrets
import time
from base64 import b64encode
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import msgspec
import zenoh

from imud.config.settings import Config, ZenohSettings, listens_on
from imud.defaults import ENDPOINT
from imud.endpoint import misspelt
from imud.errors import ConfigError, DaemonNotFound, ListenFailed
from imud.net import access, certificates
from imud.net.guard_process import GuardProcess, OnRefused, OnRestart, guarded
from imud.roles import Role
from imud.text_file import read_text

# Files in a folder made by `imud keys`.
CA, SERVER, SERVER_KEY = "ca.pem", "server.pem", "server.key"
USERS, ROLES, CLIENTS = "users.txt", "roles.toml", "clients"

# The daemon's own user, for a second session that connects to the first as a client.
OWN = "imud"

# How long a put waits for room in a slow subscriber's queue before the message is
# dropped for that subscriber, us. Zenoh's default of 1 ms loses messages on a busy
# machine. The loop waits so once, then for a while only the thread of the Zenoh sink
# does (daemon/lane).
WAIT_BEFORE_DROP_US = 50_000

# A daemon answers within milliseconds on this machine, tens of them over a network.
CONNECT_TIMEOUT_MS = 2000
POLL_S = 0.01
FILES = 20  # that a session opens at most, before anybody connects

# How long Zenoh waits between two attempts to connect again: its default grows to 4 s,
# and a healed link should be in use within a second.
_AGAIN = {
    "connect/retry": {
        "period_init_ms": 250,
        "period_max_ms": 1000,
        "period_increase_factor": 2,
    }
}

logger = logging.getLogger("imud")

_TLS = "transport/link/tls/"
_PASSWORDS = "transport/auth/usrpwd"
_WAIT = "transport/link/tx/queue/congestion_control/drop/wait_before_drop"


class Credentials(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A client's file: the daemon's address, its authority, and who the client is."""

    endpoint: str
    user: str
    password: str
    role: Role
    ca: str  # PEM
    certificate: str  # PEM, with the user's name
    private_key: str  # PEM


def read_credentials(path: Path) -> Credentials:
    """Reads clients/NAME.toml of a folder of `imud keys`; ConfigError if it can't."""
    try:
        return msgspec.toml.decode(read_text(path, ConfigError), type=Credentials)
    except (msgspec.DecodeError, RecursionError) as error:
        raise ConfigError(
            f"{path} is not a key file of a user, such as clients/NAME.toml from "
            "`imud keys`"
        ) from error


def read_roles(folder: Path) -> dict[str, Role]:
    """The users in a folder of `imud keys` and their roles; ConfigError on failure."""
    path = folder / ROLES
    try:
        return msgspec.toml.decode(_read(folder, ROLES), type=dict[str, Role])
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{path}: each line must be NAME = ROLE, with a role of "
            f"{', '.join(get_args(Role))}"
        ) from error


class Keys(msgspec.Struct, frozen=True):
    """What the key files of a configuration say, as read at the start or a reload."""

    digest: bytes = b""  # of all of them
    roles: dict[str, Role] = {}
    passwords: dict[str, str] = {}
    of_ros2: Credentials | None = None


def read_keys(config: Config) -> Keys:
    """Reads and checks the key files, and warns of certificates that don't hold now.
    ConfigError if the daemon can't serve with them.
    """
    settings, contents = config.zenoh, []
    roles, passwords, of_ros2 = {}, {}, None
    if settings.keys:
        folder = Path(settings.keys)
        roles = read_roles(folder)
        names = (CA, SERVER, SERVER_KEY, USERS, ROLES)
        contents = [_read(folder, name) for name in names]
        certificates.check_pair(folder / SERVER, folder / SERVER_KEY)
        again = "create other keys with imud keys init, and give out their files"
        renew = f"imud keys renew {folder}, then reload imud"
        _warn(contents[0], f"the certificate of the authority, {folder / CA},", again)
        _warn(contents[1], f"the daemon's certificate, {folder / SERVER},", renew)
        lines = contents[3].decode("utf-8", "replace").splitlines()
        pairs = (line.partition(":") for line in lines)
        passwords = {user: word for user, _, word in pairs if user and word}
    if settings.credentials:
        path = Path(settings.credentials)
        mine = read_credentials(path)
        contents.append(msgspec.json.encode(mine))
        _warn(
            mine.certificate.encode(), f"the certificate in {path}", certificates.ANEW
        )
    if config.ros2.enabled:
        of_ros2 = own_credentials(settings, is_abroad=bool(config.ros2.connect))
    digest = hashlib.sha256(b"\0".join(contents)).digest() if contents else b""
    return Keys(digest, roles, passwords, of_ros2)


def _read(folder: Path, name: str) -> bytes:
    try:
        return (folder / name).read_bytes()
    except OSError as error:
        raise ConfigError(
            f"can't read {folder / name}: {error.strerror}; create it with imud keys "
            f"init {folder}, and run imud as its owner"
        ) from error


def _warn(pem: bytes, whose: str, remedy: str) -> None:
    if fault := certificates.trouble(pem, whose, remedy):
        logger.warning("network: %s", fault)


def is_guest(settings: ZenohSettings) -> bool:
    """Whether the daemon only joins a network of others, which may come and go."""
    return settings.mode != "router" and not listens_on(settings)


def is_connected(session: zenoh.Session) -> bool:
    """Whether a router or peer is connected. Zenoh reconnects automatically."""
    info = session.info
    return bool(info.routers_zid()) or bool(info.peers_zid())


def new_id() -> str:
    """An id for open_daemon(), in Zenoh's form: 16 bytes, without leading zeros."""
    return f"{1 << 127 | secrets.randbits(127):x}"


def open_guarded(
    settings: ZenohSettings, own_id: str, on_refused: OnRefused, on_restart: OnRestart
) -> tuple[zenoh.Session, GuardProcess | None]:
    """open_daemon(), with a guard in front of its TLS endpoints, if it has any."""
    listen = listens_on(settings)
    outside = guarded(listen) if settings.keys else []
    if not outside:
        return open_daemon(settings, own_id), None
    guard = GuardProcess(outside, on_refused, on_restart)
    try:
        others = (each for each in listen if each not in outside)
        inside = (*others, guard.endpoint)
        changed = msgspec.structs.replace(settings, listen=inside)
        session = open_daemon(changed, own_id)
        guard.wait_ready()
    except BaseException:
        guard.close()
        raise
    return session, guard


def open_daemon(settings: ZenohSettings, own_id: str) -> zenoh.Session:
    """Opens the session of `imud run`. `own_id` is the source in its time stamps: with
    the same one after an outage, subscribers know that its numbers continue.

    Raises ListenFailed where an address is taken, DaemonNotFound where a guest finds
    no network, ConfigError for an endpoint or keys that Zenoh can't use.
    """
    session = _open_daemon(settings, own_id)
    if is_guest(settings) and not _connects(session):
        session.close()
        raise _nobody_at(settings.connect)
    return session


def open_node(connect: Sequence[str], mine: Credentials | None) -> zenoh.Session:
    """Opens a session like that of an rmw_zenoh node: a peer that needs no router.

    Raises ConfigError where it can't connect.
    """
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
    except zenoh.ZError as error:
        raise ConfigError(
            f"can't connect ROS 2 to {', '.join(connect) or 'nothing'}; "
            'try ros2.connect = ["tcp/127.0.0.1:7447"]'
        ) from error


def own_credentials(settings: ZenohSettings, *, is_abroad: bool) -> Credentials | None:
    """The credentials of a second session of the daemon; None: none.

    `is_abroad`: to a router of another network, which never gets the keys to our own.
    """
    path = own_file(settings, is_abroad=is_abroad)
    return None if path is None else read_credentials(path)


def own_file(settings: ZenohSettings, *, is_abroad: bool) -> Path | None:
    """The file with these credentials; ConfigError if it is missing."""
    if settings.credentials:
        return Path(settings.credentials)
    if settings.keys and listens_on(settings) and not is_abroad:
        folder = Path(settings.keys)
        path = folder / CLIENTS / f"{OWN}.toml"
        if not path.exists():
            raise ConfigError(
                f"{path} does not exist; create it with imud keys add {folder} daemon "
                f"{OWN}"
            )
        return path
    return None


def _connects(session: zenoh.Session) -> bool:
    """Waits for a connection: a peer's session opens before it has one."""
    until_s = time.monotonic() + CONNECT_TIMEOUT_MS / 1000
    while not is_connected(session):
        if time.monotonic() > until_s:
            return False
        time.sleep(POLL_S)
    return True


def _nobody_at(connect: Sequence[str]) -> DaemonNotFound:
    return DaemonNotFound(f"no Zenoh router accepts it at {', '.join(connect)}")


def _open_daemon(settings: ZenohSettings, own_id: str) -> zenoh.Session:
    listen = listens_on(settings)
    wanted: dict[str, Any] = {
        "id": own_id,
        "mode": settings.mode,
        "listen/endpoints": list(listen),
        "listen/exit_on_failure": True,
        "connect/endpoints": list(settings.connect),
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
        _WAIT: WAIT_BEFORE_DROP_US,
        **_AGAIN,
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
            f"can't listen on {', '.join(listen)}: it is taken or not an address of "
            "this machine; stop the other imud run, or choose another with --listen"
        ) from error


def open_client(where: str, mine: Credentials | None = None) -> zenoh.Session:
    """Opens a session with the daemon at `where`; DaemonNotFound if there is none."""
    wanted: dict[str, Any] = {
        "mode": "client",
        "connect/endpoints": [where],
        "scouting/multicast/enabled": False,
        **_AGAIN,
        **_at_once(),
    }
    if mine is not None:
        wanted |= _known_as(mine, {})
    if wrong := misspelt(where, ENDPOINT):
        raise DaemonNotFound(wrong)
    try:
        return zenoh.open(_config(wanted))
    except zenoh.ZError as error:
        if mine is not None and (
            why := certificates.why_refused(where, mine.ca, mine.certificate)
        ):
            raise DaemonNotFound(why) from error
        advice = (
            f"or it does not admit {mine.user}: see its output"
            if mine is not None
            else "or give its address with --connect, and your credentials with --keys "
            "FILE"
        )
        raise DaemonNotFound(
            f"no imud at {where}; start one with imud run, {advice}"
        ) from error


def _at_once() -> dict[str, Any]:
    return {"connect/timeout_ms": CONNECT_TIMEOUT_MS, "connect/exit_on_failure": True}


def _config(wanted: Mapping[str, Any]) -> zenoh.Config:
    with contextlib.ExitStack() as files:
        # Zenoh aborts where it can't open these: an OSError instead.
        for _ in range(FILES):
            files.enter_context(Path(os.devnull).open())
    config = zenoh.Config()
    for key, value in wanted.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _guard(folder: Path, settings: ZenohSettings) -> dict[str, Any]:
    """Zenoh's settings that admit users with keys of this folder, each by its role."""
    return {
        _TLS + "root_ca_certificate": str(folder / CA),
        _TLS + "listen_certificate": str(folder / SERVER),
        _TLS + "listen_private_key": str(folder / SERVER_KEY),
        _TLS + "enable_mtls": settings.mutual_tls,
        _PASSWORDS: {"dictionary_file": str(folder / USERS)},
        "access_control": access.rules(
            read_roles(folder), settings.prefix, has_certificates=settings.mutual_tls
        ),
    }


def _known_as(mine: Credentials, passwords: Mapping[str, Any]) -> dict[str, Any]:
    """Zenoh's settings that identify us. Only a daemon with mutual_tls asks for the
    certificate.
    """
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
