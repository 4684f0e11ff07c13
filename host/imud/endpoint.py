# SPDX-License-Identifier: MIT
"""Addresses on a network: Zenoh's endpoints and keys, and HOST:PORT."""

from __future__ import annotations

import re
from ipaddress import ip_address, ip_network

# Links that don't leave the machine, whatever their address.
_LOCAL_LINKS = frozenset({"unixsock-stream", "unixpipe", "serial"})
_ENDPOINT = re.compile(r"(?P<link>[a-z0-9-]+)/(?P<host>.*?)(:\d+)?([?#].*)?")
_ADDRESS = re.compile(r"(?:\[([0-9A-Fa-f:.]+(?:%[\w.-]+)?)\]|([\w.-]+)):([0-9]{1,5})")
_IP_LINKS = frozenset({"tcp", "udp", "tls", "quic", "ws"})
_LINK = re.compile(r"([A-Za-z0-9-]+):?/+")

# One part of a key. Zenoh gives the excluded characters a meaning, and @ as the first.
NOT_IN_KEYS = r"/*$#?\s\ud800-\udfff"
NAME = re.compile(rf"(?!@)[^{NOT_IN_KEYS}]{{1,200}}")
KEY = re.compile(rf"{NAME.pattern}(/{NAME.pattern})*")


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


def misspelt(text: str, example: str) -> str:
    """Why a text is no address as `example` is, HOST:PORT or an endpoint, and which it
    probably means; empty: it is one.
    """
    usual_link, slash, usual = example.rpartition("/")
    typed = _LINK.match(text)
    link = typed[1].lower() if typed and slash else usual_link
    rest = text[typed.end() :] if typed else text
    if rest and link in _LOCAL_LINKS:
        return ""
    link = link if link in _IP_LINKS else usual_link
    place, mark, more = re.split(r"([/?#]|$)", rest, maxsplit=1)
    if host_and_port(place) is None:
        place = _with_port(re.sub(r"[][]", "", place), usual)
    right = f"{link}{slash}{place}"
    if slash and mark in "?#":
        right += mark + more
    form = "an endpoint" if slash else "HOST:PORT"
    return "" if right == text else f"{text[:80]!r} is not {form}: try {right[:80]}"


def _with_port(text: str, usual: str) -> str:
    """HOST:PORT of what may be a host or a port alone, or lack its brackets."""
    usual_host, _, usual_port = usual.rpartition(":")
    host, colon, port = text.rpartition(":")
    is_port = bool(colon) or port.isdecimal()
    if ":" in host:  # IPv6, whose last part is a port where the others are all of it
        is_whole = "::" in host or host.count(":") == 7
        is_port = is_whole and len(port) > 3 and port.isdecimal()
    if not is_port:
        host, port = text, usual_port
    if host_and_port(f"x:{port}") is None:
        port = usual_port
    found = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    return found if host_and_port(found) else f"{usual_host}:{port}"


def fitting(text: str, excluded: str, usual: str) -> str:
    """A name like that text, without the characters that a pattern's set excludes."""
    return re.sub(f"[{excluded}]+", "-", text).strip("-@._")[:64] or usual


def unfit(text: str, usual: str = "stylus") -> str:
    """Why a text can't be part of a key, and one like it that can."""
    return (
        f"{text[:80]!r} can't be part of a key, which has no spaces, no / * $ # ? and "
        f"no @ first; try {fitting(text, NOT_IN_KEYS, usual)}"
    )


def network_of(host: str) -> str:
    """An address of IPv4, or the network of one of IPv6, of which each has a /64."""
    try:
        address = ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if address.version == 6 and (mapped := address.ipv4_mapped) is None:
        return str(ip_network((address, 64), strict=False))
    return str(address if address.version == 4 else mapped)
