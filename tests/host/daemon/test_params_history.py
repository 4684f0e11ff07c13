# SPDX-License-Identifier: MIT
"""The history of params: active params are kept, and a failing disk does not stop
it."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

import pytest

from imud.config.settings import ParamsSettings
from imud.daemon import params_history
from imud.daemon.params_history import FILES_MAX, HistoryFiles, entries_of
from imud.errors import CommandRefused, FileError
from imud.params import file
from imud.params.value import Params, ParamsRecord
from params_bench import GOOD

ID = "00112233445566aa"
SECOND = 10**9


def numbered(number: int) -> Params:
    return Params((ParamsRecord(200, number.to_bytes(4, "little")),))


def kept(history: HistoryFiles, *sets: Params, begin_s: int = 0) -> None:
    """Keeps these sets, a second each, and waits for the disk."""
    for number, params in enumerate(sets):
        history.keep(ID, params, (begin_s + number) * SECOND)
    history._worker.submit(int).result()


def test_each_set_that_came_into_force_is_a_file(tmp_path: Path) -> None:
    history = HistoryFiles(tmp_path)
    kept(history, GOOD, numbered(1), GOOD)
    entries = entries_of(tmp_path / ID)
    assert [entry.time[-7:] for entry in entries] == ["000002Z", "000001Z", "000000Z"]
    assert [file.read(entry.path).params for entry in entries] == [
        GOOD,
        numbered(1),
        GOOD,
    ]
    assert file.read(entries[0].path).probe_id == ID


def test_the_last_one_again_is_no_other(tmp_path: Path) -> None:
    history = HistoryFiles(tmp_path)
    kept(history, GOOD, GOOD)
    kept(HistoryFiles(tmp_path), GOOD, begin_s=5)
    assert len(entries_of(tmp_path / ID)) == 1


def test_the_oldest_go(tmp_path: Path) -> None:
    history = HistoryFiles(tmp_path)
    kept(history, *(numbered(n) for n in range(FILES_MAX + 7)))
    entries = entries_of(tmp_path / ID)
    assert len(entries) == FILES_MAX
    assert file.read(entries[-1].path).params == numbered(7)


def test_a_disk_that_fails_is_one_line_until_it_works_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    history = HistoryFiles(tmp_path)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with caplog.at_level(logging.WARNING, "imud"):
        monkeypatch.setattr(params_history.os, "fsync", full)
        kept(history, *(numbered(n) for n in range(5)))
        (line,) = caplog.messages
        assert line == (
            f"history of params: can't write to {tmp_path / ID}: No space left on "
            "device; everything else continues"
        )
        assert list((tmp_path / ID).iterdir()) == []
        monkeypatch.undo()
        kept(history, GOOD)
        assert len(entries_of(tmp_path / ID)) == 1
        assert len(caplog.messages) == 1


def test_a_folder_that_can_t_be_is_one_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    with caplog.at_level(logging.WARNING, "imud"):
        kept(HistoryFiles(tmp_path / "file"), GOOD, numbered(1))
    assert len(caplog.messages) == 1
    assert "Not a directory" in caplog.messages[0]


def test_an_entry_is_found_by_how_its_digest_begins(tmp_path: Path) -> None:
    history = HistoryFiles(tmp_path)
    kept(history, GOOD, numbered(1))
    (tmp_path / ID / "notes.txt").write_text("mine")

    def ask(**parameters: str) -> dict[str, object]:
        return asyncio.run(history.command(ID, parameters))

    reply = ask()
    assert reply["folder"] == str(tmp_path / ID)
    assert reply["entries"] == [
        {"time": "19700101T000001Z", "digest": f"{numbered(1).digest:08x}"},
        {"time": "19700101T000000Z", "digest": f"{GOOD.digest:08x}"},
    ]
    found = ask(digest=f"{GOOD.digest:08x}"[:4])
    assert found["bytes"] == GOOD.encode().hex()
    assert found["probe_id"] == ID
    for wrong in ("", "../..", "012345678", "X"):
        with pytest.raises(CommandRefused, match="a digest is up to 8 hexadecimal"):
            ask(digest=wrong)
    with pytest.raises(CommandRefused, match="there are no params"):
        ask(digest="00000001")
    entries_of(tmp_path / ID)[0].path.write_text("x")
    with pytest.raises(FileError, match=r"history: .*\.toml: it is not TOML"):
        ask(digest=f"{numbered(1).digest:08x}")


def test_of_two_that_begin_alike_neither_is_taken(tmp_path: Path) -> None:
    history = HistoryFiles(tmp_path)
    kept(history, *(numbered(n) for n in range(20)))
    firsts = [entry.digest[0] for entry in entries_of(tmp_path / ID)]
    twice = next(first for first in firsts if firsts.count(first) > 1)
    with pytest.raises(CommandRefused, match="more than one digest"):
        asyncio.run(history.command(ID, {"digest": twice}))


def test_a_probe_never_heard_has_none_and_no_folder_is_off(tmp_path: Path) -> None:
    reply = asyncio.run(HistoryFiles(tmp_path).command(ID, {}))
    assert reply["entries"] == []
    off = HistoryFiles(None)
    kept(off, GOOD)
    with pytest.raises(CommandRefused, match="keeps no history"):
        asyncio.run(off.command(ID, {}))
    off.close()


def test_an_id_that_is_no_name_of_a_folder_is_not_one(tmp_path: Path) -> None:
    history = HistoryFiles(tmp_path)
    history.keep("../evil", GOOD, 0)
    history.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("setting", "state", "folder"),
    [
        (None, "/var/state", "/var/state/imud/params"),
        (None, "", "/me/.local/state/imud/params"),
        ("~/mine", "/var/state", "/me/mine"),
        ("/mine", "/var/state", "/mine"),
        ("mine", "", "mine"),
        ("", "/var/state", None),
        ("~nobody-of-that-name/x", "", None),
    ],
)
def test_the_folder_is_where_the_setting_says(
    setting: str | None, state: str, folder: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", state)
    monkeypatch.setenv("HOME", "/me")
    made = ParamsSettings() if setting is None else ParamsSettings(setting)
    assert made.folder == (None if folder is None else Path(folder))
