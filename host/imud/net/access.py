# SPDX-License-Identifier: MIT
"""Roles on the network, and Zenoh's access rules that enforce them.

What no rule allows is denied. Zenoh sends no reply to a denied request.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from imud.commands import COMMANDS
from imud.endpoint import NAME
from imud.errors import ProbeUnknown
from imud.roles import Role
from imud.ros2 import topics

Rule = dict[str, Any]

# The last parts of the keys that a role may read.
_OF_VIEWER = ("pose", "aim", "stroke", "path", "mark", "marks", "status", "params")
# To calibrate a probe takes its samples and events.
_OF_OPERATOR = (*_OF_VIEWER, "event", "command", "raw")
READS: dict[Role, tuple[str, ...]] = {
    "viewer": _OF_VIEWER,
    "operator": _OF_OPERATOR,
    "recorder": (*_OF_OPERATOR, "frame", "twin", "learn", "clock", "log"),
}
# In words.
ROLES: dict[Role, str] = {
    role: f"{', '.join(topics[:-1])} and {topics[-1]}" for role, topics in READS.items()
}
ROLES["operator"] += "; commands"
ROLES["daemon"] = "another imud, which publishes into this network"

# Types of ROS 2 topics, in any domain and namespace: those that tell no more than pose
# and status, and those with samples.
ROS2_OF_POSE = (
    topics.POSE_STAMPED,
    topics.POINT_STAMPED,
    topics.PATH,
    topics.TF_MESSAGE,
    topics.DIAGNOSTIC_ARRAY,
    topics.JOINT_STATE,
)
ROS2_OF_RAW = (topics.IMU, topics.MAGNETIC_FIELD)
ROS2_READS: dict[Role, tuple[topics.Type, ...]] = {
    "viewer": ROS2_OF_POSE,
    "operator": ROS2_OF_POSE,
    "recorder": (*ROS2_OF_POSE, *ROS2_OF_RAW),
}
ROS2_TOKENS = "@ros2_lv/**"

COMMAND = "command"  # any command at all
CMD = "cmd/"  # before the name of one

# Keys of bodies, PREFIX/BODIES/NAME/BODY_STATE: every role may read them.
BODIES, BODY_STATE = "body", "state"

# A publisher's history, below its key, as Zenoh's extension keeps it.
HISTORY = "@adv/**"

# A probe's keys also exist by its id, which it has under every name. `*` and `**` don't
# match them, so that nobody gets a message twice.
BY_ID = "@id"
_ID = re.compile(r"[0-9a-f]{16}")


def is_id(text: str) -> bool:
    """Whether it is the id of a probe, which no name can be."""
    return _ID.fullmatch(text) is not None


def address(probe: str | None) -> str:
    """The part of a key for the probe of a name or an id; None: every probe.
    ProbeUnknown for what can be neither, as a pattern.
    """
    if probe is None:
        return "*"
    if not NAME.fullmatch(probe):
        raise ProbeUnknown(
            f"no probe is called {probe[:80]!r}; choose one of imud list"
        )
    return f"{BY_ID}/{probe}" if is_id(probe) else probe


def who_may(do: str) -> list[Role]:
    """The roles that may send commands (COMMAND), send that one (cmd/NAME), or read
    that topic; BODIES, every role. An unknown command takes the role of some command,
    to be told so.
    """
    if do == COMMAND or do.startswith(CMD):
        row = COMMANDS.get(do.removeprefix(CMD))
        rows = COMMANDS.values() if row is None else [row]
        return [
            *(role for role in READS if any(role in r.roles for r in rows)),
            "daemon",
        ]
    readers = (role for role, topics in READS.items() if do in (*topics, BODIES))
    return [*readers, "daemon"]


def _commands_of(role: Role) -> list[str]:
    """The ends of the keys by which a role may command."""
    names = [row.name for row in COMMANDS.values() if role in row.roles]
    if len(names) == len(COMMANDS):
        return [f"{CMD}*"]
    return [f"{CMD}{name}" for name in names]


def rules(
    users: Mapping[str, Role], prefix: str, *, has_certificates: bool
) -> dict[str, Any]:
    """Zenoh's `access_control` for these users. With certificates, each user needs its
    own certificate beside its password.
    """
    made: dict[str, Rule] = {}
    policies = []
    for role in sorted(set(users.values())):
        own = _rules_of(role, prefix)
        made |= {rule["id"]: rule for rule in own}
        subjects = [f"user {name}" for name in sorted(users) if users[name] == role]
        policies.append({"rules": [rule["id"] for rule in own], "subjects": subjects})
    known = [
        {"id": f"user {name}", "usernames": [name]}
        | ({"cert_common_names": [name]} if has_certificates else {})
        for name in sorted(users)
    ]
    # Zenoh accepts no empty lists. Without users nothing is allowed.
    parts = {"rules": [*made.values()], "subjects": known, "policies": policies}
    filled = {name: part for name, part in parts.items() if part}
    return {"enabled": True, "default_permission": "deny", **filled}


def _rules_of(role: Role, prefix: str) -> list[Rule]:
    """The rules of a role. Ingress comes from the user, egress goes to the user."""
    if role == "daemon":
        everything = ["**", ROS2_TOKENS]
        everything += _keys(prefix, "**", f"pose/{HISTORY}")
        return [
            _rule(role, flow, "all", _MESSAGES, everything)
            for flow in ("ingress", "egress")
        ]
    read = _keys(prefix, *READS[role])
    read.append(f"{prefix}/{BODIES}/*/{BODY_STATE}")
    asked = _keys(prefix, "status", "params", f"pose/{HISTORY}")
    replies = [*asked, *_keys(prefix, "pose")]  # the history replies on the pose's key
    read += [f"*/**/{kind.dds}/*" for kind in ROS2_READS[role]]
    alive = [*_keys(prefix, "alive"), ROS2_TOKENS]
    commands = _keys(prefix, *_commands_of(role))
    asked += commands
    replies += commands
    watch = ["declare_liveliness_subscriber", "liveliness_query"]
    return [
        _rule(role, "ingress", "subscribe", ["declare_subscriber"], read),
        _rule(role, "egress", "read", ["put", "delete"], read),
        _rule(role, "ingress", "ask", ["query"], asked),
        _rule(role, "egress", "answer", ["declare_queryable", "reply"], replies),
        _rule(role, "ingress", "watch", watch, alive),
        _rule(role, "egress", "alive", ["liveliness_token", "reply"], alive),
    ]


_MESSAGES = [
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
]


def _keys(prefix: str, *ends: str) -> list[str]:
    """The keys with these ends, of every probe by its name and by its id."""
    return [f"{prefix}/{of}/{end}" for of in ("*", f"{BY_ID}/*") for end in ends]


def _rule(
    role: Role, flow: str, what: str, messages: list[str], keys: list[str]
) -> Rule:
    return {
        "id": f"{role} {flow} {what}",
        "permission": "allow",
        "flows": [flow],
        "messages": messages,
        "key_exprs": keys,
    }
