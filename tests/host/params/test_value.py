# SPDX-License-Identifier: MIT
"""Params as a value: any list of records comes back byte by byte, and what the firmware
refuses is refused with one line."""

from __future__ import annotations

import datetime
import json

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import native
from fakes.params import parts_of
from imud.errors import ParamsError
from imud.params.parts import KINDS, NAMES
from imud.params.value import ROOM, SENSORS, Options, Params, ParamsRecord
from imud.wire.messages import Message
from imud.wire.params import ParamsParts, digest_of, words_of
from params_bench import GOOD, RECORDS, SOUND

ffi, lib = native.load()

# What the firmware reads records by.
READ = dict(ffi.typeof("struct memory").fields)["read"].type

IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


@given(RECORDS)
def test_any_list_of_records_comes_back(params: Params) -> None:
    records = params.encode()
    assert Params.decode(records) == params
    assert params.digest == digest_of(records)


@given(st.binary(max_size=40))
def test_bytes_are_a_list_of_records_or_an_error(data: bytes) -> None:
    try:
        params = Params.decode(data)
    except ParamsError as error:
        assert str(error)
    else:
        assert params.encode() == data


@given(RECORDS)
def test_every_value_can_be_told(params: Params) -> None:
    described = json.loads(json.dumps(params.described()))
    assert described.keys() == {*NAMES, "unknown"}
    assert params.options.button_does is not None
    for name in SENSORS:
        wire = params.wire(name)
        is_told = wire is not None and "matrix" in wire
        assert (params.calibration(name) is not None) == is_told


@given(RECORDS | SOUND)
@example(GOOD)
def test_what_the_firmware_refuses_is_refused(params: Params) -> None:
    """A tip it does not look at, and it has room for so many bytes."""
    records = ffi.from_buffer(params.encode() or b"\0")

    @ffi.callback(READ)
    def read(_: object, at: int) -> int:
        return int(records[at][0])

    size = len(params.encode())
    memory = ffi.new("struct memory *", {"read": read})
    out, tag = ffi.new("struct params *"), ffi.new("uint8_t *")
    if size > ROOM:
        assert params.faults()
        return
    fault = lib.params_read(memory, 0, size, out, tag)
    ours = params.without("tip").faults()
    assert bool(ours) == (fault != 0), ours
    if fault:
        assert any(line.startswith(KINDS[tag[0]].name) for line in ours)


def test_there_is_as_much_room_as_in_the_firmware() -> None:
    assert lib.PARAMS_ROOM == ROOM


def test_values_are_in_plain_units() -> None:
    params = Params().replaced(
        "mag",
        {
            "bias_counts": [1.5, -2, 0],
            "matrix": IDENTITY,
            "sigma_uT": 0.4,
            "temperature_c": -7.25,
            "day": datetime.date(2026, 11, 22),
            "method": "wave",
            "dip_deg": 64.2,
            "lag_s": 0.00123,
        },
    )
    mag = params.mag
    assert mag.bias_counts == (1.5, -2.0, 0.0)
    assert mag.matrix[1] == (0.0, 1.0, 0.0)
    assert (mag.sigma, mag.residual, mag.temperature_c) == (0.4, None, -7.25)
    assert (mag.day, mag.method) == (datetime.date(2026, 11, 22), "wave")
    assert (mag.norm_ut, mag.dip_deg, mag.lag_s) == (None, 64.2, 0.00123)
    wire = params.wire("mag")
    assert wire["bias"] == (24576, -32768, 0)
    assert (wire["sigma"], wire["residual"]) == ((40,), (65535,))
    assert (wire["day"], wire["method"], wire["lag"]) == ((9822,), (4,), (1230,))
    assert params.acc is None
    assert params.gyr is None
    assert params.tip is None


def test_a_tip_and_options() -> None:
    params = Params().replaced("tip", {"offset_m": [0, 0, -0.142], "method": "dimple"})
    assert params.tip.offset_m == (0.0, 0.0, -0.142)
    assert params.tip.axis is None
    assert params.options == Options()
    assert params.replaced("options", {"reference": "full"}).options.reference == "full"


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("acc", {"matrix": IDENTITY}, "acc: bias_counts is missing"),
        ("acc", {"bias_counts": [1, 2]}, "acc: bias_counts needs 3 numbers"),
        ("acc", {"bias_counts": [0, 0, 1e9]}, "bias_counts 1000000000.0 is not from"),
        ("acc", {"bias_counts": [0, 0, float("nan")]}, "bias_counts is not numbers"),
        ("acc", {"bias_counts": [0, 0, -1e12]}, "bias_counts is not numbers"),
        ("acc", {"bias_counts": [0, 0, 1e12]}, "bias_counts is not numbers"),
        ("tip", {"offset_m": "far"}, "tip: offset_m is not numbers"),
        ("tip", {"day": "today"}, "tip: day is not a date, such as 2026-11-22"),
        ("tip", {"day": datetime.date(1999, 12, 31)}, "1999-12-31 is not from 2000-01"),
        ("tip", {"method": "luck"}, "tip: method is not one of unknown, guided"),
        ("tip", {"sigma_m": -1}, "tip: sigma_m -1.0 is not from 0.0 to 0.65534"),
        ("tip", {"sigma": 1}, "tip has no sigma, only offset_m"),
        ("hat", {}, "there is no record 'hat', only acc, gyr"),
    ],
)
def test_a_value_that_can_t_be_is_named(
    name: str, values: dict[str, object], words: str
) -> None:
    with pytest.raises(ParamsError, match=words.replace(".", r"\.")):
        Params().replaced(name, values)


def tip(**values: object) -> Params:
    return Params().replaced("tip", values)


def body(size: int) -> Params:
    return Params((ParamsRecord(1, bytes(size)),))


@pytest.mark.parametrize(
    ("params", "fault"),
    [
        (GOOD, None),
        (Params(), None),
        (tip(offset_m=[2, 0, 0]), None),
        (tip(offset_m=[2, 0, 0.01]), "tip: the offset is 2.000 m long, more than 2 m"),
        (tip(axis=[0.6, 0.8, 0]), None),
        (tip(axis=[0.6, 0.8, 0.1]), "tip: the axis has the length 1.0050, not 1"),
        (body(29), "acc: the record is too short for a calibration"),
        (body(30), None),
        (
            Params((ParamsRecord(4, b"\0\0\0\x80" + bytes(19)),)),
            "tip: the offset is only partly known",
        ),
        (
            Params((ParamsRecord(5, b"\3\0"),)),
            "options: button_does 3 is not stream, tell, stroke",
        ),
        (Params((ParamsRecord(5, b"\0"),)), "options: reference is missing"),
    ],
)
def test_a_fault_is_one_line(params: Params, fault: str | None) -> None:
    assert next(iter(params.faults()), None) == fault
    if fault is not None:
        with pytest.raises(ParamsError):
            params.check()


def test_a_record_takes_the_place_of_the_one_before() -> None:
    other = GOOD.having(ParamsRecord(1, b"x")).having(ParamsRecord(200, b"y"))
    assert [record.tag for record in other.records] == [1, 5, 200]
    assert other.without("acc").unknown == {200: b"y"}


def message_of_part(fields: dict[str, object]) -> Message:
    return Message("params", 0, 0, fields)  # type: ignore[arg-type]


@given(RECORDS, st.randoms(use_true_random=False))
def test_parts_make_a_whole_in_any_order(params: Params, chance: object) -> None:
    records, heard = params.encode(), ParamsParts()
    fields = list(parts_of(records))
    chance.shuffle(fields)  # type: ignore[attr-defined]
    found = [heard.add_part(message_of_part(each)) for each in [*fields, fields[0]]]
    *first, last = found[:-1] or [0]
    assert not any(first)
    assert last == (params.digest or None)
    assert heard.get(params.digest) == records


def test_parts_of_a_damaged_set_are_forgotten() -> None:
    heard = ParamsParts()
    for fields in parts_of(GOOD.encode()):
        heard.add_part(message_of_part(fields | {"part": bytes(28)}))
    assert heard.get(GOOD.digest) is None
    assert [heard.add_part(message_of_part(each)) for each in parts_of(GOOD.encode())][
        -1
    ]


def test_few_sets_are_kept_and_the_one_in_use_among_them() -> None:
    heard = ParamsParts()
    heard.add_whole(GOOD.encode())
    for number in range(100):
        heard.add_whole(bytes([number + 1, 0]))
        assert heard.get(GOOD.digest) == GOOD.encode()
    assert heard.get(digest_of(bytes([1, 0]))) is None


@given(RECORDS)
def test_words_bring_all_bytes(params: Params) -> None:
    memory = bytearray(2048)
    for at, word in words_of(params.encode()):
        memory[at : at + 4] = word.to_bytes(4, "little", signed=True)
    assert memory.startswith(params.encode())


@pytest.mark.parametrize(
    ("norm_ut", "dip_deg", "north_ut", "up_ut"),
    [(48.2, 66.1, 19.5, -44.0), (42.0, -30.0, 36.25, 21.0), (None, 66.0, None, None)],
)
def test_the_field_to_the_north_and_up_follows_from_norm_and_dip(
    norm_ut: float | None,
    dip_deg: float,
    north_ut: float | None,
    up_ut: float | None,
) -> None:
    """Whatever was said of it, as in a file whose dip was edited."""
    values = {
        "bias_counts": [0, 0, 0],
        "matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "norm_uT": norm_ut,
        "dip_deg": dip_deg,
        "north_uT": 1.0,
        "up_uT": 2.0,
    }
    plain = Params().replaced("mag", values).plain("mag")
    assert (plain["north_uT"], plain["up_uT"]) == (north_ut, up_ut)


def test_a_name_is_its_letters_with_zeros_behind_them() -> None:
    params = Params().replaced("name", {"text": "häp"})
    assert params.encode() == bytes.fromhex("061868c3a470" + 20 * "00")
    assert Params.decode(params.encode()).name == "häp"


def test_noise_is_two_densities() -> None:
    noise = {"acc_m_s2_rthz": 0.003, "gyr_rad_s_rthz": 1.2e-4}
    params = Params().replaced("noise", noise)
    assert params.encode() == bytes.fromhex("0804b80bb004")  # vectors.toml has it, too
    assert Params.decode(params.encode()).plain("noise") == pytest.approx(noise)
