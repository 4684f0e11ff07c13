# SPDX-License-Identifier: MIT
"""Folders of keys: what is in them, who can read it, and what can't be."""

from __future__ import annotations

import stat
import tomllib
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.verification import PolicyBuilder, Store

from imud import cli
from imud import endpoint as endpoints
from imud.config.reader import load
from imud.config.settings import Config, ZenohSettings
from imud.defaults import ENDPOINT, PAGE
from imud.errors import ConfigError, FileError, ImudError
from imud.net import access, keys, network


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("all") / "keys"
    keys.initialise(folder, ["probes.example.org", "192.0.2.7"], 7447)
    return folder


def test_only_certificates_and_roles_can_be_read_by_others(made: Path) -> None:
    modes = {
        str(path.relative_to(made)): stat.S_IMODE(path.stat().st_mode)
        for path in made.rglob("*")
    }
    assert modes == {
        "ca.key": 0o600,
        "ca.pem": 0o644,
        "server.key": 0o600,
        "server.pem": 0o644,
        "users.txt": 0o600,
        "roles.toml": 0o644,
        "clients": 0o700,
        "clients/viewer.toml": 0o600,
        "clients/operator.toml": 0o600,
        "clients/recorder.toml": 0o600,
        "clients/imud.toml": 0o600,
    }
    assert stat.S_IMODE(made.stat().st_mode) == 0o700


def test_the_daemons_certificate_holds_for_each_of_its_names(made: Path) -> None:
    ca = x509.load_pem_x509_certificate((made / "ca.pem").read_bytes())
    served = x509.load_pem_x509_certificate((made / "server.pem").read_bytes())
    policy = PolicyBuilder().store(Store([ca]))
    for host in ("probes.example.org", "localhost"):
        policy.build_server_verifier(x509.DNSName(host)).verify(served, [])
    for address in ("192.0.2.7", "127.0.0.1"):
        subject = x509.IPAddress(keys.ip_address(address))
        policy.build_server_verifier(subject).verify(served, [])
    with pytest.raises(x509.verification.VerificationError):
        policy.build_server_verifier(x509.DNSName("other.example.org")).verify(
            served, []
        )


def test_a_users_certificate_is_signed_and_names_it(made: Path) -> None:
    mine = network.read_credentials(made / "clients/operator.toml")
    assert mine.endpoint == "tls/probes.example.org:7447"
    assert (mine.user, mine.role) == ("operator", "operator")
    ca = x509.load_pem_x509_certificate(mine.ca.encode())
    own = x509.load_pem_x509_certificate(mine.certificate.encode())
    policy = PolicyBuilder().store(Store([ca])).build_client_verifier()
    assert policy.verify(own, []).subjects is not None
    assert own.subject.rfc4514_string() == "CN=operator"


def test_each_password_is_another_and_of_192_bits(made: Path) -> None:
    lines = (made / "users.txt").read_text("utf-8").splitlines()
    passwords = [line.partition(":")[2] for line in lines]
    assert len(set(passwords)) == 4
    assert all(len(password) == 32 for password in passwords)  # base64
    mine = network.read_credentials(made / "clients/viewer.toml")
    assert f"viewer:{mine.password}" in lines


def test_a_user_is_added_and_removed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "keys"
    assert cli.main(["keys", "init", str(folder), "--name", "::1", "--port", "70"]) == 0
    assert f"--listen tls/0.0.0.0:70 --keys {folder}" in capsys.readouterr().out
    assert cli.main(["keys", "add", str(folder), "operator", "anna"]) == 0
    assert network.read_roles(folder)["anna"] == "operator"
    mine = network.read_credentials(folder / "clients/anna.toml")
    assert mine.endpoint == "tls/[::1]:70"
    assert cli.main(["keys", "remove", str(folder), "anna"]) == 0
    assert "anna" not in network.read_roles(folder)
    assert "anna" not in (folder / "users.txt").read_text("utf-8")
    assert not (folder / "clients/anna.toml").exists()


@pytest.mark.parametrize(
    "name", ["", "a b", "a:b", "../anna", "-x", "a\n", "ä", "x" * 65, "a/b", "#"]
)
def test_a_name_that_could_be_more_than_a_name_is_refused(
    made: Path, name: str
) -> None:
    with pytest.raises(ConfigError, match="is not a valid user name"):
        keys.add(made, "viewer", name)


@pytest.mark.parametrize("host", ["", "a b", "-x", "a_b", "x\n", "a/b", "*.org"])
def test_a_host_that_is_none_is_refused(tmp_path: Path, host: str) -> None:
    with pytest.raises(ConfigError, match="neither a host name"):
        keys.initialise(tmp_path / "keys", [host], 7447)
    assert not (tmp_path / "keys").exists()


def test_what_is_there_is_not_overwritten(made: Path) -> None:
    before = (made / "ca.key").read_bytes()
    with pytest.raises(FileError, match="is not empty"):
        keys.initialise(made, [], 7447)
    with pytest.raises(ConfigError, match="there is a viewer already, as viewer"):
        keys.add(made, "recorder", "viewer")
    with pytest.raises(
        ConfigError, match="there is no user anna, only imud, operator, rec"
    ):
        keys.remove(made, "anna")
    assert (made / "ca.key").read_bytes() == before


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("roles.toml", "viewer = 'king'"),
        ("roles.toml", "viewer"),
        ("ca.key", "no key"),
        ("ca.pem", "no certificate"),
        ("clients/viewer.toml", "endpoint = 1"),
    ],
)
def test_a_file_that_was_spoilt_is_one_line(
    tmp_path: Path, file: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "keys"
    keys.initialise(folder, [], 7447)
    for path in (folder / "clients").iterdir():
        if path.name != "viewer.toml":
            path.unlink()
    (folder / file).write_text(text, "utf-8")
    assert cli.main(["keys", "add", str(folder), "viewer", "anna"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("imud: ")
    assert error.count("\n") == 1
    assert "internal error" not in error


def test_without_a_folder_the_way_to_one_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"create it with imud keys init \S+"):
        keys.add(tmp_path, "viewer", "anna")
    with pytest.raises(ImudError, match="can't read"):
        network.read_credentials(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("endpoint", "is_local"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tcp/127.8.9.1:7447", True),
        ("tcp/localhost:7447", True),
        ("tcp/[::1]:7447", True),
        ("unixsock-stream//tmp/imud.sock", True),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/192.168.1.4:7447", False),
        ("udp/127.0.0.1:7447?iface=eth0", True),
        ("tls/probes.example.org:7447", False),
        ("tcp/localhost.example.org:7447", False),
        ("tcp/127.0.0.1.example.org:7447", False),
        ("", False),
    ],
)
def test_what_others_can_reach_is_known(endpoint: str, is_local: bool) -> None:
    assert endpoints.is_local(endpoint) is is_local


@pytest.mark.parametrize(
    ("typed", "endpoint", "address"),
    [
        ("::1", "tcp/[::1]:7447", "[::1]:8735"),
        ("tls/::1:80", "tls/[::1:80]:7447", "[::1:80]:8735"),
        ("tcp/::1:8735", "tcp/[::1]:8735", "[::1]:8735"),
        ("tcp/[fe80::1%eth0", "tcp/[fe80::1%eth0]:7447", "[fe80::1%eth0]:8735"),
        (
            "1:2:3:4:5:6:7:8000",
            "tcp/[1:2:3:4:5:6:7:8000]:7447",
            "[1:2:3:4:5:6:7:8000]:8735",
        ),
        ("tcp/h:99999", "tcp/h:7447", "h:8735"),
        ("http://h:80/a", "tcp/h:80", "h:80"),
        (":80", "tcp/127.0.0.1:80", "127.0.0.1:80"),
        ("", "tcp/127.0.0.1:7447", "127.0.0.1:8735"),
        ("tls/h:1#iface=lo", "", "h:1"),
        ("unixsock-stream//tmp/a", "", "tmp:8735"),
        ("[::]:0", "tcp/[::]:0", ""),
    ],
)
def test_what_is_no_address_is_told_with_the_one_that_was_meant(
    typed: str, endpoint: str, address: str
) -> None:
    for meant, example in ((endpoint, ENDPOINT), (address, PAGE)):
        told = endpoints.misspelt(typed, example)
        assert told.rpartition(": try ")[2] == meant
        assert endpoints.misspelt(meant or typed, example) == ""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('listen = ["tcp/0.0.0.0:7447"]', "require keys: imud keys init DIR"),
        ('listen = ["tls/0.0.0.0:7447"]', "open_to_all = true"),
        (
            'listen = ["tcp/127.0.0.1:1", "tcp/[::]:1"]',
            "tcp/\\[::\\]:1 is open to everybody",
        ),
        ('keys = "keys"', "with keys it is tls/127.0.0.1:7447"),
        ('mode = "client"', "connect: is empty; a client needs one"),
        ('mode = "peer"', "connect: is empty; a peer needs one"),
    ],
)
def test_a_door_left_open_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "imud.toml"
    path.write_text(f"[zenoh]\n{text}\n", "utf-8")
    with pytest.raises(ConfigError, match=words):
        load(path)


@pytest.mark.parametrize(
    "text",
    [
        'listen = ["tcp/0.0.0.0:7447"]\nopen_to_all = true',
        'listen = ["tls/0.0.0.0:7447"]\nkeys = "keys"',
        'mode = "client"\nconnect = ["tcp/192.0.2.1:7447"]',
        'mode = "peer"\nlisten = ["tcp/127.0.0.1:7448"]',
    ],
)
def test_a_door_that_is_meant_to_be_open_is(tmp_path: Path, text: str) -> None:
    path = tmp_path / "imud.toml"
    path.write_text(f"[zenoh]\n{text}\n", "utf-8")
    settings = tomllib.loads(text)
    held = load(path).zenoh
    for name, value in settings.items():
        kept = getattr(held, name)
        assert (list(kept) if isinstance(kept, tuple) else kept) == value


def test_no_role_may_put_but_another_daemon() -> None:
    users = {role: role for role in access.ROLES}
    made = access.rules(users, "imud", has_certificates=False)
    for rule in made["rules"]:
        if "ingress" in rule["flows"] and not rule["id"].startswith("daemon"):
            assert set(rule["messages"]) <= {
                "declare_subscriber",
                "query",
                "declare_liveliness_subscriber",
                "liveliness_query",
            }


def test_the_daemon_is_a_user_of_its_own_network_and_shows_that_to_no_other(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "keys"
    keys.initialise(folder, [], 7447)
    settings = ZenohSettings(listen=("tls/127.0.0.1:7447",), keys=str(folder))
    mine = network.own_credentials(settings, is_abroad=False)
    assert (mine.user, mine.role) == ("imud", "daemon")
    assert network.own_credentials(settings, is_abroad=True) is None
    assert network.own_credentials(ZenohSettings(), is_abroad=False) is None
    keys.remove(folder, "imud")
    with pytest.raises(ConfigError, match=r"imud keys add \S+ daemon imud"):
        network.own_credentials(settings, is_abroad=False)
    # Of a network in which it is a guest it has what that gave it.
    path = folder / "clients/recorder.toml"
    abroad = ZenohSettings(mode="client", connect=("tls/hub:1",), credentials=str(path))
    given = network.own_credentials(abroad, is_abroad=True)
    assert given.user == "recorder"


def test_roles_read_and_command_what_they_are_for() -> None:
    assert access.who_may("pose") == ["viewer", "operator", "recorder", "daemon"]
    assert access.who_may("body") == access.who_may("pose")
    assert access.who_may("raw") == ["operator", "recorder", "daemon"]
    assert access.who_may("frame") == ["recorder", "daemon"]
    assert access.who_may(access.COMMAND) == ["operator", "daemon"]


def test_a_renewed_certificate_has_the_same_names_and_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "keys"
    keys.initialise(folder, ["probes.example.org", "192.0.2.7"], 7447)
    path = folder / "server.pem"
    old = x509.load_pem_x509_certificate(path.read_bytes())
    assert cli.main(["keys", "renew", str(folder)]) == 0
    assert "valid until 20" in capsys.readouterr().out
    fresh = x509.load_pem_x509_certificate(path.read_bytes())
    assert fresh.serial_number != old.serial_number
    assert fresh.public_key() == old.public_key()
    names = x509.SubjectAlternativeName
    assert (
        fresh.extensions.get_extension_for_class(names).value
        == old.extensions.get_extension_for_class(names).value
    )
    assert cli.main(["keys", "renew", str(tmp_path)]) == 1
    path.write_text("no certificate")
    assert cli.main(["keys", "renew", str(folder)]) == 1
    assert "not created by imud keys init" in capsys.readouterr().err


def test_no_certificate_outlives_its_authority(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keys, "AFTER", timedelta(minutes=-1))
    keys.initialise(tmp_path / "keys", [], 7447)
    with pytest.raises(FileError, match=r"authority \S+ expired on .* imud keys init"):
        keys.renew(tmp_path / "keys")


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("server.key", "no key", "are not a certificate and its key"),
        ("server.pem", "no certificate", "are not a certificate and its key"),
        ("ca.pem", "no certificate", "the authority, .* can't be read"),
        ("server.key", None, "is not the key of"),
        ("roles.toml", "viewer = 'king'", "each line must be NAME = ROLE"),
    ],
)
def test_keys_with_which_no_daemon_can_serve_are_refused(
    tmp_path: Path, file: str, text: str | None, words: str
) -> None:
    """Zenoh would say that the address is taken."""
    folder = tmp_path / "keys"
    keys.initialise(folder, [], 7447)
    other = (folder / "ca.key").read_text("utf-8")
    (folder / file).write_text(other if text is None else text, "utf-8")
    with pytest.raises(ConfigError, match=words):
        network.read_keys(Config(zenoh=ZenohSettings(keys=str(folder))))
