# SPDX-License-Identifier: MIT
"""Orders that change the params of a virtual probe, and what it says about them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from imud.wire.params import ParamsParts, digest_of, words_of
from system.virtual import Run, send

Order = tuple[str, int, int]

# Between two words: the Nano's memory takes 3.4 ms a byte, and waits while a sample is
# much work.
WORD_US = 60_000
# Between two requests to apply: each part is checked in a step of its own, and then the
# memory takes the eight bytes that switch.
APPLY_US = 300_000


def words(records: bytes) -> list[Order]:
    """The orders that stage these records."""
    return [("params_write", at, word) for at, word in words_of(records)]


def apply(records: bytes) -> Order:
    digest = digest_of(records)
    return "params_apply", len(records), digest - (digest >> 31 << 32)


def frame(order: Order, number: int) -> str:
    """An order for --send; its token is `number` and a hundred."""
    return send(*order, token=100 + number)


def upload(records: bytes, begin_us: int) -> list[str]:
    """Options that stage these records and ask for them: the second answer tells how
    it went.
    """
    staged = [frame(order, number) for number, order in enumerate(words(records))]
    asked = [frame(apply(records), len(staged) + number) for number in range(2)]
    ask_us = begin_us + len(staged) * WORD_US
    return timed(staged, begin_us) + timed(asked, ask_us, APPLY_US)


def timed(frames: Sequence[str], begin_us: int, step_us: int = WORD_US) -> list[str]:
    """Options that send these one after the other."""
    return [
        word
        for number, each in enumerate(frames)
        for word in ("--send", f"{begin_us + number * step_us}:{each}")
    ]


def answers(done: Run, command: str = "params_apply") -> list[tuple[Any, Any]]:
    """Result and value of each reply to that command."""
    return [
        (reply.fields["result"], reply.fields["value"])
        for reply in done.named("reply")
        if reply.fields["replied_command"] == command
    ]


def in_force(done: Run) -> list[bytes]:
    """The records in force after each boot, then at the end: of the digests that hellos
    tell, whole as they were told in the same run.
    """
    parts = ParamsParts()
    for message in done.named("params"):
        parts.add_part(message)
    hellos = done.named("hello")
    told = [
        hello
        for number, hello in enumerate(hellos)
        if number == 0
        or hello.fields["boot_count"] != hellos[number - 1].fields["boot_count"]
    ]
    found = []
    for hello in [*told, hellos[-1]]:
        digest = hello.fields["params_digest"]
        assert isinstance(digest, int)
        records = parts.get(digest)
        assert records is not None, f"params {digest:08x} were not told whole"
        found.append(records)
    return found
