# SPDX-License-Identifier: MIT
"""Who may do what on the network: roles, and Zenoh's access rules that hold them to it.

What no rule allows is refused. Zenoh refuses it without a word, to either side.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from imud.ros2 import topics

Role = Literal["viewer", "operator", "recorder", "daemon"]

ROLES: dict[Role, str] = {
    "viewer": "pose and status",
    "operator": "pose and status; commands",
    "recorder": "pose, status, event, raw, frame, twin, clock and log",
    "daemon": "another imud, which publishes into the network of this one",
}

Rule = dict[str, Any]

# Last parts of keys that a role may read.
READS: dict[Role, tuple[str, ...]] = {
    "viewer": ("pose", "status"),
    "operator": ("pose", "status"),
    "recorder": (
        "pose",
        "status",
        "event",
        "raw",
        "frame",
        "twin",
        "clock",
        "log",
    ),
}

# Topics of ROS 2 by type, in any domain and namespace: what says no more than a pose
# and a status do, and what carries samples.
ROS2_OF_POSE = (topics.POSE_STAMPED, topics.TF_MESSAGE, topics.DIAGNOSTIC_ARRAY)
ROS2_OF_RAW = (topics.IMU, topics.MAGNETIC_FIELD)
ROS2_READS: dict[Role, tuple[topics.Type, ...]] = {
    "viewer": ROS2_OF_POSE,
    "operator": ROS2_OF_POSE,
    "recorder": (*ROS2_OF_POSE, *ROS2_OF_RAW),
}
ROS2_TOKENS = "@ros2_lv/**"
COMMANDS: tuple[Role, ...] = ("operator",)

COMMAND = "command"

# Below the key of what is published: its history, as Zenoh's extension keeps it.
HISTORY = "@adv/**"


def who_may(do: str) -> list[Role]:
    """Roles that may command, or read that topic."""
    if do == COMMAND:
        return [*COMMANDS, "daemon"]
    return [*(role for role, topics in READS.items() if do in topics), "daemon"]


def rules(
    users: Mapping[str, Role], prefix: str, *, has_certificates: bool
) -> dict[str, Any]:
    """Zenoh's `access_control` for these users. With certificates, each one's own has
    to come with its password.
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
    # Zenoh takes no empty lists: with no user there is nothing to allow.
    parts = {"rules": [*made.values()], "subjects": known, "policies": policies}
    filled = {name: part for name, part in parts.items() if part}
    return {"enabled": True, "default_permission": "deny", **filled}


def _rules_of(role: Role, prefix: str) -> list[Rule]:
    """Ingress is what comes from the user, egress what goes to it."""
    if role == "daemon":
        everything = ["**", ROS2_TOKENS, f"{prefix}/*/pose/{HISTORY}"]
        return [
            _rule(role, flow, "all", _MESSAGES, everything)
            for flow in ("ingress", "egress")
        ]
    read = [f"{prefix}/*/{topic}" for topic in READS[role]]
    asked = [f"{prefix}/*/status", f"{prefix}/*/pose/{HISTORY}"]
    replies = [*asked, f"{prefix}/*/pose"]  # what a history replies has its own key
    read += [f"*/**/{kind.dds}/*" for kind in ROS2_READS[role]]
    alive = [f"{prefix}/*/alive", ROS2_TOKENS]
    if role in COMMANDS:
        asked.append(f"{prefix}/*/cmd/*")
        replies.append(f"{prefix}/*/cmd/*")
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
