# SPDX-License-Identifier: MIT
"""Which probes compute their poses without the C of core/."""

from __future__ import annotations

from imud.wire.messages import Message


def is_in_floats(hello: Message) -> bool:
    """Whether that probe computes its poses in floats: it runs MicroPython, with its
    one filter, and a driver that, other than those of core/, makes no self-test.
    """
    fields = hello.fields
    has_driver = fields["who_am_i"] != (0, 0)
    is_plain = fields["board"] == "micropython" and has_driver
    return is_plain and fields["self_test"] == () and fields["filter"] == "madgwick"
