# SPDX-License-Identifier: MIT
"""The stream for programs: a WebSocket with the page's own messages."""

from __future__ import annotations

import contextlib
import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from fakes import PATIENCE_S
from imud.roles import Role
from imud.version import version
from imud.web.browser import WAITING_MAX
from imud.web.messages import BrowserMessage
from imud.web.server import STREAM_VERSION
from imud.web.users import TOPICS, TokenHolder, grant_of
from imud.wire import schema
from web.served import WRONG, Served


@contextlib.contextmanager
def stream(served: Served, origin: str | None = None) -> Iterator[ClientConnection]:
    url = f"ws://{served.host}/stream"
    with connect(url, origin=origin, max_size=None) as connection:
        yield connection


def lines(connection: ClientConnection) -> Iterator[dict[str, Any]]:
    """Of each message, which is text; the program never reports what it has seen."""
    while True:
        data = connection.recv(PATIENCE_S)
        assert isinstance(data, str)
        yield from map(json.loads, data.split("\n"))


def of_type(connection: ClientConnection, kind: str) -> dict[str, Any]:
    return next(line for line in lines(connection) if line["type"] == kind)


def test_a_stream_begins_with_its_version_and_what_its_user_may_do(
    served: Served,
) -> None:
    with stream(served) as program:
        first, head, page = itertools.islice(lines(program), 3)
    assert first == {
        "type": "stream",
        "version": STREAM_VERSION,
        "imud": version(),
        "schema": f"{schema.FINGERPRINT:#010x}",
    }
    assert (head["type"], head["n"], head["left_out"]) == ("head", 1, 0)
    assert (page["type"], page["role"], page["commands"]) == ("page", "everybody", True)


def test_a_program_gets_every_pose_of_the_probe_that_it_watches(
    served: Served,
) -> None:
    count = 300
    with stream(served) as program:
        program.send(json.dumps({"do": "watch", "every": [["stylus", "pose"]]}))
        program.send(json.dumps({"do": "ask", "id": 1, "probe": "a", "command": "id"}))
        assert of_type(program, "answer")["id"] == 1  # so it watches
        for number in range(count):
            served.say(number)
        found = (line for line in lines(program) if line["type"] == "pose")
        assert [next(found)["number"] for _ in range(count)] == list(range(count))


def test_a_program_that_watches_an_id_gets_every_pose_under_every_name(
    served: Served,
) -> None:
    def tell(name: str, probe_id: str) -> None:
        status = {"type": "status", "probe": name, "probe_id": probe_id}
        served.page.publish([((name, "status"), json.dumps(status).encode())])

    own = "00112233445566aa"
    with stream(served) as program:
        watch = {"do": "watch", "every": [[own, "pose"]], "probe": own}
        program.send(json.dumps(watch))
        program.send(json.dumps({"do": "ask", "id": 1, "probe": "a", "command": "id"}))
        assert of_type(program, "answer")["id"] == 1  # so it watches
        found = (line for line in lines(program) if line["type"] == "pose")
        for turn, name in enumerate((own, "stylus", "arm")):
            served.page.forget()
            tell(name, own)
            tell("tip", "00112233445566ab")
            for number in range(100 * turn, 100 * turn + 100):
                served.say(number, probe=name)
            assert [next(found)["number"] for _ in range(100)] == [
                *range(100 * turn, 100 * turn + 100)
            ]


def test_a_program_that_does_not_read_misses_what_is_old_and_disturbs_nobody(
    served: Served,
) -> None:
    watch = json.dumps({"do": "watch", "every": [["stylus", "raw"]]})
    padding = "x" * 4000
    count = 20 * WAITING_MAX  # 32 MB: more than sockets hold
    with stream(served) as slow, served.live() as other:
        slow.send(watch)
        slow.send(json.dumps({"do": "ask", "id": 1, "probe": "a", "command": "id"}))
        of_type(slow, "answer")
        for number in range(count):
            record = {"type": "raw", "number": number, "more": padding}
            served.page.publish([(("stylus", "raw"), json.dumps(record).encode())])
            served.page.flush()
            if number % 100 == 0:
                served.say(number)
                while other.next("pose")["number"] != number:
                    pass
        last, left_out, numbers = 0, 0, []
        for line in lines(slow):
            if line["type"] == "head":
                left_out = line["left_out"]
            elif line["type"] == "raw":
                numbers.append(line["number"])
                last = line["number"]
            if last == count - 1:
                break
    assert left_out > 0
    assert numbers == sorted(numbers)
    assert len(numbers) + left_out == count


def test_a_program_that_reports_what_it_has_seen_is_sent_as_much_as_a_browser(
    served: Served,
) -> None:
    with stream(served) as program:
        of_type(program, "page")
        program.send(json.dumps({"do": "seen", "n": 1}))
        numbers = []
        with pytest.raises(TimeoutError):
            while True:
                data = program.recv(1.0)
                numbers.append(json.loads(str(data).split("\n")[0])["n"])
    assert numbers[-1] <= 1 + 16 + 2


OTHERS = ["http://evil.example", "null", "http://127.0.0.1.evil.example", "file://"]


@pytest.mark.parametrize("origin", OTHERS)
def test_a_page_of_another_site_gets_no_stream(served: Served, origin: str) -> None:
    with pytest.raises(InvalidStatus) as refused, stream(served, origin):
        pass
    assert refused.value.response.status_code == 403
    assert served.page.refused == {"origin": 1}


@pytest.mark.parametrize(
    "origin", ["http://localhost:3000", "https://127.0.0.1", "http://[::1]:5173"]
)
def test_a_page_of_this_machine_gets_the_stream(served: Served, origin: str) -> None:
    with stream(served, origin) as program:
        assert of_type(program, "stream")["version"] == STREAM_VERSION


def test_a_page_of_a_site_that_is_named_gets_the_stream() -> None:
    with Served(origins=["https://example.org", "null"]) as served:
        for origin in ("https://example.org", "null"):
            with stream(served, origin) as program:
                assert of_type(program, "page")["role"] == "everybody"
        for origin in ("http://example.org", "https://example.org:8443"):
            with pytest.raises(InvalidStatus), stream(served, origin):
                pass
        # The page's own socket stays the page's.
        with pytest.raises(InvalidStatus), served.live("https://example.org"):
            pass


def test_another_name_for_this_machine_is_refused(served: Served) -> None:
    assert served.get("/stream", Host="evil.example").status == 421
    assert served.get("/stream").status == 426


@pytest.mark.parametrize("role", ["viewer", "recorder", "operator"])
def test_roles_are_those_of_the_page(role: Role) -> None:
    users = TokenHolder(role)
    with Served(users) as served, stream(served) as program:
        assert of_type(program, "page")["reads"] == []
        program.send(json.dumps({"do": "login", "user": "", "secret": WRONG}))
        assert of_type(program, "login")["error"] == "wrong user or password"
        program.send(json.dumps({"do": "login", "user": "", "secret": users.token}))
        page = of_type(program, "page")
        assert page["role"] == role
        assert page["reads"] == sorted(grant_of(role).reads)
        ask = {"do": "ask", "id": 1, "probe": "stylus", "command": "start"}
        program.send(json.dumps(ask))
        error = of_type(program, "answer")["error"]
        assert bool(error) == (role != "operator")


def test_what_is_no_message_ends_the_stream(served: Served) -> None:
    with stream(served) as program:
        program.send("{}")
        served.until_refused("malformed")


def test_the_document_names_every_message() -> None:
    text = (Path(__file__).parents[2] / "docs" / "subscribe.md").read_text("utf-8")
    for message in BrowserMessage.__args__:
        assert f'"do":"{message.__struct_config__.tag}"' in text, message
    for topic in ("stream", "head", "page", "answer", "login", *TOPICS):
        assert f"`{topic}`" in text, topic
    assert f'"version":{STREAM_VERSION}' in text
