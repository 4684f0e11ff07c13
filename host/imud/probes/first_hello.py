# SPDX-License-Identifier: MIT
"""The probe of a file: its first hello and the params of that, known before the
messages ahead of them are read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from imud.defaults import PROBES_MAX
from imud.probes.session import Probe
from imud.wire import kept, messages
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message
from imud.wire.params import ParamsParts

# Id of the probe in a capture without a hello.
NOBODY = "unknown"


# Represents all probes beyond PROBES_MAX.
OTHERS = "others"


@dataclass(frozen=True, slots=True)
class FirstHello:
    """The first hello of a kept schema, and the params that were told up to then."""

    hello: Message
    content: bytes
    parts: ParamsParts


def first_hello(chunks: Iterable[bytes]) -> FirstHello | None:
    """The first hello in these bytes, with its params; None: there is none."""
    decoder = FrameDecoder()
    parts = ParamsParts()
    found: FirstHello | None = None
    for data in chunks:
        for content in decoder.feed(data):
            decoded = messages.decode(content)
            if not isinstance(decoded, Message):
                continue
            if decoded.name == "params":
                parts.add_part(decoded)
            elif found is None and _is_kept(decoded):
                found = FirstHello(decoded, content, parts)
        if found is not None and parts.get(_digest(found.hello)) is not None:
            break
    return found


def probe_in_file(known: FirstHello | None, name: Callable[[str], Probe]) -> Probe:
    """The probe of a file, known before its first hello is reached."""
    probe_id = known.hello.fields["probe_id"] if known is not None else None
    probe = name(probe_id.hex() if isinstance(probe_id, bytes) else NOBODY)
    if known is not None:
        records = known.parts.get(_digest(known.hello))
        if records is not None:
            probe.add_params(records)
        probe.update(known.hello, known.content)
    return probe


def probe_of(probes: dict[str, Probe], probe_id: str) -> Probe:
    """The probe of a file with that id, added to `probes`; beyond PROBES_MAX one that
    represents all: that many ids are invented.
    """
    if probe_id not in probes and len(probes) >= PROBES_MAX:
        probe_id = OTHERS
    if probe_id not in probes:
        probes[probe_id] = Probe(probe_id)
    return probes[probe_id]


def _is_kept(decoded: Message) -> bool:
    fingerprint = decoded.fields.get("schema_fingerprint")
    return decoded.name == "hello" and kept.find(fingerprint) is not None


def _digest(hello: Message) -> int:
    digest = hello.fields["params_digest"]
    return digest if isinstance(digest, int) else 0
