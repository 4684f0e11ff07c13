# SPDX-License-Identifier: MIT
"""Makes a board with MicroPython join a Wi-Fi network and greet the daemon, through its
prompt: what fails is known while the cable is in.
"""

from __future__ import annotations

import json
import socket
from ipaddress import IPv4Address, IPv4Interface

from imud.errors import FlashError
from imud.flash.micropython import Prompt

CONFIG, KEY = "wifi.json", "probe.key"  # on the board
JOIN_S, GREET_S = 20, 10
SCAN_S = 10.0

# Without retries of its own, of which an ESP32 has any number: then it tells the cause.
_STATION = (
    "import network as n,time\ns=n.WLAN(n.STA_IF)\ns.active(True)\n"
    "try:s.config(reconnects=0)\nexcept(ValueError,TypeError):pass"
)
# Below 0, or in the two hundreds: the codes of failures, on all ports.
_JOIN = (
    "for i in range({}):\n if s.isconnected():break\n r=s.status()\n"
    " if r<0 or 199<r<300:break\n time.sleep_ms(100)\n"
    "print((s.isconnected(),[k for k in dir(n) if k[:5]=='STAT_' and "
    "getattr(n,k)==s.status()],s.ifconfig()))"
)
_SEEN = "print(sorted({bytes(w[0]) for w in s.scan()}-{b''}))"  # in any encoding
_GREET = (
    "import time\nfrom probe.udp import UDP\nu=UDP({!r},{},{!r})\n"
    "for i in range({}):\n if u.is_open():break\n time.sleep_ms(100)\n"
    "print(u.is_open())"
)


def probe_id(prompt: Prompt) -> str:
    """Of the board with the package: as its hello will have it."""
    prompt.ask("from probe.plain_settings import id_of as i\nimport machine as m")
    return prompt.ask("print(i(m.unique_id()).hex())")


def join(prompt: Prompt, name: str, password: str) -> IPv4Interface:
    """Its address in that network. FlashError with why it has none."""
    prompt.ask(_STATION)
    prompt.ask(f"s.disconnect()\ns.connect({name!r},{password!r})")
    code = _JOIN.format(round(10 * JOIN_S))
    found = prompt.value(code, tuple[bool, list[str], tuple[str, ...]], JOIN_S)
    is_joined, states, config = found
    if is_joined:
        return IPv4Interface(f"{config[0]}/{config[1]}")
    if {"STAT_WRONG_PASSWORD", "STAT_HANDSHAKE_TIMEOUT"} & {*states}:
        raise FlashError(f"{name} refused the password; run it again and type it again")
    raw = prompt.value(_SEEN, list[bytes], SCAN_S)
    seen = [each.decode(errors="replace") for each in raw]
    if name not in seen:
        others = ", ".join(seen) or "none"
        raise FlashError(
            f"the board sees no network {name}, but: {others}. It has 2.4 GHz alone: "
            f"if {name} is of 5 GHz, switch 2.4 GHz on in the router"
        )
    raise FlashError(
        f"the board sees {name}, but did not join it in {JOIN_S} s; bring it nearer to "
        "the router, and try again"
    )


def host_towards(board: IPv4Address) -> IPv4Address:
    """This machine's address, as that board reaches it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        try:
            asked.connect((str(board), 9))  # nothing is sent
        except OSError as error:
            raise FlashError(
                f"this machine has no way to {board}: join it to the same network"
            ) from error
        return IPv4Address(asked.getsockname()[0])


def greet(prompt: Prompt, board: IPv4Interface, host: IPv4Address, port: int) -> None:
    """FlashError with why if the daemon does not answer the board over the air."""
    code = _GREET.format(str(host), port, KEY, round(10 * GREET_S))
    if prompt.value(code, bool, GREET_S):
        return
    if host not in board.network:
        raise FlashError(
            f"the board is in the network {board.network}, this machine with {host} in "
            "another: join both to the same one"
        )
    raise FlashError(
        f"the board is in the network as {board.ip}, but this machine, {host}, heard "
        f"nothing from it in {GREET_S} s: open UDP port {port} in its firewall; in a "
        "guest network, let its devices reach each other"
    )


def settings(name: str, password: str, host: IPv4Address, port: int) -> bytes:
    """The board's file."""
    told = {"name": name, "password": password, "host": str(host), "port": port}
    return json.dumps(told).encode()
