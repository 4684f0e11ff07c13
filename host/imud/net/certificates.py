# SPDX-License-Identifier: MIT
"""Certificates that can't be trusted now: which, why, and what to do about it."""

from __future__ import annotations

import socket
import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from imud.endpoint import host_and_port, link_of
from imud.errors import ConfigError

# A certificate that ends so soon is told of while there is time.
SOON = timedelta(days=30)

PATIENCE_S = 2.0

# What a client does about its own certificate.
ANEW = "get another key file from who runs that imud (imud keys add)"

# By the codes of OpenSSL (X509_V_ERR_ in x509_vfy.h): dates; host name, address.
_RENEW = (
    "on its machine run imud keys renew DIR and reload imud, unless {clock} is wrong"
)
_NAME = "connect by a name that it has, or there: imud keys init DIR --name HOST"
_REMEDIES = {9: _RENEW, 10: _RENEW, 62: _NAME, 64: _NAME}


def _clock() -> str:
    return f"this machine's clock ({datetime.now(UTC):%Y-%m-%d})"


def trouble(pem: bytes, whose: str, remedy: str, ahead: timedelta = SOON) -> str:
    """Why a certificate does not hold now and that time ahead; empty: it does.
    ConfigError if it is none.
    """
    try:
        held = x509.load_pem_x509_certificate(pem)
    except ValueError as error:
        raise ConfigError(f"{whose} can't be read: {error}; {remedy}") from error
    since, until = held.not_valid_before_utc, held.not_valid_after_utc
    now = datetime.now(UTC)
    if since <= now < until - ahead:
        return ""
    if since <= now < until:
        return f"{whose} expires on {until:%Y-%m-%d}: {remedy}"
    return (
        f"{whose} is valid from {since:%Y-%m-%d} to {until:%Y-%m-%d} only: {remedy}, "
        f"unless {_clock()} is wrong"
    )


def check_pair(certificate: Path, key: Path) -> None:
    """Raises ConfigError unless the private key is that of the certificate."""
    try:
        held = x509.load_pem_x509_certificate(certificate.read_bytes())
        own = load_pem_private_key(key.read_bytes(), password=None)
        is_pair = own.public_key() == held.public_key()
    except (ValueError, TypeError) as error:
        raise ConfigError(
            f"{certificate} and {key} are not a certificate and its key: {error}; "
            "create other keys with imud keys init"
        ) from error
    if not is_pair:
        raise ConfigError(
            f"{key} is not the key of {certificate}; create other keys with imud keys "
            "init"
        )


def why_refused(endpoint: str, ca: str, own: str) -> str:
    """Why no session began at a TLS endpoint, where Zenoh says only that none did: the
    client's own certificate, or the daemon's. Empty: neither. ConfigError if its own is
    none.
    """
    address = host_and_port(endpoint.partition("/")[2])
    if address is None or link_of(endpoint) != "tls":
        return ""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(cadata=ca)
        with (
            socket.create_connection(address, PATIENCE_S) as raw,
            context.wrap_socket(raw, server_hostname=address[0]),
        ):
            pass
    except ssl.SSLCertVerificationError as error:
        remedy = _REMEDIES.get(error.verify_code, "your key file is of another imud")
        return (
            f"the certificate of the imud at {endpoint} is not trusted here: "
            f"{error.verify_message.rstrip('.')}; {remedy.format(clock=_clock())}"
        )
    except OSError:
        return ""
    mine = "the certificate in your key file"
    return trouble(own.encode(), mine, ANEW, ahead=timedelta(0))
