# SPDX-License-Identifier: MIT
"""A file of params: what is written is read as the same bytes, and a mistake of who
edits it is one line."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imud.errors import FileError, ParamsError
from imud.params import file
from imud.params.value import Params, ParamsRecord
from params_bench import GOOD, RECORDS

ID = "00112233445566aa"


@given(RECORDS)
def test_a_file_gives_the_same_bytes(params: Params) -> None:
    text = file.written(params, ID)
    read = file.parse(text)
    assert read.params.encode() == params.encode()
    assert read.probe_id == ID
    assert text.isascii()


def test_a_file_is_to_be_read_by_people() -> None:
    assert file.written(GOOD, ID) == (
        "# Params of an imu-probe: what turns its raw readings into poses "
        "(docs/params.md).\n"
        'probe = "00112233445566aa"\n'
        f'digest = "{GOOD.digest:08x}"\n'
        "\n"
        "# Accelerometer: force = matrix * (counts - bias) * the value of a count.\n"
        "[acc]\n"
        "bias_counts = [12.5, -40.0, 8.0]\n"
        "matrix = [\n"
        "    [1.002, 0.001,   0.0],\n"
        "    [  0.0, 0.998,   0.0],\n"
        "    [  0.0,   0.0,   1.0],\n"
        "]\n"
        "sigma_m_s2 = 0.012\n"
        'method = "positions"\n'
        "\n"
        "# How the probe behaves.\n"
        "[options]\n"
        'button_does = "tell"\n'
        'reference = "none"\n'
    )


def test_a_file_that_is_empty_is_not_taken_for_no_params() -> None:
    assert file.parse(file.written(Params())).params == Params()
    for text in ("", "# cut off", f'probe = "{ID}"'):
        with pytest.raises(ParamsError, match="holds no params"):
            file.parse(text)


def test_what_this_imud_does_not_know_is_kept() -> None:
    records = (
        ParamsRecord(200, b"\1\2"),
        ParamsRecord(5, b"\1\2later"),
        ParamsRecord(1, bytes(30)),
    )
    text = file.written(Params(records))
    table = tomllib.loads(text)
    assert table["unknown"] == {"200": "0102"}
    assert table["options"]["tail"] == b"later".hex()
    assert table["acc"]["parts"] == 2
    assert table["order"] == [200, 5, 1]
    assert file.parse(text).params.records == records


def edited(old: str, new: str) -> str:
    text = file.written(GOOD, ID).replace(f'digest = "{GOOD.digest:08x}"\n', "")
    assert old in text
    return text.replace(old, new)


def test_an_edited_file_must_drop_its_digest() -> None:
    text = file.written(GOOD, ID).replace("12.5", "12.75")
    with pytest.raises(ParamsError, match=r"does not match: .* delete the line"):
        file.parse(text)
    acc = file.parse(edited("12.5", "12.75")).params.acc
    assert acc.bias_counts[0] == 12.75


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[acc]", "[accelerometer]", "there is no accelerometer in params"),
        ("sigma_m_s2", "sigma", "[acc] sigma: there is no such key, only bias_c"),
        ("0.012", '"small"', "[acc] sigma_m_s2: small is not a number"),
        ("0.012", "-1", "[acc] sigma_m_s2: -1.0 is not from 0.0 to 6.5534"),
        ("0.012", "inf", "[acc] sigma_m_s2: is not a number"),
        ("0.012", "true", "[acc] sigma_m_s2: is not a number"),
        ("1.002", "2.5", "[acc] matrix: 2.5 is not from -2.0 to 1.99994"),
        ("[1.002, 0.001,   0.0],", "", "[acc] matrix: needs 3 rows of 3 numbers"),
        ("0.001,   0.0]", "0.001]", "[acc] matrix: needs 3 rows of 3 numbers"),
        ('"positions"', '"luck"', "[acc] method: luck is not one of unknown, guided"),
        ('method = "positions"', "", "[acc] method: is missing"),
        ('method = "positions"', "day = 3", "[acc] day: is not a date"),
        ("[acc]", "acc = 1\n[gyr]", "acc is a table: [acc] on a line of its own"),
        ("[acc]", "[acc]\nparts = 9", "[acc] parts is not from 0 to 8"),
        ("[acc]", "[acc]\nparts = 2", "sigma_m_s2: `parts` ends the record"),
        ("[acc]", "[acc]\ntail = 'x'", "[acc] tail: bytes are pairs of hexadecimal"),
        (
            "[acc]",
            "[unknown]\n5 = ''\n[acc]",
            "5: this record has a table of its own: [op",
        ),
        ("[acc]", "[unknown]\n999 = ''\n[acc]", "a tag is a number from 0 to 255"),
        ("[acc]", "[unknown]\n99 = 'f'\n[acc]", "99: bytes are pairs of hexadecimal"),
        (ID, "stylus", "probe is not 16 hexadecimal digits"),
        (f'"{ID}"', "5", "probe is not 16 hexadecimal digits"),
        ("[acc]", "order = 3\n[acc]", "order is a list of tags"),
        ("[acc]", "[acc", "it is not TOML: "),
        ("[acc]", "a = 1999-02-30\n[acc]", "it is not TOML: "),
        ("[acc]", "a = " + "[" * 5000 + "\n[acc]", "it "),
    ],
)
def test_a_mistake_is_named(old: str, new: str, words: str) -> None:
    with pytest.raises(ParamsError) as caught:
        file.parse(edited(old, new))
    assert words in str(caught.value)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("line", "button_does", "reference"),
    [
        ('button_does = "stroke"', "stroke", "none"),
        ('reference = "heading"', "stream", "heading"),
        ("", "stream", "none"),
    ],
)
def test_options_that_are_left_out_are_as_without_the_record(
    line: str, button_does: str, reference: str
) -> None:
    options = file.parse(f"[options]\n{line}\n").params.options
    assert (options.button_does, options.reference) == (button_does, reference)


@given(
    st.text(max_size=200) | st.binary(max_size=200).map(lambda b: b.decode("latin1"))
)
def test_any_text_is_params_or_an_error(text: str) -> None:
    try:
        file.parse(text)
    except ParamsError as error:
        assert str(error)


def test_a_file_on_disk_is_named_in_what_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "stylus.toml"
    with pytest.raises(FileError, match=r"can't read .*stylus\.toml: No such"):
        file.read(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ParamsError, match=r"stylus\.toml: it is not text"):
        file.read(path)
    path.write_bytes(b"#" * 200_000)
    with pytest.raises(ParamsError, match=r"stylus\.toml: it is too long"):
        file.read(path)
    path.write_text("[hat]\n")
    with pytest.raises(ParamsError, match=r"stylus\.toml: there is no hat in params"):
        file.read(path)
    file.write(path, GOOD, ID)
    assert file.read(path).params == GOOD
    with pytest.raises(FileError, match="can't write"):
        file.write(tmp_path, GOOD, ID)
