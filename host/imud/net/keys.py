# SPDX-License-Identifier: MIT
"""`imud keys`: a private certificate authority, users and their passwords.

The folder belongs to the daemon. A user needs only clients/NAME.toml from it.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import socket
import sys
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from imud.defaults import PORT
from imud.endpoint import fitting
from imud.errors import ConfigError, FileError
from imud.net.access import ROLES as ABOUT
from imud.net.network import (
    CA,
    CLIENTS,
    OWN,
    ROLES,
    SERVER,
    SERVER_KEY,
    USERS,
    read_credentials,
    read_roles,
)
from imud.roles import Role

CA_KEY = "ca.key"
FIRST: tuple[Role, ...] = ("viewer", "operator", "recorder")

# A machine may start with a clock that is a day behind. Certificates last long: a user
# is locked out by removal, not by a date.
BEFORE, AFTER = timedelta(days=1), timedelta(days=3650)

PASSWORD_BYTES = 24

# A running daemon reads its keys again then.
RELOAD = "once imud reloads (systemctl reload imu-probe, or kill -HUP) or starts again"

# Also the name in a certificate, of a file, and in Zenoh's list of passwords.
_USER = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?")

Key = ec.EllipticCurvePrivateKey


def initialise(folder: Path, names: Sequence[str], port: int) -> list[str]:
    """Makes the folder with an authority, a server certificate and the first users.

    `names`: host names and addresses of the daemon; clients connect to the first.
    Returns the names in the certificate. Raises FileError or ConfigError.
    """
    if folder.is_dir() and any(folder.iterdir()):
        raise FileError(
            f"{folder} is not empty; choose another folder, or add users to this one: "
            f"imud keys add {folder} viewer NAME"
        )
    hosts = [*dict.fromkeys([*names, socket.gethostname(), "localhost", "127.0.0.1"])]
    for host in hosts:
        if not _is_address(host) and not _HOST.fullmatch(host):
            raise ConfigError(f"{host!r} is neither a host name nor an address")
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        (folder / CLIENTS).mkdir(mode=0o700)
        key = _new_key()
        ca = _sign("imud", key, None, None, [])
        _write(folder / CA_KEY, _pem(key))
        _write(folder / CA, _pem(ca), is_secret=False)
        own = _new_key()
        _write(folder / SERVER_KEY, _pem(own))
        served = _pem(_sign(hosts[0], own, ca, key, hosts))
        _write(folder / SERVER, served, is_secret=False)
        _write(folder / USERS, "")
        _write(folder / ROLES, "", is_secret=False)
    except OSError as error:
        raise _failed(folder, error) from error
    where = hosts[0] if ":" not in hosts[0] else f"[{hosts[0]}]"
    for role in FIRST:
        add(folder, role, role, f"tls/{where}:{port}")
    add(folder, "daemon", OWN, f"tls/{where}:{port}")
    return hosts


def add(folder: Path, role: Role, user: str, endpoint: str | None = None) -> Path:
    """Adds a user; returns its file. `endpoint` None: the one of the other users.

    Raises ConfigError for a bad or known name, FileError if the folder can't be used.
    """
    roles = read_roles(folder)
    if not _USER.fullmatch(user):
        raise ConfigError(
            f"{user!r} is not a valid user name: letters, digits, . _ and -, at most "
            f"64; try {fitting(user, '^A-Za-z0-9._-', 'anna')}"
        )
    if user in roles:
        raise ConfigError(
            f"there is a {user} already, as {roles[user]}; "
            f"imud keys remove {folder} {user}"
        )
    try:
        ca_pem = (folder / CA).read_bytes()
        ca = x509.load_pem_x509_certificate(ca_pem)
        ca_key = serialization.load_pem_private_key(
            (folder / CA_KEY).read_bytes(), password=None
        )
        if not isinstance(ca_key, ec.EllipticCurvePrivateKey):
            raise FileError(f"{folder / CA_KEY} was not created by imud keys init")
        if endpoint is None:
            endpoint = _endpoint_of(folder)
        key = _new_key()
        password = secrets.token_urlsafe(PASSWORD_BYTES)
        path = folder / CLIENTS / f"{user}.toml"
        lines = [
            f"# What {user} needs to connect as {role}: {ABOUT[role]}. A secret.",
            f"endpoint = {_quoted(endpoint)}",
            f"user = {_quoted(user)}",
            f"password = {_quoted(password)}",
            f"role = {_quoted(role)}",
            f'ca = """\n{ca_pem.decode()}"""',
            f'certificate = """\n{_pem(_sign(user, key, ca, ca_key, []))}"""',
            f'private_key = """\n{_pem(key)}"""',
        ]
        _write(path, "\n".join(lines) + "\n")
        kept = (folder / USERS).read_text("utf-8")
        _write(folder / USERS, f"{kept}{user}:{password}\n")
        _write_roles(folder, roles | {user: role})
    except OSError as error:
        raise _failed(folder, error) from error
    except ValueError as error:
        raise FileError(
            f"{folder} was not created by imud keys init: {error}"
        ) from error
    return path


def renew(folder: Path) -> datetime:
    """Renews the daemon's certificate, with the same key and names; returns when it
    expires. Its users need nothing new: they know the authority.
    """
    try:
        ca = x509.load_pem_x509_certificate((folder / CA).read_bytes())
        old = x509.load_pem_x509_certificate((folder / SERVER).read_bytes())
        ca_key, own = (
            serialization.load_pem_private_key(path.read_bytes(), password=None)
            for path in (folder / CA_KEY, folder / SERVER_KEY)
        )
        if not isinstance(ca_key, Key) or not isinstance(own, Key):
            raise FileError(f"{folder} was not created by imud keys init")
        until = ca.not_valid_after_utc
        if until < datetime.now(UTC):
            raise FileError(
                f"the authority {folder / CA} expired on {until:%Y-%m-%d}, or the "
                "clock is wrong; create other keys with imud keys init"
            )
        names = old.extensions.get_extension_for_class(x509.SubjectAlternativeName)
        hosts = [str(name.value) for name in names.value]
        fresh = _sign(hosts[0], own, ca, ca_key, hosts)
        _write(folder / SERVER, _pem(fresh), is_secret=False)
    except OSError as error:
        raise _failed(folder, error) from error
    except (ValueError, x509.ExtensionNotFound) as error:
        raise FileError(
            f"{folder} was not created by imud keys init: {error}"
        ) from error
    return fresh.not_valid_after_utc


def remove(folder: Path, user: str) -> None:
    """Removes a user, whose sessions end when the daemon reloads, and who is refused
    from then on.
    """
    roles = read_roles(folder)
    if user not in roles:
        raise ConfigError(f"there is no user {user}, only {', '.join(sorted(roles))}")
    try:
        lines = (folder / USERS).read_text("utf-8").splitlines(keepends=True)
        kept = [line for line in lines if line.partition(":")[0] != user]
        _write(folder / USERS, "".join(kept))
        del roles[user]
        _write_roles(folder, roles)
        (folder / CLIENTS / f"{user}.toml").unlink(missing_ok=True)
    except OSError as error:
        raise _failed(folder, error) from error


def run_init(folder: Path, names: Sequence[str], port: int) -> int:
    """Makes the keys of a daemon and of one user a role in `folder`, and prints how to
    use them. Returns the exit code.
    """
    hosts = initialise(folder, names, port)
    where = f"tls/0.0.0.0:{port}"
    sys.stdout.write(
        f"{folder}: keys of a daemon at {', '.join(hosts)}\nserve:  imud run --listen "
        f"{where} --keys {folder}\nusers:  {', '.join(FIRST)}; more by imud keys add "
        f"{folder} ROLE NAME\nlisten: imud listen --keys "
        f"{folder / CLIENTS / 'viewer.toml'}, the only file that another machine "
        "needs; keep it secret\n"
    )
    return 0


def run_add(folder: Path, role: Role, user: str) -> int:
    path = add(folder, role, user)
    sys.stdout.write(f"{path}: {user} may use {ABOUT[role]}, {RELOAD}\n")
    return 0


def run_renew(folder: Path) -> int:
    until = renew(folder)
    sys.stdout.write(
        f"{folder / SERVER}: valid until {until:%Y-%m-%d}, served {RELOAD}\n"
    )
    return 0


def run_remove(folder: Path, user: str) -> int:
    remove(folder, user)
    sys.stdout.write(f"{user} is disconnected and refused, {RELOAD}\n")
    return 0


def _endpoint_of(folder: Path) -> str:
    """The daemon's endpoint: as other users have it, else from its certificate."""
    for path in sorted((folder / CLIENTS).glob("*.toml")):
        return read_credentials(path).endpoint
    served = x509.load_pem_x509_certificate((folder / SERVER).read_bytes())
    (name,) = served.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return f"tls/{name.value!s}:{PORT}"


def _new_key() -> Key:
    return ec.generate_private_key(ec.SECP256R1())


def _sign(
    name: str,
    key: Key,
    ca: x509.Certificate | None,
    ca_key: Key | None,
    hosts: Sequence[str],
) -> x509.Certificate:
    """The authority's own certificate without `ca`, a server's with `hosts`, else a
    client's.
    """
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name[:64])])
    now = datetime.now(UTC)
    is_ca = ca is None
    issuer_key = (ca_key or key).public_key()
    server, client = ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject if ca is None else ca.subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - BEFORE)
        .not_valid_after(now + AFTER)
        .add_extension(
            x509.BasicConstraints(ca=is_ca, path_length=0 if is_ca else None),
            critical=True,
        )
        .add_extension(_usage(is_ca=is_ca), critical=True)
        .add_extension(
            x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False
        )
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key),
            critical=False,
        )
    )
    if not is_ca:
        purpose = x509.ExtendedKeyUsage([server if hosts else client])
        alternatives = [_alternative(host) for host in hosts or [name]]
        builder = builder.add_extension(purpose, critical=False).add_extension(
            x509.SubjectAlternativeName(alternatives), critical=False
        )
    return builder.sign(ca_key or key, hashes.SHA256())


def _usage(*, is_ca: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not is_ca,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=is_ca,
        crl_sign=is_ca,
        encipher_only=False,
        decipher_only=False,
    )


def _alternative(host: str) -> x509.GeneralName:
    return x509.IPAddress(ip_address(host)) if _is_address(host) else x509.DNSName(host)


def _is_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def _pem(what: Key | x509.Certificate) -> str:
    encoding = serialization.Encoding.PEM
    if isinstance(what, x509.Certificate):
        return what.public_bytes(encoding).decode()
    return what.private_bytes(
        encoding,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    ).decode()


def _quoted(text: str) -> str:
    """A TOML string: TOML has JSON's escapes."""
    return json.dumps(text)


def _write_roles(folder: Path, roles: dict[str, Role]) -> None:
    lines = [f"{_quoted(user)} = {_quoted(role)}\n" for user, role in roles.items()]
    _write(folder / ROLES, "".join(lines), is_secret=False)


def _write(path: Path, text: str, *, is_secret: bool = True) -> None:
    """Writes a file whole or not at all. A secret is never readable by others."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    mode = 0o600 if is_secret else 0o644
    handle = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(handle)
    beside.replace(path)


def _failed(folder: Path, error: OSError) -> FileError:
    return FileError(f"can't write {error.filename or folder}: {error.strerror}")
