# SPDX-License-Identifier: MIT
"""Debian's packages and sources, from the servers that this machine takes them from,
into a folder of one's own. Needs no root.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

KEYRING = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
# Of Debian: other distributions use other names.
RELEASES = ("bookworm", "trixie", "forky", "sid", "stable", "testing", "unstable")


class NotInstalled(Exception):
    """Something cannot be fetched or run on this machine; the message says why."""


def apt_get(state: Path, suite: str, kind: str = "deb") -> list[str]:
    """The first words of an apt-get that knows the packages of a suite, or with
    "deb-src" their sources, and keeps all it has in a folder; its lists are up to date.
    """
    if shutil.which("apt-get") is None:
        raise NotInstalled("only a Debian can fetch it: there is no apt-get here")
    for folder in ("lists/partial", "archives/partial"):
        (state / folder).mkdir(parents=True)
    (state / "status").touch()  # no package counts as installed: fetch all dependencies
    sources = state / "sources.list"
    sources.write_text(f"{kind} [signed-by={KEYRING}] {archive()} {suite} main\n")
    settings = {
        "Dir::State": state,
        "Dir::State::status": state / "status",
        "Dir::State::lists": state / "lists",
        "Dir::Cache": state,
        "Dir::Cache::archives": state / "archives",
        "Dir::Etc::sourcelist": sources,
        "Dir::Etc::sourceparts": "-",
        "APT::Sandbox::User": "root",  # another cannot write below a home
        "APT::Update::Error-Mode": "any",  # fail if an index is missing
        "Acquire::Languages": "none",
        "Acquire::Retries": "2",
    }
    words = ["apt-get", "--quiet", "--yes", "--no-install-recommends"]
    for name, value in settings.items():
        words += ["-o", f"{name}={value}"]
    output(*words, "update")
    return words


def archive() -> str:
    """Where this machine gets Debian's packages."""
    told = output(
        *("apt-get", "indextargets", "--format", "$(REPO_URI) $(RELEASE)"),
        "Created-By: Packages",
    )
    for line in told.splitlines():
        uri, _, release = line.rpartition(" ")
        if release in RELEASES:
            return uri
    raise NotInstalled("apt knows no archive of Debian")


def output(*command: str, cwd: Path | None = None) -> str:
    """The output of a command; NotInstalled with the reason if it fails."""
    try:
        done = subprocess.run(
            command,
            cwd=cwd,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError as error:
        raise NotInstalled(f"{command[0]}: {error.strerror}") from error
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        reason = [line for line in lines if re.match(r"E:|ERROR", line)] or lines
        raise NotInstalled((reason or [f"{command[0]} failed"])[0])
    return done.stdout
