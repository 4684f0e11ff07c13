# SPDX-License-Identifier: MIT
"""No package of ours that is MIT needs one under the GPL; a planted one is told."""

from __future__ import annotations

from pathlib import Path

import licences
import notices
import pytest

from imud import checkout


def test_what_is_installed_is_free_of_the_gpl() -> None:
    assert [*licences.bound("imu-probe")] == []


def plant(folder: Path, name: str, *lines: str) -> None:
    about = folder / f"{name.replace('-', '_')}-1.dist-info"
    about.mkdir()
    head = ("Metadata-Version: 2.4", f"Name: {name}", "Version: 1")
    (about / "METADATA").write_text("\n".join((*head, *lines)) + "\n")


@pytest.mark.parametrize(
    ("line", "is_bound"),
    [
        ("License-Expression: GPL-3.0-or-later", True),
        ("Classifier: License :: OSI Approved :: GNU General Public License v2", True),
        ("License: GPLv3+", True),
        ("License: AGPL-3.0", True),
        ("License-Expression: LGPL-2.1-or-later", False),
        ("License: GNU Lesser General Public License v3 (LGPLv3)", False),
        ("License-Expression: MIT", False),
        ("License: Apache 2.0", False),
    ],
)
def test_one_that_is_planted_is_told(
    line: str, is_bound: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant(tmp_path, "ours-planted", "Requires-Dist: middle-planted[more]>=1")
    plant(tmp_path, "middle-planted", "Requires-Dist: far-planted; extra == 'more'")
    plant(tmp_path, "far-planted", line)
    monkeypatch.syspath_prepend(str(tmp_path))
    found = [name for name, _ in licences.bound("ours-planted")]
    assert found == (["far-planted"] if is_bound else [])


def test_an_extra_that_nobody_asks_for_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant(tmp_path, "ours-planted", "Requires-Dist: middle-planted>=1")
    plant(tmp_path, "middle-planted", "Requires-Dist: far-planted; extra == 'docs'")
    plant(tmp_path, "far-planted", "License-Expression: GPL-3.0-or-later")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert [*licences.bound("ours-planted")] == []


def test_the_emulators_are_the_one_extra_that_may(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needed = ("Provides-Extra: sim", "Requires-Dist: far-planted; extra == 'sim'")
    plant(tmp_path, "ours-planted", *needed)
    plant(tmp_path, "far-planted", "License-Expression: GPL-3.0-or-later")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert [*licences.bound("ours-planted")] == []


def test_the_notices_are_those_of_what_is_inside() -> None:
    text = notices.text(notices.IMUD, checkout.ROOT)
    assert (checkout.ROOT / "NOTICES.txt").read_text("utf-8") == text
    vendored = {path.name for path in (checkout.ROOT / notices.VENDOR).iterdir()}
    assert vendored == {"three", "uplot", "checksums.txt"}
    assert len(notices.IMUD) == 2
