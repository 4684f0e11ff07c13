# SPDX-License-Identifier: MIT
"""Refused clients, and the daemon's lines about them: from Zenoh's log, and in real
sessions with a daemon that has keys.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path

import msgspec
import pytest
import zenoh
import zenoh.ext

from fakes import PATIENCE_S
from guarded import PROBE, WHILE_S, Guarded, received_on
from imud import cli
from imud.client import Client
from imud.errors import DaemonNotFound
from imud.net import keys, network, refusals
from imud.net.network import Credentials

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


@pytest.fixture(scope="module")
def mutual(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    made = Guarded(tmp_path_factory.mktemp("mutual"), is_mutual=True)
    yield made
    made.close()


@pytest.fixture
def known(guarded: Guarded) -> Guarded:
    guarded.welcome()
    return guarded


def changed_by(**fields: str) -> Callable[[Credentials], Credentials]:
    return lambda mine: msgspec.structs.replace(mine, **fields)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (changed_by(password="wrong"), "Invalid password"),  # noqa: S106
        (changed_by(user="nobody"), "Invalid user"),
        (changed_by(user="operator"), "Invalid password"),
        (changed_by(password=""), "Invalid password"),
    ],
    ids=["wrong password", "unknown user", "another's name", "empty password"],
)
def test_who_does_not_know_the_password_is_refused_and_on_record(
    known: Guarded, change: Callable[[Credentials], Credentials], why: str
) -> None:
    mine = change(known.credentials("viewer"))
    with pytest.raises(DaemonNotFound, match=f"does not admit {mine.user}"):
        network.open_client(known.endpoint, mine)
    known.daemon.expect(rf"warning: network: refused 127\.0\.0\.1:\d+: .*{why}")


def test_who_shows_no_password_at_all_is_refused_and_on_record(
    known: Guarded,
) -> None:
    config = zenoh.Config()
    tls = "transport/link/tls/"
    for key, value in {
        "mode": "client",
        "connect/endpoints": [known.endpoint],
        "connect/timeout_ms": 1000,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        tls + "root_ca_certificate": str(known.keys / "ca.pem"),
    }.items():
        config.insert_json5(key, json.dumps(value))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
    known.daemon.expect("warning: network: refused .*: .*Expected extension")


def test_who_speaks_no_tls_is_refused_and_on_record(guarded: Guarded) -> None:
    plain = guarded.endpoint.replace("tls/", "tcp/")
    with pytest.raises(DaemonNotFound, match="your credentials with --keys FILE"):
        Client(plain)
    guarded.daemon.expect(r"refused 127\.0\.0\.1:\d+: TLS: it does not use TLS")


def test_a_daemon_of_another_authority_is_not_trusted(
    guarded: Guarded, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A program in the daemon's place does not get a password."""
    keys.initialise(tmp_path / "keys", ["localhost"], 1)
    path = tmp_path / "keys/clients/viewer.toml"
    where = ["--connect", guarded.endpoint, "--keys", str(path)]
    assert cli.main(["list", *where]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    guarded.daemon.expect("network: an unknown client does not trust this daemon")


def test_with_mutual_tls_password_and_certificate_have_to_be_of_one_user(
    mutual: Guarded,
) -> None:
    with mutual.session("viewer") as session:
        assert received_on(session, "imud/*/pose", wanted={f"imud/{PROBE}/pose"})
    mutual.daemon.expect("network: .* came with the certificate of viewer")
    viewer, operator = mutual.credentials("viewer"), mutual.credentials("operator")
    mixed = msgspec.structs.replace(
        operator, certificate=viewer.certificate, private_key=viewer.private_key
    )
    wanted = network._known_as(mixed, {}) | {
        "mode": "client",
        "connect/endpoints": [mutual.endpoint],
        "scouting/multicast/enabled": False,
    }
    # Ids of 16 bytes; Zenoh does not say a zero that one begins with.
    for session_id in (
        "abcdef0123456789abcdef0123456789",
        "bcdef0123456789abcdef0123456789",
    ):
        time.sleep(WHILE_S)  # what the last one asked for is told by then
        mutual.daemon.seen()
        session = zenoh.open(network._config(wanted | {"id": session_id}))
        try:
            assert not received_on(session, "imud/*/pose", "imud/*/status")
            replies = session.get(f"imud/{PROBE}/cmd/tare", timeout=WHILE_S)
            assert not [reply for reply in replies if reply.ok]
            line = mutual.daemon.expect(
                "requested something that its role does not allow"
            )
            assert "(viewer) requested" in line
        finally:
            session.close()


def denied(session: str) -> bytes:
    """A line of Zenoh's log, as refusals.py reads them."""
    return f"demux{{ src=demux/{session}}}: a message was intercepted\n".encode()


def test_a_denied_message_waits_for_the_name_of_who_sent_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(refusals, "_known", {})
    source, end = os.pipe()
    told: queue.Queue[str] = queue.Queue()
    reader = threading.Thread(
        target=refusals._read_log, args=(source, lambda _, line: told.put(line))
    )
    reader.start()
    try:
        os.write(end, denied("0abcdef0"))
        with pytest.raises(queue.Empty):
            told.get(timeout=0.1)  # nothing comes
        refusals.know("abcdef0123456789", "the viewer")
        assert "the viewer requested" in told.get()
        # It waits once for a session that nobody names.
        monkeypatch.setattr(refusals, "NAMED_S", 0.0)
        os.write(end, denied("12345678"))
        assert "an unknown client requested" in told.get()
        monkeypatch.setattr(refusals, "NAMED_S", 10 * PATIENCE_S)
        os.write(end, denied("12345678"))
        assert "an unknown client requested" in told.get()
    finally:
        os.close(end)
        reader.join()


def test_with_mutual_tls_an_unknown_certificate_or_none_is_refused(
    mutual: Guarded, tmp_path: Path
) -> None:
    keys.initialise(tmp_path / "keys", ["localhost"], 1)
    other = network.read_credentials(tmp_path / "keys/clients/viewer.toml")
    mixed = msgspec.structs.replace(
        mutual.credentials("viewer"),
        certificate=other.certificate,
        private_key=other.private_key,
    )
    with pytest.raises(DaemonNotFound):
        network.open_client(mutual.endpoint, mixed)
    mutual.daemon.expect("refused an unknown client: its certificate is not trusted")
    bare = network._known_as(mutual.credentials("viewer"), {})
    config = network._config(
        {
            "mode": "client",
            "connect/endpoints": [mutual.endpoint],
            "connect/timeout_ms": 1000,
            "connect/exit_on_failure": True,
            "scouting/multicast/enabled": False,
        }
        | {name: value for name, value in bare.items() if "connect_" not in name}
        | {"transport/link/tls/enable_mtls": False}
    )
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
    mutual.daemon.expect("network: refused an unknown client: TLS: ")


@pytest.fixture
def own(tmp_path: Path) -> Iterator[Guarded]:
    """Its keys change."""
    made = Guarded(tmp_path)
    yield made
    made.close()


def reload(guarded: Guarded, line: str) -> None:
    guarded.daemon.seen()
    guarded.daemon.process.send_signal(signal.SIGHUP)
    guarded.daemon.expect(line)


def test_a_reload_ends_the_sessions_of_who_was_removed_and_admits_who_was_added(
    own: Guarded,
) -> None:
    mine = own.credentials("other-operator")
    with own.session("viewer") as viewer, own.session("other-operator") as session:
        reload(own, "reloaded: no change")
        assert network.is_connected(session)
        keys.remove(own.keys, "other-operator")
        keys.add(own.keys, "viewer", "anna")
        reload(own, "reloaded: keys")
        while network.is_connected(session):
            time.sleep(0.02)
        assert received_on(viewer, "imud/*/pose", wanted={f"imud/{PROBE}/pose"})
        with own.session("anna"):
            assert not network.is_connected(session)
        own.daemon.expect("Invalid user")
    with pytest.raises(DaemonNotFound, match="does not admit other-operator"):
        network.open_client(own.endpoint, mine)
    # What can't be read changes nothing.
    (own.keys / "users.txt").rename(own.keys / "away.txt")
    reload(own, "reload failed, .* can't read .*users.txt")
    own.welcome()


def test_a_certificate_out_of_its_time_is_told_on_both_sides(
    own: Guarded, monkeypatch: pytest.MonkeyPatch
) -> None:
    own.hush()
    mine = own.credentials("viewer")
    for last, words, here in (
        (
            timedelta(minutes=-1),
            "is valid from .* only: imud keys renew",
            "has expired",
        ),
        (timedelta(days=7), "expires on .*: imud keys renew", ""),
    ):
        monkeypatch.setattr(keys, "AFTER", last)
        keys.renew(own.keys)
        reload(own, f"the daemon's certificate, .*server.pem, {words} ")
        if here:
            with pytest.raises(
                DaemonNotFound, match=f"{here}; on its machine run imud"
            ):
                network.open_client(own.endpoint, mine)
            own.daemon.expect(r"does not trust this daemon \(CertificateExpired\)")
    own.welcome()
    monkeypatch.setattr(keys, "AFTER", timedelta(minutes=-1))
    keys.add(own.keys, "viewer", "late")  # whom the daemon does not know yet
    with pytest.raises(DaemonNotFound, match=r"in your key file is valid .*: get"):
        network.open_client(own.endpoint, own.credentials("late"))
