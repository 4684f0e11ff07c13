# SPDX-License-Identifier: MIT
"""No command and no query is a fault, whatever its parameters."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import pytest
import zenoh
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from configured import bare_session, running
from fakes import DaemonProcess
from imud.daemon.commands import arguments_of
from imud.errors import CommandRefused
from imud.wire import messages
from length import examples


@pytest.fixture(scope="module")
def commanded(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[DaemonProcess, zenoh.Session]]:
    folder = tmp_path_factory.mktemp("fuzz")
    with running(folder, "[journal]\nburst = 100") as (daemon, _, _):
        with bare_session(daemon) as session:
            yield daemon, session
        daemon.stop()
        assert not [line for line in daemon.lines if "internal error" in line]
        assert not [line for line in daemon.lines if "Traceback" in line]


_WORDS = st.text(st.characters(exclude_characters="/*$#?", codec="utf-8"), min_size=1)
_NAMES = st.sampled_from(["stream", "hz", "what", "streams", "filter"]) | _WORDS

_NUMBERS = st.integers(-(2**70), 2**70).map(str) | st.just("9" * 5000)
_VALUES = st.sampled_from(["pose", "raw", "all", "undo", "fuse", "pose,raw", ""])
_PARAMETERS = st.dictionaries(_NAMES, _VALUES | _NUMBERS | st.text(max_size=20))
_COMMANDS = st.sampled_from(["rate", "fields", "tare", "restart", "start"])


@given(_COMMANDS, _PARAMETERS)
@example("rate", {"stream": "pose", "hz": str(2**40)})
@example("rate", {"stream": "pose", "hz": "-1"})
def test_no_parameters_are_a_fault(command: str, parameters: dict[str, str]) -> None:
    try:
        arguments = arguments_of(command, parameters)
    except CommandRefused as error:
        assert str(error)
        return
    fields = {"command": command, "token": 1, "arguments": arguments}
    # What no field holds is refused as the daemon refuses it.
    with contextlib.suppress(ValueError):
        messages.encode("command", fields, 1, 1)


@given(_COMMANDS | _WORDS, _PARAMETERS, st.binary(max_size=50))
@settings(
    max_examples=examples(60),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_no_query_is_a_fault(
    commanded: tuple[DaemonProcess, zenoh.Session],
    command: str,
    parameters: dict[str, str],
    payload: bytes,
) -> None:
    daemon, session = commanded
    # With a name that no command knows, so that the probe is not asked: it is silent.
    query = ";".join(
        f"{key}={value}" for key, value in (parameters | {"x1": ""}).items()
    )
    try:
        selector = zenoh.Selector(f"imud/00112233445566aa/cmd/{command}", query)
    except (zenoh.ZError, ValueError):
        return  # not a key: the library itself refuses it
    replies = list(session.get(selector, payload=payload, timeout=20.0))
    assert all(reply.err is not None for reply in replies)
    # cmd/* is no key that begins with @: Zenoh keeps those apart.
    assert len(replies) == (not command.startswith("@"))
    assert daemon.process.poll() is None
