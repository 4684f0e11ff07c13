# SPDX-License-Identifier: MIT
"""The Debian package's scripts beside another package with a command `imud`."""

from __future__ import annotations

import runpy
import subprocess
from pathlib import Path

MAKE = runpy.run_path(str(Path(__file__).parents[2] / "packages/deb/make.py"))
COMMAND, PAGE = Path("usr/bin/imud"), Path("usr/share/man/man1/imud.1.gz")
STUBS = 'for p in adduser systemctl udevadm; do eval "$p() { echo $p \\$*; }"; done\n'


def run(root: Path, name: str, *words: str) -> str:
    """Runs a script of the package below `root`; returns what it calls."""
    script = MAKE["SCRIPTS"][name]
    for place in ("/usr/", "/opt/", "/run/"):
        script = script.replace(place, f"{root}{place}")
    path = f"{root}/usr/bin:/usr/bin:/bin"
    shell = ["/bin/sh", "-c", STUBS + script, name, *words]
    return subprocess.check_output(shell, env={"PATH": path}, text=True)


def ours(root: Path) -> list[bool | None]:
    """Whether command and page are links of ours; None: nobody has that name."""
    paths = (root / COMMAND, root / PAGE)
    return [path.is_symlink() if path.exists() else None for path in paths]


def theirs(path: Path) -> None:
    path.unlink(missing_ok=True)
    path.touch(0o755)


def test_the_name_imud_is_ours_where_it_is_free(tmp_path: Path) -> None:
    (tmp_path / "usr/share/bash-completion/completions").mkdir(parents=True)
    for path in (COMMAND, PAGE):
        made = tmp_path / "opt/imu-probe/as-imud" / path.relative_to("usr")
        for folder in (made.parent, (tmp_path / path).parent):
            folder.mkdir(parents=True)
        made.touch(0o755)
    for _ in range(2):
        run(tmp_path, "postinst", "configure")
        assert ours(tmp_path) == [True, True]
        run(tmp_path, "prerm", "upgrade")
        assert ours(tmp_path) == [None, None]
    theirs(tmp_path / PAGE)
    run(tmp_path, "postinst", "configure")
    assert ours(tmp_path) == [True, False]
    theirs(tmp_path / COMMAND)  # after ours: dpkg puts it in the place of the link
    run(tmp_path, "prerm", "remove")
    run(tmp_path, "postinst", "configure")
    assert ours(tmp_path) == [False, False]


def test_our_service_of_the_name_imud_goes_on(tmp_path: Path) -> None:
    unit = tmp_path / MAKE["FORMER"][1:]
    for folder in ("run/systemd/system", "opt/imu-probe/as-imud", unit.parent):
        (tmp_path / folder).mkdir(parents=True)
    for program, count in (("usr", 0), ("opt/imu-probe", 1)):
        unit.write_text(f"[Service]\nExecStart={tmp_path}/{program}/bin/imud run\n")
        calls = run(tmp_path, "preinst", "upgrade", "0.2")
        assert calls.count("disable --now imud.service") == count
        calls = run(tmp_path, "postinst", "configure", "0.2")
        assert calls.count("enable --now imu-probe.service") == count
