# SPDX-License-Identifier: MIT
"""Reports clients and messages that Zenoh refuses, from the only place where it says
so: its log.
"""

from __future__ import annotations

import os
import re
import sys
import threading
from collections.abc import Callable

import zenoh

KNOWN_MAX = 256  # sessions whose name is remembered
UNKNOWN = "an unknown client"  # a session without a name

# Zenoh tells who connected in a thread of its own, maybe after it has denied the first
# message of that session. So long a line waits for its session's name.
NAMED_S = 2.0

# Lines of Zenoh's log: an accepted link, and one that is then refused.
_LINK = re.compile(r"Accepted \w+ connection on \S+?: (?P<who>[^\s.]\S*?)\.?(?:\s|$)")
_REFUSED = re.compile(r"establishment::accept: (?P<why>.*?)\.?(?: at /.*)?$")
# A link without TLS: Zenoh does not say from where. Its hint is about another cause.
_NO_TLS = re.compile(r"WARN .*zenoh_link_tls::unicast: (?P<why>.*?)(?:\. Hint: .*)?$")
# Of TLS, the client's complaint about this daemon; and this daemon's about a client.
_ALERT = re.compile(r"received fatal alert: (?P<what>\w+)")
_PEER = re.compile(r"invalid peer certificate: (?P<what>\w+)")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")

# A message that no rule allows, with the first digits of its session's id. The level
# that names the key also logs every message that is allowed: too expensive.
_DENIED = re.compile(r"demux\{.* src=\S*?/(?P<session>[0-9a-f]+)\S*: .*intercepted")
_LOGGED = (
    "zenoh_transport::unicast::establishment::accept=debug,"
    "zenoh_link_tcp::unicast=debug,zenoh_link_tls::unicast=debug,"
    "zenoh::net::routing::interceptor=trace,"
    "zenoh::net::routing::interceptor::access_control=off,"
    "zenoh::net::primitives=trace"
)
# Digits that identify a session: the log prints 8, of which the first may be a zero
# that Zenoh leaves out elsewhere.
_SESSION_DIGITS = 7

# Names of sessions by the first digits of their ids. Zenoh has one log a process.
_known: dict[str, str] = {}
_has_more = threading.Condition()


def know(session_id: str, who: str) -> None:
    """Remembers a session's name for the line about a message it was denied."""
    with _has_more:
        while len(_known) >= KNOWN_MAX:
            del _known[next(iter(_known))]
        _known[session_id[:_SESSION_DIGITS]] = who
        _has_more.notify_all()


def _name_of(session_id: str) -> str:
    """Waits for the name, but only once: later messages find UNKNOWN."""
    digits = session_id.lstrip("0")[:_SESSION_DIGITS]
    with _has_more:
        if not _has_more.wait_for(lambda: digits in _known, NAMED_S):
            know(digits, UNKNOWN)
        return _known[digits]


def tell_refusals(tell: Callable[[str, str], None]) -> None:
    """Calls `tell(kind, line)` for each client that is "refused" and for each message
    that is "denied", in a thread of its own. To be called once in a process.

    Zenoh reports them only in its log, which its Python package can only write to
    stdout. So file descriptor 1 becomes a pipe that is read here; other lines that come
    through it go to stderr. With RUST_LOG set, nothing is redirected or reported.
    """
    zenoh.init_log_from_env_or(_LOGGED)
    if "RUST_LOG" in os.environ:
        return
    source, end = os.pipe()
    os.dup2(end, 1)
    os.close(end)
    thread = threading.Thread(
        target=_read_log, args=(source, tell), name="imud-refusals", daemon=True
    )
    thread.start()


def _blamed(why: str) -> str:
    """Says on which side a handshake failed."""
    if alert := _ALERT.search(why):
        return (
            f"{UNKNOWN} does not trust this daemon ({alert['what']}): its key file is "
            "of another imud, its clock is wrong, or the daemon's certificate is out "
            "of its time (imud keys renew)"
        )
    if peer := _PEER.search(why):
        return (
            f"refused {UNKNOWN}: its certificate is not trusted here ({peer['what']}); "
            "it needs a key file of this imud (imud keys add)"
        )
    return f"refused {UNKNOWN}: TLS: {why}"


def _read_log(source: int, tell: Callable[[str, str], None]) -> None:
    who = UNKNOWN
    with os.fdopen(source, encoding="utf-8", errors="replace") as lines:
        for coloured in lines:
            line = _COLOUR.sub("", coloured).rstrip()
            if link := _LINK.search(line):
                who = link["who"]
            elif failed := _NO_TLS.search(line):
                tell("refused", f"network: {_blamed(failed['why'])}")
            elif refused := _REFUSED.search(line):
                if not refused["why"].startswith("New transport"):
                    tell("refused", f"network: refused {who}: {refused['why']}")
            elif denied := _DENIED.search(line):
                by = _name_of(denied["session"])
                tell(
                    "denied",
                    f"network: {by} requested something that its role does not allow",
                )
            elif "zenoh" not in line:  # printed by another library
                sys.stderr.write(f"{line}\n")
