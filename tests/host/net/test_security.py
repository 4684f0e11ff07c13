# SPDX-License-Identifier: MIT
"""The permissions of each role: real sessions with a daemon that has keys.

A put or a query that no rule allows is dropped, and its sender gets no reply. So the
tests assert that nothing came of it, and that the daemon wrote a line.
"""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import pytest
import zenoh
import zenoh.ext

import imud
from guarded import PROBE, WHILE_S, Guarded, received_on
from imud import cli
from imud.client import Client, client
from imud.errors import NoReply, NotAllowed
from imud.net import network
from imud.roles import Role
from imud.ros2 import topics
from imud.ros2.topics import Topic
from streaming import Streaming

EVERYTHING = (
    "**",
    "imud/**",
    f"imud/{PROBE}/**",
    f"imud/{PROBE}/*",
    "imud/*/*",
    "imud/*/*/@adv/**",
    "@ros2_lv/**",
    "@/**",
    "*/**",
)


@pytest.mark.parametrize(
    ("user", "may"),
    [
        ("viewer", ("pose", "status")),
        ("operator", ("pose", "status", "raw", "event")),
    ],
)
def test_who_subscribes_to_everything_hears_no_more_than_its_own(
    guarded: Guarded, user: Role, may: tuple[str, ...]
) -> None:
    topics = ("pose", "status", "raw", "frame", "event", "twin")
    named = [f"imud/*/{topic}" for topic in topics]
    own = {f"imud/{PROBE}/{topic}" for topic in may}
    with guarded.session(user) as session:
        count = received_on(session, *EVERYTHING, *named, wanted=own)
    assert count.keys() == own
    guarded.daemon.seen()
    with guarded.session(user) as session:
        assert not received_on(session, *EVERYTHING)
    guarded.expect_denied()


def test_a_recorder_hears_what_there_is(guarded: Guarded) -> None:
    topics = ("pose", "status", "raw", "frame", "event")
    there = {f"imud/{PROBE}/{topic}" for topic in topics}
    with guarded.session("recorder") as session:
        keys = (f"imud/*/{topic}" for topic in topics)
        assert received_on(session, *keys, wanted=there).keys() == there


def test_an_operator_commands(guarded: Guarded) -> None:
    before = len(guarded.probe.commands)
    path = keys_of(guarded, "operator")
    port, probe = guarded.port, guarded.probe
    with Streaming(port, probe, say=lambda: port.answers(probe)):
        with Client(guarded.endpoint, keys=path) as operator:
            reply = operator.command(PROBE, "tare")
        assert reply["ok"]
        where = ["--connect", guarded.endpoint, "--keys", str(path)]
        assert cli.main(["restart", PROBE, *where]) == 0
    commands = [c["command"] for c in guarded.probe.commands[before:]]
    assert commands == ["tare", "restart"]


def keys_of(guarded: Guarded, user: str) -> Path:
    return guarded.keys / "clients" / f"{user}.toml"


@pytest.mark.parametrize("user", ["viewer", "recorder"])
def test_a_viewer_that_commands_is_not_heard(
    guarded: Guarded, user: Role, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client, "COMMAND_TIMEOUT_S", 1.0)  # denied: no answer
    before = len(guarded.probe.commands)
    path = keys_of(guarded, user)
    with Client(guarded.endpoint, keys=path) as mine:
        assert mine.alive() == [PROBE]
        with pytest.raises(NotAllowed, match=f"may not command, as a {user}"):
            mine.command(PROBE, "tare")
    # A client that claims the keys of an operator gets no further.
    forged = tmp_path / "forged.toml"
    credentials = network.read_credentials(path)
    forged.write_text(
        path.read_text("utf-8").replace(f'role = "{user}"', 'role = "operator"')
    )
    assert network.read_credentials(forged).password == credentials.password
    with Client(guarded.endpoint, keys=forged) as mine:
        guarded.daemon.seen()
        with pytest.raises(NoReply, match="your keys no longer allow commands"):
            mine.command(PROBE, "tare")
        guarded.expect_denied()
        # The last is Zenoh's own configuration.
        for wide in (
            "imud/*/cmd/tare",
            "imud/**",
            f"imud/{PROBE}/cmd/**",
            "**",
            f"imud/{PROBE}/raw/@adv/**",
            "@/**",
        ):
            guarded.daemon.seen()
            replies = mine.session.get(wide, timeout=WHILE_S)
            told = [str(reply.ok.key_expr) for reply in replies if reply.ok]
            own = f"@/{mine.session.zid()}/"
            assert not [key for key in told if not key.startswith(own)]
            guarded.expect_denied()
    assert len(guarded.probe.commands) == before


def test_a_viewer_has_the_last_status_the_history_and_who_is_alive(
    guarded: Guarded,
) -> None:
    guarded.daemon.seen()
    with Client(guarded.endpoint, keys=keys_of(guarded, "viewer")) as viewer:
        assert [status["probe"] for status in viewer.statuses()] == [PROBE]
        assert viewer.alive() == [PROBE]
        numbers: list[int] = []
        undeclare = viewer.listen(
            "pose",
            None,
            lambda each: numbers.append(json.loads(each.payload)["number"]),
            history=20,
        )
        time.sleep(WHILE_S)  # history and live poses come
        undeclare()
    # 100 a second come live: those before the first of these are of the history.
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert len(numbers) > 20
    # Nothing that it asks for in the course of it is refused.
    assert not [line for line in guarded.daemon.seen() if "does not allow" in line]


def test_params_are_read_as_the_status_and_changed_as_commands_are(
    guarded: Guarded, capsys: pytest.CaptureFixture[str]
) -> None:
    guarded.daemon.seen()
    where = ["--connect", guarded.endpoint, "--keys", str(keys_of(guarded, "viewer"))]
    for words in (["show"], ["history"]):
        assert cli.main(["params", *words, PROBE, *where]) == 0
    assert not [line for line in guarded.daemon.seen() if "does not allow" in line]
    before = len(guarded.probe.commands)
    with Client(guarded.endpoint, keys=keys_of(guarded, "viewer")) as viewer:
        with pytest.raises(NotAllowed, match="may not command, as a viewer"):
            viewer.change_params(PROBE, b"\x05\x02\1\0")
        # A client that sends it anyway gets no reply.
        query = f"imud/{PROBE}/cmd/params?records=05020100"
        assert not list(viewer.session.get(query, timeout=WHILE_S))
        guarded.expect_denied()
        put = viewer.session.declare_publisher(f"imud/{PROBE}/params")
        put.put(b"{}")
        guarded.expect_denied()
    assert len(guarded.probe.commands) == before
    capsys.readouterr()


def test_each_command_takes_keys(
    guarded: Guarded, capsys: pytest.CaptureFixture[str]
) -> None:
    viewer = str(keys_of(guarded, "viewer"))
    where = ["--connect", guarded.endpoint, "--keys", viewer]
    assert cli.main(["list", *where]) == 0
    assert PROBE in capsys.readouterr().out
    assert cli.main(["listen", "--json", "--seconds", "1", *where]) == 0
    first = json.loads(capsys.readouterr().out.partition("\n")[0])
    assert (first["type"], first["probe"]) == ("pose", PROBE)
    assert cli.main(["monitor", "--seconds", "1", *where]) == 0
    assert PROBE in capsys.readouterr().out
    with imud.subscribe(endpoint=guarded.endpoint, keys=viewer, seconds=5) as poses:
        assert next(iter(poses)).probe == PROBE


@pytest.mark.parametrize("command", ["list", "listen", "monitor", "tare"])
def test_a_command_without_keys_or_with_others_is_one_line(
    guarded: Guarded, command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    guarded.welcome()
    wrong = tmp_path / "wrong.toml"
    text = keys_of(guarded, "operator").read_text("utf-8")
    wrong.write_text(re.sub('password = ".*"', 'password = "guess"', text), "utf-8")
    for given in ([], ["--keys", str(wrong)]):
        assert cli.main([command, "--connect", guarded.endpoint, *given]) == 1
        error = capsys.readouterr().err
        assert error.startswith("imud: no imud at tls/")
        assert error.count("\n") == 1
    guarded.daemon.expect("refused .*: .*Invalid password")


def test_what_a_role_may_not_is_said_on_one_line(
    guarded: Guarded, capsys: pytest.CaptureFixture[str]
) -> None:
    guarded.welcome()
    viewer = keys_of(guarded, "viewer")
    where = ["--connect", guarded.endpoint, "--keys", str(viewer)]
    assert cli.main(["tare", *where]) == 1
    error = capsys.readouterr().err
    assert error == (
        "imud: viewer may not command, as a viewer; create keys that "
        "may with imud keys add DIR operator NAME\n"
    )
    with pytest.raises(NotAllowed, match=r"read raw, as a viewer; .* operator NAME"):
        imud.subscribe(topics=("raw",), endpoint=guarded.endpoint, keys=viewer)


def test_ros_2_is_read_by_role(guarded: Guarded) -> None:
    names = topics.ros_name(PROBE)
    pose = Topic(f"/imud/{names}/pose", topics.POSE_STAMPED).key(0)
    imu = Topic(f"/imud/{names}/imu/data", topics.IMU).key(0)
    mag = Topic(f"/imud/{names}/imu/mag", topics.MAGNETIC_FIELD).key(0)
    tf = Topic("/tf", topics.TF_MESSAGE).key(0)
    diagnostics = Topic("/diagnostics", topics.DIAGNOSTIC_ARRAY).key(0)
    for user, expected in (
        ("recorder", {pose, imu, mag, tf, diagnostics}),
        ("viewer", {pose, tf, diagnostics}),
    ):
        with guarded.session(user) as session:
            tokens: list[str] = []
            while sum("/MP/" in token for token in tokens) < 7:  # since its first pose
                replies = session.liveliness().get("@ros2_lv/**", timeout=WHILE_S)
                tokens = [str(reply.ok.key_expr) for reply in replies if reply.ok]
            assert sum("/MP/" in token for token in tokens) == 7
            assert sum("/NN/" in token for token in tokens) == 1
            keys = (pose, imu, mag, tf, diagnostics, "0/**", "*/**")
            assert received_on(session, *keys, wanted=expected).keys() == expected


@pytest.mark.sampled(3)
@pytest.mark.parametrize("user", ["viewer", "operator", "recorder"])
def test_spoofed_puts_reach_nobody(guarded: Guarded, user: Role) -> None:
    forged: list[str] = []

    def look(sample: zenoh.Sample) -> None:
        if sample.payload.to_bytes() == b"forged":
            forged.append(str(sample.key_expr))

    topics = ("pose", "status", "raw", "frame", "event", "twin", "cmd/tare")
    with guarded.session("other-recorder") as other, guarded.session(user) as mine:
        held = [other.declare_subscriber(f"imud/*/{topic}", look) for topic in topics]
        guarded.daemon.seen()
        token = mine.liveliness().declare_token("imud/forged/alive")
        queryable = mine.declare_queryable(
            f"imud/{PROBE}/status", lambda query: query.reply(query.key_expr, b"forged")
        )
        until = time.monotonic() + WHILE_S
        while time.monotonic() < until:  # it tries for so long
            for topic in topics:
                mine.put(f"imud/{PROBE}/{topic}", b"forged")
                mine.put(f"imud/forged/{topic}", b"forged")
                mine.delete(f"imud/{PROBE}/{topic}")
            time.sleep(0.05)
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
    # At 20 rounds a second each of 18 was refused, and counted, one by one.
    denied = [line for line in guarded.daemon.seen() if "does not allow" in line]
    assert len(denied) > 18
