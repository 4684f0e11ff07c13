# SPDX-License-Identifier: MIT
"""Clones the last commit into a bare Debian and runs the README's commands there, so
that a missing install step shows up here and not at a newcomer's.

Needs only the system's Python. The bare system has Python, make and git; mmdebstrap
makes it once, as root, and it is kept as an archive in the user's cache. Without root
the commands run in a fresh clone on this machine, which may hide a missing install
step; a line of output says so.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
RECORDINGS = (
    ROOT.parent / "shared" / "data"
)  # not in the repository; see tests/conftest.py

SUITES = ("bookworm", "trixie")  # Debian 12 and 13
COMMANDS = ("make demo SECONDS=10", "make demo SECONDS=10", "make test")
PACKAGES = ("ca-certificates", "git", "make", "python3")
# A second of one processor is not one of another's, nor of the same one beside other
# work: budgets count runs of this, which are timed while the command runs.
UNIT = "sum(hash(str(number)) for number in range(1_000_000))"
UNIT_EVERY_S = 10.0
SPENT = ROOT / "build" / "spent.json"  # what each command took; tools/budget.py reads
KEPT_DAYS = 30  # in an older system most packages would be downloaded again

# Below the root of the bare system, or below a temporary folder of this machine.
WORK = "work"
PROJECT = "work/imu-probe"

# Settings for reaching package servers, taken over from this machine; nothing else is.
REACHES = re.compile(
    r"TERM|CI|(PIP|SSL)_\w+|\w+_CA_(BUNDLE|CERTS)\w*|\w+_proxy", re.IGNORECASE
)
RESOLVES = ("/etc/resolv.conf", "/etc/hosts", "/etc/pip.conf")
CERTIFICATES = "/etc/ssl"

# Runs in a mount namespace of its own, so that nothing of this machine can be removed
# through the mounts, which end with the command. Arguments: the root, read-only
# folders, --, the command's folder in the root, the command.
ENTER = """
root=$1; shift
mount --bind "$root" "$root" || exit 125
for folder in proc sys dev dev/pts dev/shm; do
    mkdir -p "$root/$folder" && mount --bind "/$folder" "$root/$folder" || exit 125
done
while [ "$1" != -- ]; do
    mkdir -p "$root$1" && mount --bind "$1" "$root$1" &&
        mount -o remount,bind,ro "$root$1" || exit 125
    shift
done
shift
cd "$root" && mkdir -p .outside && pivot_root . .outside && umount -l /.outside &&
    rmdir /.outside && cd "/$1" || exit 125
shift
exec "$@"
"""


class NoRootError(Exception):
    """No bare system can be made on this machine; the message says why."""


class Room(NamedTuple):
    """A folder in which commands run, and whether it is the root of a bare system."""

    folder: Path
    is_bare: bool
    home: str = PROJECT  # where the commands run, below the folder

    def run(self, *command: str, quiet: bool = False) -> tuple[int, str]:
        """Return the exit code of a command, and what it printed if `quiet`."""
        environment = {
            name: value for name, value in os.environ.items() if REACHES.fullmatch(name)
        }
        environment |= {"LANG": "C.UTF-8", "PATH": os.environ["PATH"]}
        if self.is_bare:
            environment |= {"HOME": "/root", "PATH": "/usr/sbin:/usr/bin:/sbin:/bin"}
            words = ["unshare", "--mount", "--propagation", "private", "sh", "-c"]
            words += [ENTER, "-", str(self.folder), *shared_with(self.folder)]
            words += ["--", self.home, *command]
        else:
            environment["HOME"] = os.environ.get("HOME", str(self.folder))
            words = list(command)
        sys.stdout.flush()
        done = subprocess.run(
            words,
            cwd=self.folder if self.is_bare else self.folder / self.home,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if quiet else None,
            text=True,
            check=False,
        )
        return done.returncode, done.stdout or ""


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="tools/fresh.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="example: tools/fresh.py --suite trixie 'make demo SECONDS=5'",
    )
    parser.add_argument(
        "--suite", action="append", help=f"of Debian (default: {' and '.join(SUITES)})"
    )
    parser.add_argument(
        "--here", action="store_true", help="only a fresh clone on this machine"
    )
    parser.add_argument(
        "command", nargs="*", help="in the clone (default: the README's two)"
    )
    args = parser.parse_args()
    commands = args.command or COMMANDS
    if output("git", "-C", str(ROOT), "status", "--porcelain"):
        sys.stdout.write("note: uncommitted changes are not in the clone\n")
    suites = args.suite or SUITES
    archives: dict[str, Path | None] = {}
    try:
        archives |= {suite: bare_system(suite) for suite in suites if not args.here}
    except NoRootError as error:
        sys.stdout.write(f"fresh: no bare Debian, so on this machine: {error}\n")
    archives = archives or {"this machine": None}
    rows = [
        row
        for where, archive in archives.items()
        for row in tried(where, archive, commands)
    ]
    width = max(len(row[1]) for row in rows)
    sys.stdout.write("\n")
    for where, what, spent, fault in rows:
        said = f"{where:<12}  {what:<{width}}  {spent}"
        sys.stdout.write(f"{said}  {fault or 'passed'}\n")
    return 1 if any(fault for *_, fault in rows) else 0


def tried(
    where: str, archive: Path | None, commands: Sequence[str]
) -> Iterator[tuple[str, str, str, str]]:
    """Run commands in a fresh clone; yield where, what, time and fault of each."""
    with room(archive) as fresh:
        for command in commands:
            sys.stdout.write(f"\n== {where}: {command}\n")
            begun = time.monotonic()
            started = os.times()
            with pace() as units_s:
                code, _ = fresh.run("sh", "-c", command)
            ended = os.times()
            used_s = max(0.0, sum(ended[2:4]) - sum(started[2:4]) - sum(units_s))
            units = used_s * len(units_s) / sum(units_s)
            if not code:
                keep(command, units)
            spent = f"{time.monotonic() - begun:5.0f} s, used {used_s:5.0f} s"
            spent += f" ({units:.0f} units)"
            yield where, command, spent, f"FAILED, exit {code}" if code else ""
        _, left = fresh.run("git", "status", "--porcelain", quiet=True)
        if left:
            yield where, "git status", "", f"FAILED, files left:\n{left}"


@contextmanager
def pace() -> Iterator[list[float]]:
    """The processor seconds of each UNIT that ran meanwhile, one of them at once."""
    found: list[float] = []
    is_over = threading.Event()

    def follow() -> None:
        while True:
            unit = subprocess.Popen((sys.executable, "-c", UNIT))
            _, _, usage = os.wait4(unit.pid, 0)
            unit.returncode = 0
            found.append(usage.ru_utime + usage.ru_stime)
            if is_over.wait(UNIT_EVERY_S):
                return

    following = threading.Thread(target=follow)
    following.start()
    try:
        yield found
    finally:
        is_over.set()
        following.join()


def keep(command: str, units: float) -> None:
    """For the budget: the last figure of each command."""
    SPENT.parent.mkdir(exist_ok=True)
    found = json.loads(SPENT.read_text()) if SPENT.exists() else {}
    SPENT.write_text(json.dumps(found | {command: round(units)}))


@contextmanager
def room(archive: Path | None) -> Iterator[Room]:
    """A fresh clone, in a bare system if there is an archive of one."""
    with tempfile.TemporaryDirectory(prefix="imu-probe-") as name:
        folder = Path(name)
        if archive is not None:
            output("tar", "-xpf", str(archive), "-C", name, "--exclude=./dev/*")
            prepare(folder)
        (folder / WORK).mkdir()
        output("git", "clone", "--quiet", str(ROOT), str(folder / PROJECT))
        if RECORDINGS.is_dir():
            shutil.copytree(RECORDINGS, folder / WORK / "shared" / "data")
        fresh = Room(folder, archive is not None)
        if archive is not None:  # the clone's files belong to the user who runs this
            fresh.run("git", "config", "--global", "--add", "safe.directory", "*")
        yield fresh


def prepare(root: Path) -> None:
    """Give a bare system this machine's settings for reaching package servers."""
    for name in RESOLVES:
        if Path(name).exists():
            shutil.copy(name, root / name[1:])
    own = Path.home() / ".config" / "pip"
    if own.is_dir():
        shutil.copytree(own, root / "root" / ".config" / "pip")
    settings = root / "etc" / "apt" / "apt.conf.d" / "99as-outside"
    settings.write_text(
        "".join(
            f"{line}\n"
            for line in output("apt-config", "dump", "Acquire").splitlines()
            if re.match(r"Acquire::(https?|ftp|Check-|Languages|Retries)", line)
        )
    )


def shared_with(root: Path) -> list[str]:
    """Folders of this machine that its pip settings refer to, and certificates."""
    told = [os.environ.get("PIP_FIND_LINKS", "")]
    for path in (Path("/etc/pip.conf"), Path.home() / ".config" / "pip" / "pip.conf"):
        told += [path.read_text()] if path.is_file() else []
    # Two levels: commands may write into the first, such as /opt.
    named = re.findall(r"(?:file://|[\s=])/(\w+/[\w.-]+)", " ".join(["", *told]))
    folders = sorted({name for name in named if Path("/", name).is_dir()})
    # Only where the bare system has nothing of its own.
    free = [f"/{name}" for name in folders if not any((root / name).glob("*"))]
    return [CERTIFICATES, *free]


def bare_system(
    suite: str, packages: Sequence[str] = PACKAGES, kind: str = "bare"
) -> Path:
    """Return the archive of a bare Debian with those packages; make it if it is absent
    or old. `kind` names it.
    """
    if os.geteuid() != 0:
        raise NoRootError("it needs root: try sudo make fresh")
    attempt("unshare", "--mount", "true")
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    archive = cache / "imu-probe" / f"{kind}-{suite}.tar"
    archive.parent.mkdir(parents=True, exist_ok=True)
    with archive.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not is_young(archive):
            make_bare_system(suite, packages, archive)
    return archive


def is_young(archive: Path) -> bool:
    if not archive.exists():
        return False
    return time.time() - archive.stat().st_mtime < KEPT_DAYS * 86400


def make_bare_system(suite: str, packages: Sequence[str], archive: Path) -> None:
    sys.stdout.write(f"creating a bare {suite}, stored as {archive}\n")
    sys.stdout.flush()
    if shutil.which("mmdebstrap") is None:
        install = "apt-get install -y --no-install-recommends mmdebstrap"
        attempt("sh", "-c", f"{install} || {{ apt-get update && {install}; }}")
    part = archive.with_suffix(".part.tar")
    attempt(
        *("mmdebstrap", "--quiet", "--variant=minbase"),
        *(f"--include={','.join(packages)}", suite, str(part)),
    )
    part.rename(archive)


def attempt(*command: str) -> None:
    """Run a command that a bare system needs; raise NoRootError if it fails."""
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
    except OSError as error:
        raise NoRootError(f"{command[0]}: {error.strerror}") from error
    if done.returncode:
        last = (done.stdout.strip().splitlines() or ["no reason given"])[-1]
        raise NoRootError(f"{command[0]}: {last}")


def output(*command: str) -> str:
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout


if __name__ == "__main__":
    sys.exit(main())
