# SPDX-License-Identifier: MIT
"""Who is kept out, and from what: real sessions with a daemon that has keys.

A put or a query that no rule allows is dropped by Zenoh without a word. So what is
asserted is that nothing came of it, beside what does come of what is allowed.
"""

from __future__ import annotations

import json
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest
import zenoh
import zenoh.ext

from fakes import DaemonProcess, FakeProbe, Port, free_endpoint
from imud import cli, keys, network
from imud.access import Role
from imud.client import Client
from imud.errors import DaemonNotFound, NoReply
from imud.network import Credentials

PROBE = "00112233445566aa"
# Longer than anything allowed was seen to take on a busy machine.
WHILE_S = 1.0


def tls_endpoint() -> str:
    return free_endpoint().replace("tcp/", "tls/")


class Guarded:
    """A daemon with keys, whose probe streams without end."""

    def __init__(self, directory: Path, *, is_mutual: bool = False) -> None:
        self.keys = directory / "keys"
        keys.initialise(self.keys, ["localhost"], 1)
        for role in ("operator", "recorder"):
            keys.add(self.keys, role, f"other-{role}")
        self.probe, self.port = FakeProbe(), Port(directory / "probe")
        settings = directory / "imud.toml"
        settings.write_text(
            f'[zenoh]\nkeys = "{self.keys}"\nmutual_tls = {json.dumps(is_mutual)}\n'
            f"history = 20\n[journal]\nburst = 100\n"
        )
        self.daemon = DaemonProcess(
            self.port.path,
            "--config",
            settings,
            directory=directory,
            log=False,
            endpoint=tls_endpoint(),
        )
        self.daemon.expect("listens on tls")
        self.endpoint = self.daemon.endpoint
        self.port.wait_open()
        self._stop = threading.Event()
        self._stream = threading.Thread(target=self._run)
        self.port.write(self.probe.say("hello"))
        self.daemon.expect("found on")
        self._stream.start()

    def _run(self) -> None:
        while not self._stop.wait(0.01):
            said = self.probe.say("pose") + self.probe.say("raw")
            self.port.write(said + self.probe.say("event"))

    def credentials(self, user: str) -> Credentials:
        path = self.keys / "clients" / f"{user}.toml"
        return msgspec.structs.replace(
            network.read_credentials(path), endpoint=self.endpoint
        )

    @contextmanager
    def session(self, user: str) -> Iterator[zenoh.Session]:
        session = network.open_client(self.endpoint, self.credentials(user))
        try:
            yield session
        finally:
            session.close()

    def hush(self) -> None:
        """While there is a reader: a full pty would hold the thread for ever."""
        self._stop.set()
        self._stream.join()

    def close(self) -> None:
        self.hush()
        self.daemon.__exit__(None, None, None)
        self.port.vanish()


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    made = Guarded(tmp_path_factory.mktemp("guarded"))
    yield made
    made.close()


@pytest.fixture(scope="module")
def mutual(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    made = Guarded(tmp_path_factory.mktemp("mutual"), is_mutual=True)
    yield made
    made.close()


def heard(session: zenoh.Session, *keys: str) -> Counter[str]:
    """What comes on these keys in a while."""
    count: Counter[str] = Counter()

    def on_sample(sample: zenoh.Sample) -> None:
        count[str(sample.key_expr)] += 1

    remote = zenoh.Locality.REMOTE
    held = [
        session.declare_subscriber(key, on_sample, allowed_origin=remote)
        for key in keys
    ]
    time.sleep(WHILE_S)
    for subscriber in held:
        subscriber.undeclare()
    return count


EVERYTHING = ("**", "imud/**", f"imud/{PROBE}/**", f"imud/{PROBE}/*", "imud/*/*")


@pytest.mark.parametrize("user", ["viewer", "operator"])
def test_a_viewer_that_subscribes_to_everything_hears_no_more_than_its_own(
    guarded: Guarded, user: Role
) -> None:
    topics = ("pose", "status", "raw", "frame", "event", "twin")
    named = [f"imud/*/{topic}" for topic in topics]
    with guarded.session(user) as session:
        count = heard(session, *EVERYTHING, *named)
    assert count.keys() == {f"imud/{PROBE}/pose", f"imud/{PROBE}/status"}
    with guarded.session(user) as session:
        assert not heard(session, *EVERYTHING)


def test_a_recorder_hears_what_there_is(guarded: Guarded) -> None:
    with guarded.session("recorder") as session:
        topics = ("pose", "status", "raw", "frame", "event")
        count = heard(session, *(f"imud/*/{topic}" for topic in topics))
    assert count.keys() == {f"imud/{PROBE}/{topic}" for topic in topics}


def test_an_operator_commands(guarded: Guarded) -> None:
    answered = threading.Event()
    before = len(guarded.probe.commands)

    def serve() -> None:
        while not answered.is_set():
            guarded.port.write(guarded.probe.hear(guarded.port.read()))

    server = threading.Thread(target=serve, daemon=True)
    server.start()
    with client(guarded, "operator") as operator:
        reply = operator.command(PROBE, "tare")
    answered.set()
    assert reply["ok"]
    assert [c["command"] for c in guarded.probe.commands[before:]] == ["tare"]


@contextmanager
def client(guarded: Guarded, user: str) -> Iterator[Client]:
    path = guarded.keys / "clients" / f"{user}.toml"
    with Client(guarded.endpoint, keys=path) as made:
        yield made


@pytest.mark.parametrize("user", ["viewer", "recorder"])
def test_a_viewer_that_commands_is_not_heard(guarded: Guarded, user: Role) -> None:
    before = len(guarded.probe.commands)
    with client(guarded, user) as mine:
        assert mine.alive() == [PROBE]
        with pytest.raises(NoReply, match="your keys don't let you command"):
            mine.command(PROBE, "tare")
        for wide in ("imud/*/cmd/tare", "imud/**", f"imud/{PROBE}/cmd/**", "**"):
            replies = mine.session.get(wide, timeout=WHILE_S)
            assert not [reply for reply in replies if reply.ok]
    assert len(guarded.probe.commands) == before


def test_a_viewer_has_the_last_status_the_history_and_who_is_alive(
    guarded: Guarded,
) -> None:
    with client(guarded, "viewer") as viewer:
        assert [status["probe"] for status in viewer.statuses()] == [PROBE]
        assert viewer.alive() == [PROBE]
        numbers: list[int] = []
        undeclare = viewer.listen(
            "pose",
            None,
            lambda each: numbers.append(json.loads(each.payload)["number"]),
            history=20,
        )
        time.sleep(WHILE_S)
        undeclare()
    # 100 a second come live: those before the first of these are of the history.
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert len(numbers) > 20


@pytest.mark.parametrize("user", ["viewer", "operator", "recorder"])
def test_spoofed_puts_reach_nobody(guarded: Guarded, user: Role) -> None:
    forged: list[str] = []

    def look(sample: zenoh.Sample) -> None:
        if sample.payload.to_bytes() == b"forged":
            forged.append(str(sample.key_expr))

    topics = ("pose", "status", "raw", "frame", "event", "twin")
    with guarded.session("other-recorder") as other, guarded.session(user) as mine:
        held = [other.declare_subscriber(f"imud/*/{topic}", look) for topic in topics]
        token = mine.liveliness().declare_token("imud/forged/alive")
        queryable = mine.declare_queryable(
            f"imud/{PROBE}/status", lambda query: query.reply(query.key_expr, b"forged")
        )
        until = time.monotonic() + WHILE_S
        while time.monotonic() < until:
            for topic in topics:
                mine.put(f"imud/{PROBE}/{topic}", b"forged")
                mine.put(f"imud/forged/{topic}", b"forged")
                mine.delete(f"imud/{PROBE}/{topic}")
            time.sleep(0.02)
        replies = other.get(f"imud/{PROBE}/status", timeout=WHILE_S)
        told = [reply.ok.payload.to_bytes() for reply in replies if reply.ok]
        alive = other.liveliness().get("imud/*/alive", timeout=WHILE_S)
        names = [str(reply.ok.key_expr) for reply in alive if reply.ok]
        token.undeclare()
        queryable.undeclare()
        for subscriber in held:
            subscriber.undeclare()
    assert not forged
    assert b"forged" not in told
    assert names == [f"imud/{PROBE}/alive"]


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
    guarded: Guarded, change: Callable[[Credentials], Credentials], why: str
) -> None:
    mine = change(guarded.credentials("viewer"))
    with pytest.raises(DaemonNotFound, match=f"does not let {mine.user} in"):
        network.open_client(guarded.endpoint, mine)
    guarded.daemon.expect(rf"warning: network: 127\.0\.0\.1:\d+ was refused: .*{why}")


def test_who_shows_no_password_at_all_is_refused_and_on_record(
    guarded: Guarded,
) -> None:
    config = zenoh.Config()
    tls = "transport/link/tls/"
    for key, value in {
        "mode": "client",
        "connect/endpoints": [guarded.endpoint],
        "connect/timeout_ms": 1000,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        tls + "root_ca_certificate": str(guarded.keys / "ca.pem"),
    }.items():
        config.insert_json5(key, json.dumps(value))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
    guarded.daemon.expect("warning: network: .* was refused: .*Expected extension")


def test_who_speaks_no_tls_is_refused_and_on_record(guarded: Guarded) -> None:
    plain = guarded.endpoint.replace("tls/", "tcp/")
    with pytest.raises(DaemonNotFound, match="who you are with --keys FILE"):
        Client(plain)
    guarded.daemon.expect("warning: network: somebody was refused: TLS: ")


def test_a_daemon_of_another_authority_is_not_trusted(
    guarded: Guarded, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Who took the daemon's place does not get to see a password."""
    keys.initialise(tmp_path / "keys", ["localhost"], 1)
    path = tmp_path / "keys/clients/viewer.toml"
    where = ["--connect", guarded.endpoint, "--keys", str(path)]
    assert cli.main(["list", *where]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    guarded.daemon.expect("network: somebody was refused: TLS: .*alert")


def test_with_mutual_tls_password_and_certificate_have_to_be_of_one_user(
    mutual: Guarded,
) -> None:
    with mutual.session("viewer") as session:
        assert heard(session, "imud/*/pose")
    mutual.daemon.expect("network: .* came with the certificate of viewer")
    viewer, operator = mutual.credentials("viewer"), mutual.credentials("operator")
    mixed = msgspec.structs.replace(
        operator, certificate=viewer.certificate, private_key=viewer.private_key
    )
    session = network.open_client(mutual.endpoint, mixed)
    try:
        assert not heard(session, "imud/*/pose", "imud/*/status")
        replies = session.get(f"imud/{PROBE}/cmd/tare", timeout=WHILE_S)
        assert not [reply for reply in replies if reply.ok]
    finally:
        session.close()


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
    mutual.daemon.expect("network: somebody was refused: TLS: ")
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
    mutual.daemon.expect("network: somebody was refused: TLS: ")


def test_who_is_removed_is_let_in_no_longer(tmp_path: Path) -> None:
    guarded = Guarded(tmp_path)
    try:
        mine = guarded.credentials("other-operator")
        network.open_client(guarded.endpoint, mine).close()
        keys.remove(guarded.keys, "other-operator")
        guarded.hush()
        guarded.daemon.stop()
        fresh = DaemonProcess(
            "--config",
            tmp_path / "imud.toml",
            directory=tmp_path,
            log=False,
            endpoint=tls_endpoint(),
        )
        with fresh, pytest.raises(DaemonNotFound):
            fresh.expect("listens on")
            network.open_client(fresh.endpoint, mine)
    finally:
        guarded.close()
