# SPDX-License-Identifier: MIT
"""The hashes of ROS 2's message types: host/imud/ros2/hashes.py."""

from __future__ import annotations

from imud.ros2.topics import TYPES

HEAD = '''\
# SPDX-License-Identifier: MIT
"""Made by protocol/generate.py from the definitions that rosbags has: do not edit. The
types of ROS 2 that are published, by name, with their hashes of REP 2011.
"""

RIHS01 = {
'''


def module() -> str:
    """The text of the module. The hashes are the same since Iron."""
    # Not needed for the C library, which is made where a release is.
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    rows = (
        f'    "{kind.name}": (\n        "{store.hash_rihs01(kind.name)}"\n    ),\n'
        for kind in TYPES
    )
    return f"{HEAD}{''.join(rows)}}}\n"
