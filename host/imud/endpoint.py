# SPDX-License-Identifier: MIT
"""Addresses on a network: Zenoh's endpoints, and HOST:PORT."""

from __future__ import annotations

import re
from ipaddress import ip_address, ip_network

# Links that don't leave the machine, whatever their address.
_LOCAL_LINKS = frozenset({"unixsock-stream", "unixpipe", "serial"})
_ENDPOINT = re.compile(r"(?P<link>[a-z0-9-]+)/(?P<host>.*?)(:\d+)?([?#].*)?")
_ADDRESS = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([\w.-]+)):([0-9]{1,5})")


def link_of(endpoint: str) -> str:
    """`tls` of tls/127.0.0.1:7447."""
    return endpoint.partition("/")[0]


def is_local(endpoint: str) -> bool:
    """Whether only this machine can connect to it."""
    parts = _ENDPOINT.fullmatch(endpoint)
    if parts is None:
        return False
    if parts["link"] in _LOCAL_LINKS:
        return True
    return is_loopback(parts["host"].removeprefix("[").removesuffix("]"))


def host_of(authority: str) -> str:
    """The host of a Host header: of localhost:9735, [::1]:9735 or 127.0.0.1."""
    if authority.startswith("["):
        return authority[1:].partition("]")[0]
    return authority.partition(":")[0].lower()


def is_loopback(host: str) -> bool:
    """Whether that name or address is this machine's own."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def host_and_port(text: str) -> tuple[str, int] | None:
    """127.0.0.1:9735 or [::1]:9735; port 0: any that is free. None: neither."""
    match = _ADDRESS.fullmatch(text)
    if match is None or int(match[3]) > 0xFFFF:
        return None
    return match[1] or match[2], int(match[3])


def network_of(host: str) -> str:
    """An address of IPv4, or the network of one of IPv6, of which each has a /64."""
    try:
        address = ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if address.version == 6 and (mapped := address.ipv4_mapped) is None:
        return str(ip_network((address, 64), strict=False))
    return str(address if address.version == 4 else mapped)
