# SPDX-License-Identifier: MIT
"""Whether a package of ours that is MIT needs one whose licence would make it another:
the GPL. The emulators are the one package that may.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import metadata

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

FREE = ("sim",)  # an extra with programs of its own, which are not linked
GPL = re.compile(r"\bA?GPL|GNU (Affero )?General Public", re.IGNORECASE)
LESSER = re.compile(r"\bLGPL|Lesser General Public", re.IGNORECASE)


def bound(package: str) -> Iterator[tuple[str, str]]:
    """Packages under the GPL that it needs, or what these need, and their licences.
    What is not installed here is not looked at.
    """
    offered = metadata.metadata(package).get_all("Provides-Extra") or ()
    waiting = [(package, frozenset(offered) - set(FREE))]
    seen: set[tuple[str, frozenset[str]]] = set()
    while waiting:
        name, extras = waiting.pop()
        key = canonicalize_name(name), extras
        if key in seen:
            continue
        seen.add(key)
        try:
            about = metadata.metadata(name)
        except metadata.PackageNotFoundError:
            continue  # of another system, or an extra that is not installed
        words = licence(about)
        if GPL.search(LESSER.sub("", words)):
            yield name, words
        for need in map(Requirement, metadata.requires(name) or ()):
            chosen = [{"extra": each} for each in ("", *extras)]
            if need.marker is None or any(map(need.marker.evaluate, chosen)):
                waiting.append((need.name, frozenset(need.extras)))


def licence(about: metadata.PackageMetadata) -> str:
    """A package's statement of its licence, on one line: in its metadata there are
    three places. Long ones are texts, whose first lines say it.
    """
    told = [*(about.get_all("License-Expression") or [])]
    told += [
        each
        for each in about.get_all("Classifier") or []
        if each.startswith("License ::")
    ]
    if not any(told):
        told += [each[:200] for each in about.get_all("License") or []]
    return "; ".join(" ".join(each.split()) for each in told if each)
