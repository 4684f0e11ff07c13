# SPDX-License-Identifier: MIT
"""Whether a package of ours that is MIT needs one whose licence would make it another:
the GPL. The emulators are the one package that may.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from importlib import metadata

MIT = "imu-probe"
FREE = ("sim",)  # an extra with programs of its own, which are not linked
GPL = re.compile(r"\bA?GPL|GNU (Affero )?General Public", re.IGNORECASE)
LESSER = re.compile(r"\bLGPL|Lesser General Public", re.IGNORECASE)
_NEED = re.compile(r"([A-Za-z0-9._-]+)\s*(?:\[([^\]]*)\])?")
_EXTRA = re.compile(r"""extra\s*==\s*['"]([^'"]+)['"]""")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("package", nargs="?", default=MIT)
    found = [*bound(parser.parse_args().package)]
    for name, words in found:
        sys.stdout.write(f"{name}: {words}\n")
    if found:
        sys.stdout.write(f"{MIT} is MIT and must not depend on these\n")
    return 1 if found else 0


def bound(package: str) -> Iterator[tuple[str, str]]:
    """Packages under the GPL that it needs, or what these need, and their licences.
    What is not installed here is not looked at.
    """
    about = metadata.metadata(package)
    extras = set(about.get_all("Provides-Extra") or ()) - set(FREE)
    seen: set[str] = set()
    waiting = [(package, extras)]
    while waiting:
        name, extras = waiting.pop()
        key = f"{re.sub(r'[-_.]+', '-', name).lower()}{sorted(extras)}"
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
        waiting += needs(name, extras)


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


def needs(package: str, extras: set[str]) -> Iterator[tuple[str, set[str]]]:
    """What a package requires with these extras, and with which extras of that."""
    for line in metadata.requires(package) or []:
        extra = _EXTRA.search(line)
        found = _NEED.match(line)
        if found is not None and (extra is None or extra[1] in extras):
            asked = {each.strip() for each in (found[2] or "").split(",")}
            yield found[1], asked - {""}


if __name__ == "__main__":
    raise SystemExit(main())
