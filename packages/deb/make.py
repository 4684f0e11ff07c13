# SPDX-License-Identifier: MIT
"""Makes the Debian package, in the system that it is for: a virtual environment with
all that imud needs under /opt/imu-probe, service, udev rule, man pages, completion.

Debian has no zenoh, mcap and msgspec; of what it has, its versions would be others. Run
by tools/installed.py, as root in a bare system.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

HOME = Path("/opt/imu-probe")
USER = "imud"  # that the service runs as
SERVICE = "imu-probe.service"
BRIDGE = "imu-probe-bridge.service"
# What is linked into /usr where nobody else has the name: command, pages, completion.
AS_IMUD = HOME / "as-imud"
# The unit of packages before it had that name.
FORMER = "/usr/lib/systemd/system/imud.service"
SETTINGS = "/etc/imud.toml"
MAN, COMPLETIONS = "man/man1", "bash-completion/completions"

CONTROL = """\
Package: imu-probe
Version: {version}
Architecture: {architecture}
Maintainer: imu-probe authors
Section: science
Priority: optional
Depends: python3 (>= {least}), python3 (<< {below}), libc6, adduser
Recommends: systemd, udev
Installed-Size: {kib}
Description: pose of imu-probes as a network service
 The command imu-probe, also as imud where that name is free, with its service: it
 reads imu-probes on serial ports, checks what they send, publishes their pose over
 Zenoh, logs it, and shows it on a page. With the firmware of all boards, which it
 flashes.
"""

BEFORE_INSTALL = f"""\
#!/bin/sh
set -e
if grep -qs '^ExecStart={HOME}/' {FORMER} && [ -d /run/systemd/system ]; then
    if systemctl --quiet is-enabled imud.service; then touch /run/{SERVICE}; fi
    systemctl disable --now imud.service || true
fi
"""
AFTER_INSTALL = f"""\
#!/bin/sh
set -e
if ! command -v imud >/dev/null; then
    cd {AS_IMUD}
    find * ! -type d -exec ln -s {AS_IMUD}/{{}} /usr/{{}} \\; 2>/dev/null || true
fi
if [ "$1" = configure ]; then
    adduser --system --group --quiet --home /var/lib/imud --no-create-home {USER}
    if [ -d /run/systemd/system ]; then
        systemctl daemon-reload
        udevadm control --reload || true
        if [ -n "$2" ]; then systemctl try-restart {SERVICE} {BRIDGE} || true; fi
        if [ -e /run/{SERVICE} ]; then
            rm /run/{SERVICE}
            systemctl enable --now {SERVICE} || true
        fi
    fi
fi
"""
BEFORE_REMOVE = f"""\
#!/bin/sh
set -e
find /usr/bin /usr/share/{MAN} /usr/share/{COMPLETIONS} \\
    -maxdepth 1 -lname '{AS_IMUD}/*' -delete
if [ "$1" = remove ] && [ -d /run/systemd/system ]; then
    systemctl disable --now {SERVICE} {BRIDGE} || true
fi
"""
SCRIPTS = {
    "preinst": BEFORE_INSTALL,
    "postinst": AFTER_INSTALL,
    "prerm": BEFORE_REMOVE,
}


def run(*words: object) -> str:
    done = subprocess.run(
        [*map(str, words)], check=True, stdout=subprocess.PIPE, text=True
    )
    return done.stdout


def install(dist: Path) -> None:
    """The environment, as it will be: its path is inside its scripts."""
    run(sys.executable, "-m", "venv", HOME)
    pip = (HOME / "bin" / "pip", "install", "--quiet", "--no-compile")
    run(*pip, "--require-hashes", "--requirement", dist / "requirements.txt")
    ours = ("imu-probe", "imu-probe-firmware")
    run(*pip, "--no-deps", "--find-links", dist, *ours)
    run(HOME / "bin" / "pip", "uninstall", "--quiet", "--yes", "pip", "setuptools")


def lay_out(root: Path, man: Path) -> None:
    """All files, below `root` as they will lie."""
    shutil.copytree(HOME, root / HOME.relative_to("/"), symlinks=True)
    run(HOME / "bin" / "imud", "install-service", "--prefix", root, "--user", USER)
    units = root / "usr" / "lib"
    units.mkdir(parents=True)
    # In a package, files in /etc belong to the administrator.
    (root / "etc" / "systemd").rename(units / "systemd")
    (root / "etc" / "udev").rename(units / "udev")
    for name, place in (("imud", AS_IMUD.relative_to("/")), ("imu-probe", Path("usr"))):
        program = HOME / "bin" / name
        pages, words = (root / place / "share" / each for each in (MAN, COMPLETIONS))
        for folder in (root / place / "bin", pages, words):
            folder.mkdir(parents=True, exist_ok=True)
        (root / place / "bin" / name).symlink_to(program)
        for page in sorted(man.glob("*.1")):
            made = pages / page.name.replace("imud", name, 1)
            shutil.copy(page, made)
            run("gzip", "-9n", made)
        (words / name).write_text(run(program, "completion", "bash"))
    about = root / "usr" / "share" / "doc" / "imu-probe"
    about.mkdir(parents=True)
    (license_file,) = (root / HOME.relative_to("/")).glob(
        "lib/*/site-packages/imu_probe-*.dist-info/licenses/LICENSE"
    )
    shutil.copy(license_file, about / "copyright")


def control(root: Path, version: str) -> None:
    size = sum(p.stat().st_size for p in root.rglob("*") if not p.is_symlink())
    minor = sys.version_info.minor
    folder = root / "DEBIAN"
    folder.mkdir()
    text = CONTROL.format(
        version=version,
        architecture=run("dpkg", "--print-architecture").strip(),
        least=f"3.{minor}",
        below=f"3.{minor + 1}",
        kib=size // 1024,
    )
    (folder / "control").write_text(text)
    (folder / "conffiles").write_text(f"{SETTINGS}\n")
    for name, script in SCRIPTS.items():
        (folder / name).write_text(script)
        (folder / name).chmod(0o755)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dist", type=Path, help="folder with the wheels")
    parser.add_argument("man", type=Path, help="folder with the man pages")
    parser.add_argument("version")
    args = parser.parse_args()
    suite = platform.freedesktop_os_release()["VERSION_CODENAME"]
    version = f"{args.version}~{suite}"
    root = Path("/imu/deb")
    os.umask(0o022)
    install(args.dist)
    lay_out(root, args.man)
    control(root, version)
    for cache in [*root.rglob("__pycache__")]:
        shutil.rmtree(cache)
    package = args.dist / f"imu-probe_{version}_{suite}.deb"
    run("dpkg-deb", "--root-owner-group", "-Zzstd", "--build", root, package)
    shutil.rmtree(HOME)
    shutil.rmtree(root)
    sys.stdout.write(f"{package}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
