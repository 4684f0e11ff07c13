# SPDX-License-Identifier: MIT
"""Checks the subjects of the newest commits: `area: Verb ...`, an imperative, at most
60 characters.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NEWEST = 20
LENGTH_MAX = 60
SUBJECT = re.compile(r"[a-z0-9][\w./, +-]*: (?P<verb>[A-Z][\w'-]*)( .*)?")

# What begins a statement, not a command.
NO_VERBS = {
    *("A", "All", "An", "Any", "As", "At", "Both", "Each", "Every", "For", "From"),
    *("He", "How", "If", "In", "It", "Its", "More", "No", "Not", "Nothing", "Now"),
    *("Of", "On", "One", "Only", "Our", "Some", "That", "The", "Their", "There"),
    *("They", "This", "To", "Two", "We", "What", "When", "Where", "Which", "Who"),
    *("With", "Without", "You"),
}
ENDING = re.compile(r"\w+(?<!s)s$|\w+ed$|\w+ing$")
# Verbs that end like those that are none.
VERBS = {
    *("Bias", "Canvas", "Focus", "Bring", "Ring", "Spring", "String", "Swing"),
    *("Embed", "Exceed", "Feed", "Heed", "Need", "Proceed", "Seed", "Shed", "Speed"),
    *("Succeed", "Sing"),
}


def fault(subject: str) -> str:
    """What is wrong with a subject; empty: nothing."""
    found = SUBJECT.fullmatch(subject)
    if found is None:
        return "is not `area: Verb ...`"
    verb = found["verb"]
    if verb in NO_VERBS or (ENDING.match(verb) and verb not in VERBS):
        return f"begins with {verb}, which is no imperative"
    if len(subject) > LENGTH_MAX:
        return f"has {len(subject)} characters, {LENGTH_MAX} are allowed"
    return ""


def subjects(count: int) -> list[str]:
    """Those of the newest commits of this folder; none without a repository."""
    words = ["git", "log", "--no-merges", f"--max-count={count}", "--format=%s"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.splitlines()


def main() -> int:
    """Say what is wrong with each subject; return 1 if one is."""
    parser = argparse.ArgumentParser(prog="tools/commits.py", description=__doc__)
    parser.add_argument("--count", type=int, default=NEWEST, help="newest commits")
    told = [
        f"`{subject}` {why}"
        for subject in subjects(parser.parse_args().count)
        if (why := fault(subject))
    ]
    print("\n".join(told), end="\n" if told else "")
    return 1 if told else 0


if __name__ == "__main__":
    sys.exit(main())
