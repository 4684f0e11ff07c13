# SPDX-License-Identifier: MIT
"""Installs what `make release` has built as people do, in a bare Debian that has Python
and pipx and no compiler, and does what they would do first. Makes the Debian package on
the way. Needs root, for the bare systems; see tools/fresh.py.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import fresh
import manpages
import release

PACKAGES = ("ca-certificates", "pipx", "python3")
DIST = "imu/dist"
FIRST_POSE_S = 30.0

PIPX = "export PATH=$PATH:/root/.local/bin PIPX_DEFAULT_PYTHON=/usr/bin/python3\n"
INSTALL = PIPX + "pipx install --pip-args='--find-links /imu/dist' 'imu-probe[sim]' >&2"
# A daemon on a virtual probe. Both end with the command, which is {done} once the probe
# is listed.
SERVE = PIPX + (
    "imud sim nano --stream --link /tmp/probe >/tmp/sim.txt 2>&1 & sim=$!\n"
    "imud run /tmp/probe --no-log >/tmp/run.txt 2>&1 & run=$!\n"
    "trap 'kill $sim $run; wait' EXIT\n"
    "for each in $(seq 100); do imud list 2>/dev/null | grep -q streaming && "
    "{{ {done}; exit; }}; sleep 0.2; done; cat /tmp/sim.txt /tmp/run.txt; exit 1"
)
DEB = (
    "export SOURCE_DATE_EPOCH={moment}; python3 /imu/deb.py /imu/dist /imu/man "
    "{version} && rm -rf /root/.cache"
)


class Row:
    """A step, its duration, and its errors."""

    def __init__(self, suite: str, what: str, seconds: float, fault: str = "") -> None:
        self.suite, self.what, self.seconds, self.fault = suite, what, seconds, fault

    def __str__(self) -> str:
        verdict = self.fault or "passed"
        return f"{self.suite:<9} {self.what:<40} {self.seconds:6.1f} s  {verdict}"


class Desk:
    """A bare system, and what is tried in it."""

    def __init__(self, suite: str, room: fresh.Room) -> None:
        self._suite = suite
        self._room = room

    def tries(
        self, what: str, command: str, most_s: float | None = None, says: str = ""
    ) -> Row:
        began_s = time.monotonic()
        code, out = self._room.run("sh", "-c", command, quiet=True)
        seconds = time.monotonic() - began_s
        fault = f"FAILED, exit {code}" if code else ""
        if not fault and says not in out:
            fault = f"FAILED, it does not say {says!r}"
        if not fault and most_s is not None and seconds > most_s:
            fault = f"FAILED, more than {most_s:g} s"
        if fault:
            sys.stdout.write(out)
        row = Row(self._suite, what, seconds, fault)
        sys.stdout.write(f"{row}\n")
        sys.stdout.flush()
        return row


def people(desk: Desk) -> Iterator[Row]:
    """Who subscribes, and who tries it without a board."""
    yield desk.tries("no compiler is there", "! command -v cc gcc clang make")
    yield desk.tries("pipx install imu-probe[sim]", INSTALL)
    first = PIPX + "imud demo --seconds 1"
    yield desk.tries("imud demo, to its first poses", first, FIRST_POSE_S, "all well")
    demo = PIPX + "imud demo --seconds 5 --board both"
    yield desk.tries("imud demo --board both", demo, says="all well")
    serve = SERVE.format(done="bash -c 'time -p imud list'")
    yield desk.tries("a daemon, and imud list beside it", serve, says="streaming")
    flash = PIPX + "touch /tmp/none; imud flash /tmp/none --board nano --dry-run"
    yield desk.tries("imud flash --dry-run", flash, says="nothing was written")


def package(desk: Desk, version: str, suite: str) -> Iterator[Row]:
    """Who runs it on a headless Debian."""
    yield desk.tries(
        "make the Debian package", DEB.format(version=version, moment=release.moment())
    )
    deb = f"/imu/dist/imu-probe_{version}~{suite}_{suite}.deb"
    apt = "apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -qq -y"
    yield desk.tries("apt install imu-probe.deb", f"{apt} {deb} >/dev/null 2>&1")
    for name in ("imu-probe", "imud"):
        yield desk.tries(f"{name} --version", f"{name} --version", says=version)
    unit = "cat /usr/lib/systemd/system/imu-probe.service"
    yield desk.tries("its service", unit, says="/opt/imu-probe/bin/imud run")
    config = "imud config --check /etc/imud.toml"
    yield desk.tries("its settings", config)
    pages = (
        "cd /usr/share/man/man1 && ls imud-flash.1.gz imu-probe-flash.1.gz && id imud"
    )
    yield desk.tries("its man pages and user", pages)
    yield desk.tries("apt purge", "apt-get purge -qq -y imu-probe && ! command -v imud")


def tried(suite: str, dist: Path, version: str) -> Iterator[Row]:
    archive = fresh.bare_system(suite, PACKAGES, "pipx")
    for what in (people, package):
        with tempfile.TemporaryDirectory(prefix="imu-probe-") as name:
            folder = Path(name)
            fresh.output("tar", "-xpf", str(archive), "-C", name, "--exclude=./dev/*")
            fresh.prepare(folder)
            shutil.copytree(dist, folder / DIST)
            manpages.write(folder / "imu" / "man")
            shutil.copy(release.ROOT / "packages/deb/make.py", folder / "imu/deb.py")
            desk = Desk(suite, fresh.Room(folder, True, "imu"))
            yield from people(desk) if what is people else package(desk, version, suite)
            for deb in (folder / DIST).glob("*.deb"):
                shutil.copy(deb, dist)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: sudo python tools/installed.py"
    )
    parser.add_argument("--suite", action="append", help="of Debian (default: 12, 13)")
    parser.add_argument("--dist", type=Path, default=release.PLACE / "dist")
    args = parser.parse_args()
    if not args.dist.is_dir():
        sys.stderr.write(f"installed: {args.dist} is missing: make release\n")
        return 1
    version = release.version_of(release.ROOT)
    try:
        rows = [
            row
            for suite in args.suite or fresh.SUITES
            for row in tried(suite, args.dist, version)
        ]
    except fresh.NoRootError as error:
        sys.stdout.write(f"installed: not run, as there is no bare Debian: {error}\n")
        return 0
    return 1 if any(row.fault for row in rows) else 0


if __name__ == "__main__":
    raise SystemExit(main())
