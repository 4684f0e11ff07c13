# SPDX-License-Identifier: MIT
"""Names that a stranger has chosen: nothing of them acts on a terminal or a table."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.writer import Writer

from imud.cli import main
from imud.columns import inert
from imud.log.parts import seal
from imud.log.reader import FRAME_ENCODING
from log_files import records

# Sets the title of a terminal, and clears it; and overwrites the line.
EVIL = "\x1b]0;title\x07\x1b[2Jp\r\n"


def stranger(path: Path, evil: str) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        head = {"version": f"1{evil}", "schema_fingerprint": "0x0"}
        writer.add_metadata("imud", seal("imud", head))
        for topic in ("frame", f"x{evil}"):
            name = f"imud/p{evil}/{topic}"
            channel = writer.register_channel(name, FRAME_ENCODING, 0)
            for record in records(3):
                writer.add_message(channel, 0, record.content, 0)
        writer.finish()
    return path


@pytest.mark.parametrize("command", ["info", "decode", "export", "recover"])
def test_no_control_character_of_a_log_reaches_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    main([command, str(stranger(tmp_path / "log.mcap", EVIL))])
    captured = capsys.readouterr()
    text = (captured.out + captured.err).replace("\n", "")
    assert text
    assert text.isprintable(), repr(text)
    if command == "info":
        assert "?]0;title" in text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ('=HYPERLINK("http://x","y")', '\'=HYPERLINK("http://x","y")'),
        ("@SUM(1)", "'@SUM(1)"),
        ("-1+2", "'-1+2"),
        ("\t=1", "'?=1"),
        ("in magnetic field", "in magnetic field"),
    ],
)
def test_a_cell_of_a_table_is_no_formula(text: str, shown: str) -> None:
    assert inert(text) == shown


def test_a_port_named_as_a_formula_is_text_in_an_exported_table(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("imud/p/status", "json", 0)
        data = b'{"t_ns": 1, "state": "=1+1", "port": "@SUM(1)"}'
        writer.add_message(channel, 0, data, 0)
        writer.finish()
    assert main(["export", str(path), "--to", "csv", "--out", str(tmp_path)]) == 0
    (table,) = tmp_path.glob("*status.csv")
    row = table.read_text().splitlines()[1]
    assert "'=1+1,'@SUM(1)" in row
