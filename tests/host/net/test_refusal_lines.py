# SPDX-License-Identifier: MIT
"""The journal lines made from Zenoh's log: refused clients, and reasons."""

from __future__ import annotations

import os

import pytest

from imud.net import refusals

STAMP = "2026-11-27T07:00:00.000000Z  "
ACCEPT = "zenoh_transport::unicast::establishment::accept: "
CAME = f"{STAMP}DEBUG ThreadId(07) zenoh_link_tls::unicast: Accepted TLS connection on "
CAME += "127.0.0.1:7447: 192.0.2.7:50122."
DENIED = f"{STAMP}TRACE zenoh::net::primitives::demux{{zid=1 src=unicast/0a1b2c3d: "
DENIED += "declaration intercepted"


def told(*lines: str) -> list[tuple[str, str]]:
    source, end = os.pipe()
    os.write(end, "\n".join([*lines, ""]).encode())
    os.close(end)
    found: list[tuple[str, str]] = []
    refusals._read_log(source, lambda kind, text: found.append((kind, text)))
    return found


def test_who_is_refused_is_named_with_the_reason() -> None:
    refused = f"{STAMP}DEBUG {ACCEPT}Invalid password. at /build/accept.rs:10"
    assert told(CAME, refused) == [
        ("refused", "network: refused 192.0.2.7:50122: Invalid password")
    ]


def test_who_is_let_in_is_not_told_as_refused() -> None:
    assert told(CAME, f"{STAMP}DEBUG {ACCEPT}New transport opened to 0a1b2c3d") == []


def test_colours_and_unknown_addresses_are_no_hindrance() -> None:
    line = f"\x1b[2m{STAMP}\x1b[0mDEBUG {ACCEPT}Invalid user"
    assert told(line) == [
        ("refused", "network: refused an unknown client: Invalid user")
    ]


def test_a_link_without_tls_has_the_cause_and_no_hint() -> None:
    line = (
        f"{STAMP} WARN ThreadId(07) zenoh_link_tls::unicast: received corrupt message"
    )
    assert told(f"{line}. Hint: increase the system open file limit") == [
        ("refused", "network: refused an unknown client: TLS: received corrupt message")
    ]


def test_a_denied_message_has_the_name_of_its_session(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(refusals, "NAMED_S", 0.01)
    refusals.know("a1b2c3d4e5f6", "192.0.2.7:50122 (anna)")
    words = "requested something that its role does not allow"
    assert told(DENIED) == [("denied", f"network: 192.0.2.7:50122 (anna) {words}")]
    other = DENIED.replace("0a1b2c3d", "ffffffff")
    # Only the first line waits for the name.
    assert told(other, other) == [("denied", f"network: an unknown client {words}")] * 2


def test_only_so_many_sessions_are_remembered() -> None:
    for number in range(2 * refusals.KNOWN_MAX):
        refusals.know(f"{0x1000000 + number:x}", str(number))
    assert len(refusals._known) == refusals.KNOWN_MAX
    last = 2 * refusals.KNOWN_MAX - 1
    assert refusals._name_of(f"{0x1000000 + last:x}") == str(last)


def test_lines_of_other_libraries_go_to_stderr(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert (
        told("a library says hello", f"{STAMP}INFO zenoh::net: a line of no use") == []
    )
    assert capsys.readouterr().err == "a library says hello\n"
