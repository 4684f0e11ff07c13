# SPDX-License-Identifier: MIT
"""Users of the page and their permissions: everybody without keys, otherwise the users
of `imud keys` with their passwords, each by its role.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from typing import Protocol

import msgspec

from imud.commands import COMMANDS
from imud.net import access
from imud.roles import Role
from imud.web.feed import BODY, CALIBRATION, EVENTS, LATEST, STREAMS, UPDATE

LEND = "lend"  # the command that an update of the firmware needs
TOPICS = LATEST | STREAMS | EVENTS


class Grant(msgspec.Struct, frozen=True):
    """What a user may do on the page."""

    role: str
    reads: frozenset[str]  # topics
    commands: frozenset[str]
    logs: bool  # download them

    @property
    def may_update(self) -> bool:
        """Write new firmware into probes."""
        return LEND in self.commands

    def may_send(self, command: str) -> bool:
        """Whether it may send this command. The daemon refuses unknown ones."""
        is_known = command in COMMANDS
        return command in self.commands if is_known else bool(self.commands)


NOTHING = Grant("", frozenset(), commands=frozenset(), logs=False)
EVERYTHING = Grant("everybody", TOPICS, commands=frozenset(COMMANDS), logs=True)


def grant_of(role: Role) -> Grant:
    """The rights of a role on the network, which it has on the page as well."""
    # A calibration is made of raw samples, a limb of poses; an update is a command's.
    as_topic = {CALIBRATION: "raw", BODY: "pose", UPDATE: access.CMD + LEND}
    reads = frozenset(
        topic for topic in TOPICS if role in access.who_may(as_topic.get(topic, topic))
    )
    return Grant(
        role,
        reads,
        commands=frozenset(
            name for name in COMMANDS if role in access.who_may(access.CMD + name)
        ),
        logs=role in access.who_may("frame"),  # which logs consist of
    )


class Users(Protocol):
    """Decides what a browser may do."""

    def at_first(self) -> Grant:
        """Before it has said anything."""

    def log_in(self, user: str, secret: str) -> Grant | None:
        """With a name and a password or token; None: refused."""


class Everybody:
    """Without keys: everybody who reaches the page may do everything."""

    def at_first(self) -> Grant:
        return EVERYTHING

    def log_in(self, user: str, secret: str) -> Grant | None:  # noqa: ARG002 - no users
        return EVERYTHING


class KeyUsers:
    """The users of `imud keys`."""

    def __init__(self, roles: Mapping[str, Role], passwords: Mapping[str, str]) -> None:
        self._roles, self._passwords = roles, passwords

    def at_first(self) -> Grant:
        return NOTHING

    def log_in(self, user: str, secret: str) -> Grant | None:
        known = self._passwords.get(user, "")
        is_right = secrets.compare_digest(known.encode(), secret.encode())
        role = self._roles.get(user)
        return grant_of(role) if known and is_right and role is not None else None


class TokenHolder:
    """One role for who has the token that `imud view` puts into the address."""

    def __init__(self, role: Role) -> None:
        self._role = role
        self.token = secrets.token_urlsafe(24)

    def at_first(self) -> Grant:
        return NOTHING

    def log_in(self, user: str, secret: str) -> Grant | None:  # noqa: ARG002 - no users
        is_right = secrets.compare_digest(self.token.encode(), secret.encode())
        return grant_of(self._role) if is_right else None
