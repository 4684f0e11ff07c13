# SPDX-License-Identifier: MIT
"""`imud install-service`: makes a machine run imud whenever it is on."""

from __future__ import annotations

import os
import re
import shlex
import sys
from pathlib import Path

from imud.config.reader import as_toml
from imud.config.settings import Config, LogSettings, ParamsSettings
from imud.errors import ConfigError, FileError
from imud.ports import udev

# User names that useradd(8) accepts.
_USER = re.compile(r"[a-z_][a-z0-9_-]{0,30}")

UNIT = """\
# The pose of imu-probes as a network service.
[Unit]
Description=imud, the daemon of imu-probes
# Time stamps are UTC: start after the clock has been set, where that is done.
After=network.target time-sync.target
# A probe may be plugged in at any time, and what imud needs may return as late.
StartLimitIntervalSec=0

[Service]
Type=notify
ExecStart={program} run --config /etc/imud.toml
ExecReload=/bin/sh -c "kill -HUP $MAINPID"
Restart=on-failure
RestartSec=2
# Invalid arguments or settings: `systemctl status imu-probe` shows what to correct.
RestartPreventExitStatus=2 78
# The loop notifies systemd every second.
WatchdogSec=10
TimeoutStopSec=5
# Each connection is a file; 1,024 are few for a port open to strangers.
LimitNOFILE=65536

User={user}
Group={user}
# The group that may open serial ports on Debian and its derivatives.
SupplementaryGroups=dialout
StateDirectory=imud
StateDirectoryMode=0750
WorkingDirectory=/var/lib/imud
UMask=0027

# Serial ports and no other device.
DevicePolicy=closed
DeviceAllow=char-ttyUSB rw
DeviceAllow=char-ttyACM rw
DeviceAllow=char-ttyAMA rw
DeviceAllow=char-ttyS rw
DeviceAllow=char-rfcomm rw
DeviceAllow=char-pts rw
{confined}"""

# Beside the daemon: it opens no device, and may end without it.
BRIDGE_UNIT = """\
# Poses of imu-probes for OSC, VMC, LSL, MQTT and MAVLink: what /etc/imud.toml enables.
[Unit]
Description=imud bridge, beside the daemon of imu-probes
After=network.target imu-probe.service
StartLimitIntervalSec=0

[Service]
Type=exec
ExecStart={program} bridge all --config /etc/imud.toml
# Also while there is no daemon yet.
Restart=on-failure
RestartSec=5
RestartPreventExitStatus=2 78
TimeoutStopSec=5

User={user}
Group={user}
DevicePolicy=closed
{confined}"""

CONFINED = """
# It can write only its own folder.
ProtectSystem=strict
ProtectHome={home}
PrivateTmp={private_tmp}
NoNewPrivileges=yes
CapabilityBoundingSet=
AmbientCapabilities=
ProtectClock=yes
ProtectControlGroups=yes
ProtectHostname=yes
ProtectKernelLogs=yes
ProtectKernelModules=yes
ProtectKernelTunables=yes
ProtectProc=invisible
LockPersonality=yes
MemoryDenyWriteExecute=yes
RemoveIPC=yes
RestrictNamespaces=yes
RestrictRealtime=yes
RestrictSUIDSGID=yes
# Zenoh asks for the machine's addresses over netlink.
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged @resources
# A library that asks for more gets an error and is not killed.
SystemCallErrorNumber=EPERM

[Install]
WantedBy=multi-user.target
"""

HOMES = ("/home", "/root", "/run/user")
TEMPORARY = ("/tmp", "/var/tmp")  # noqa: S108 - nothing is written there

USERS = """\
# The user that imud runs as.
u {user} - "imud, the daemon of imu-probes" /var/lib/imud
m {user} dialout
"""

NEXT = """\
to start it now and at every boot:
  systemd-sysusers && systemctl daemon-reload
  udevadm control --reload && udevadm trigger --subsystem-match=tty
  systemctl enable --now imu-probe
then adopt the port of a probe:
  imud ports; imud ports adopt /dev/ttyUSB0
and, for what imud bridge sends:
  systemctl enable --now imu-probe-bridge
"""


REMOVED = """\
to stop it now, and to remove its user and its data (logs, params):
  systemctl disable --now imu-probe imu-probe-bridge
  systemctl daemon-reload; udevadm control --reload
  userdel imud; rm -r /var/lib/imud
"""

SETTINGS = "etc/imud.toml"
# Size of logs: two weeks of one probe, which fits a card of 32 GB.
SERVICE_KEEP_MB = 16_000


def files(user: str, program: Path) -> dict[str, str]:
    """The files to be written, by path."""
    home = "read-only" if _is_below(program, HOMES) else "yes"
    private_tmp = "no" if _is_below(program, TEMPORARY) else "yes"
    confined = CONFINED.format(home=home, private_tmp=private_tmp)
    parts = {"program": _quoted(program), "user": user, "confined": confined}
    return {
        "etc/systemd/system/imu-probe.service": UNIT.format(**parts),
        "etc/systemd/system/imu-probe-bridge.service": BRIDGE_UNIT.format(**parts),
        udev.PLACE: udev.rules(),
        "etc/sysusers.d/imu-probe.conf": USERS.format(user=user),
        SETTINGS: as_toml(
            Config(
                params=ParamsSettings("params"),
                log=LogSettings(keep_mb=SERVICE_KEEP_MB),
            )
        ),
    }


def remove(prefix: Path) -> int:
    """Takes away what run() wrote, but for settings and data."""
    for place in (*files("imud", _program()), udev.ADOPTED_PLACE):
        path = prefix / place
        if not path.exists():
            continue
        if place == SETTINGS:
            sys.stdout.write(f"{path}: your settings, kept; rm {path} to remove them\n")
            continue
        try:
            path.unlink()
        except OSError as error:
            raise FileError(
                f"can't remove {path}: {error.strerror}; run it with sudo"
            ) from error
        sys.stdout.write(f"{path}: removed\n")
    sys.stdout.write(REMOVED)
    return 0


def run(prefix: Path, user: str, *, is_shown: bool) -> int:
    """Writes the service's files below `prefix`, or prints them; settings that exist
    stay. Returns the exit code; ConfigError for a name that no user can have.
    """
    if not _USER.fullmatch(user):
        raise ConfigError(f"{user!r} is not a valid user name; try --user imud")
    written = files(user, _program())
    if is_shown:
        for place, text in written.items():
            sys.stdout.write(f"# {prefix / place}\n{text}\n")
        return 0
    for place, text in written.items():
        path = prefix / place
        # Settings are the user's own, once there are any.
        if place == SETTINGS and path.exists():
            sys.stdout.write(f"{path}: already exists, unchanged\n")
            continue
        write(path, text)
        sys.stdout.write(f"{path}: written\n")
    sys.stdout.write(NEXT)
    if _is_below(_program(), TEMPORARY):
        sys.stderr.write(
            f"imud: {_program()} will not exist after the next reboot: install imud "
            "elsewhere, and run this again there\n"
        )
    return 0


def write(path: Path, text: str) -> None:
    """All of it or nothing."""
    beside = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_text(text, "utf-8")
        beside.chmod(0o644)
        beside.replace(path)
    except OSError as error:
        raise FileError(
            f"can't write {path}: {error.strerror}; run it with sudo, or choose "
            "another folder with --prefix DIR"
        ) from error


def _program() -> Path:
    """The imud that runs now, also in an environment of its own."""
    beside = Path(sys.executable).with_name("imud")
    return beside if beside.exists() else Path(sys.argv[0]).absolute()


def _is_below(program: Path, folders: tuple[str, ...]) -> bool:
    paths = (program, Path(os.path.realpath(program)))
    return any(path.is_relative_to(folder) for path in paths for folder in folders)


def _quoted(program: Path) -> str:
    """As systemd.service(5) wants it: a percent sign and a dollar are its own."""
    text = str(program).replace("%", "%%").replace("$", "$$")
    return text if shlex.quote(text) == text else f'"{text}"'
