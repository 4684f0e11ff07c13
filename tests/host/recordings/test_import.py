# SPDX-License-Identifier: MIT
"""Recordings of others: what is guessed of them is right, what is told holds, and what
comes of it is a log like any other.
"""

from __future__ import annotations

import gzip
import json
import struct
import zipfile
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from foreign_csv import EVEN, lines, motion_with, named
from imud import cli
from imud.errors import FileError
from imud.probes.first_hello import probe_of
from imud.probes.session import Received, Session
from imud.recordings import foreign_log, foreign_text, motions
from imud.recordings.foreign_map import ForeignMap, unit_of
from imud.rotation import FloatArray
from imud.wire.frame import encode_frame
from raw_probe import calibrating, in_si, used

G = 9.80665

Said = pytest.CaptureFixture[str]


@cache
def recording(*, is_long: bool = False) -> tuple[FloatArray, ...]:
    """Time in s, m/s2, rad/s, uT of a module in use, or of one that is calibrated."""
    return in_si(calibrating() if is_long else used(20.0))


def text(path: Path, names: Sequence[str], *columns: FloatArray, by: str = ",") -> Path:
    rows = np.column_stack(columns)
    lines = [by.join(names)] if names else []
    lines += [by.join(f"{value:.9g}" for value in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


T, ACC, GYR, MAG = range(4)


def written(kind: str, folder: Path) -> Path:
    """The recording as others would have it."""
    t, acc, gyr, mag = recording()
    if kind == "units in names":
        names = ["Time(s)", *named("Acc{}(g)", "Gyro{}(deg/s)", "Mag{}(uT)")]
        names = [name.replace("x(", "X(").replace("y(", "Y(") for name in names]
        return text(folder / "a.csv", names, t, acc / G, np.degrees(gyr), mag)
    if kind == "counts":
        counts = np.rint(acc / G * 8192), np.rint(np.degrees(gyr) * 65.5)
        names = ["t", *named("a{}", "g{}", "m{}")]
        return text(folder / "b.tsv", names, 1000.0 * t, *counts, 10.0 * mag, by="\t")
    if kind == "nanoseconds":
        names = ["timestamp", *named("linear_acceleration.{}", "angular_velocity.{}")]
        t_ns = 1e9 * (t + 1000.0)
        return text(folder / "c.csv", names, np.rint(t_ns), acc, gyr, by=";")
    if kind == "npz":
        path = folder / "d.npz"
        np.savez(path, accel=acc, gyro=gyr, mag=1e-6 * mag, time=t)
        return path
    path = folder / "e.parquet"
    six = np.hstack([acc, gyr]).T
    columns = dict(zip(named("acc_{}_m_s2", "gyr_{}_rad_s"), six, strict=True))
    table = {"time": np.rint(1e6 * t).astype("datetime64[us]"), **columns}
    parquet.write_table(pyarrow.table(table), path)
    return path


@pytest.mark.parametrize(
    ("kind", "units"),
    [
        ("units in names", ("s", "g", "deg/s", "uT")),
        ("counts", ("ms", "1/8192 g", "1/65.5 deg/s", "mG")),
        ("nanoseconds", ("ns", "m/s2", "rad/s", None)),
        ("npz", ("s", "m/s2", "rad/s", "T")),
        ("parquet", ("s", "m/s2", "rad/s", None)),
    ],
)
def test_what_is_guessed_is_right(
    kind: str, units: tuple[str | None, ...], tmp_path: Path
) -> None:
    found = foreign_log.read(written(kind, tmp_path))
    t, acc, gyr, mag = recording()
    told = found.told.named
    assert tuple(told.get(name) for name in ("time", "acc", "gyr", "mag")) == units
    assert np.abs(found.acc - acc).max() < 0.01
    assert np.abs(found.gyr - gyr).max() < 0.001
    assert np.abs(found.t_us - found.t_us[0] - 1e6 * (t - t[0])).max() < 300.0
    if units[3] is None:
        assert not found.has_mag
        assert "no magnetometer" in found.words()
    else:
        fresh = np.isfinite(found.mag[:, 0])
        assert np.abs(found.mag[fresh] - mag[fresh]).max() < 0.01


def test_what_comes_out_is_a_log_like_any_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t, acc, gyr, mag = recording(is_long=True)
    names = ["t_s", *named("acc_{}_g", "gyr_{}_dps", "mag_{}_uT")]
    path = text(tmp_path / "a.csv", names, t, acc / G, np.degrees(gyr), mag)
    assert cli.main(["import", str(path)]) == 0
    said = capsys.readouterr().out
    assert "acc  acc_x_g, acc_y_g, acc_z_g: g (guessed)" in said
    log = tmp_path / "a.mcap"
    assert cli.main(["info", str(log), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert info["probes"]
    # Twelve poses of it are a calibration; so are they of the table itself.
    for source in (log, path):
        words = ["calibrate", "--from", str(source), "--dry-run"]
        assert cli.main(words) == 0
        assert "calibrated from" in capsys.readouterr().out
    assert cli.main(["export", str(log), "--out", str(tmp_path / "tables")]) == 0
    # It is not written over.
    assert cli.main(["import", str(path)]) == 1
    assert "already exists" in capsys.readouterr().err


def test_axes_and_units_are_as_told(tmp_path: Path) -> None:
    t, acc, gyr, mag = recording()
    turned = acc[:, [1, 0, 2]] * [1.0, -1.0, 1.0]
    names = ["when", *"abcdefghi"]
    path = text(tmp_path / "a.csv", names, t, turned / 0.004, gyr, mag)
    told = ForeignMap(
        columns={
            "acc": ("a", "b", "c"),
            "gyr": ("d", "e", "f"),
            "mag": ("g", "h", "i"),
            "time": ("when",),
        },
        units={"acc": unit_of("acc", "0.004m/s2")},
        axes={"acc": "y,-x,z"},
    )
    found = foreign_log.read(path, told)
    assert np.abs(found.acc - acc).max() < 1e-4
    assert found.told.named["gyr"] == "rad/s"


def test_gaps_repeats_and_holes_stay_what_they_are(tmp_path: Path) -> None:
    t, acc, gyr, mag = (np.array(each[:1200]) for each in recording())
    mag = mag[np.arange(len(t)) // 5 * 5]  # a fifth as fast
    acc[700] = np.nan
    t[900:] += 2.0
    t[1100] = t[1000]
    names = ["time", *named("a{}", "w{}", "m{}")]
    path = text(tmp_path / "a.csv", names, t, acc, gyr, mag)
    path.write_text(path.read_text().replace("nan", ""))
    found = foreign_log.read(path)
    assert found.counts.left_out == 2
    assert len(found.t_us) == 1198
    assert np.isfinite(found.mag[:, 0]).mean() == pytest.approx(0.2, abs=0.02)
    assert "1 gaps, 2 rows left out" in found.words()
    # A virtual probe is moved by the longest part without a gap.
    moved = motions.load(path)
    assert moved.filled == 1
    assert moved.left_out_s == pytest.approx(3.0, abs=0.3)


def test_a_bag_of_ros_is_read(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    vector, quat = (
        types["geometry_msgs/msg/Vector3"],
        types["geometry_msgs/msg/Quaternion"],
    )
    t, acc, gyr, mag = (each[:500] for each in recording())
    path = tmp_path / "bag"
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        kinds = ("sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField")
        imu, field = (
            writer.add_connection(topic, kind, typestore=store)
            for topic, kind in zip(("/imu/data_raw", "/imu/mag"), kinds, strict=True)
        )
        for at, t_s in enumerate(t):
            t_ns = round(1e9 * (t_s + 100.0))
            head = header(stamp(t_ns // 10**9, t_ns % 10**9), "imu")
            none = np.zeros(9)
            message = types[kinds[0]](
                head,
                quat(0, 0, 0, 1),
                none,
                vector(*gyr[at]),
                none,
                vector(*acc[at]),
                none,
            )
            raw = store.serialize_cdr(message, kinds[0])
            writer.write(imu, t_ns, raw)
            if at % 2 == 0:
                reading = types[kinds[1]](head, vector(*(1e-6 * mag[at])), none)
                writer.write(field, t_ns, store.serialize_cdr(reading, kinds[1]))
    with Writer(tmp_path / "other", version=9) as writer:
        for topic in ("/field", "/other_field"):
            writer.add_connection(topic, kinds[1], typestore=store)
    with pytest.raises(FileError, match=r"--topic: /field, /other_field"):
        foreign_log.read(tmp_path / "other")
    with pytest.raises(FileError, match=r"no topic /fields: /field, /other_field"):
        foreign_log.read(tmp_path / "other", ForeignMap(topics=("/fields",)))
    with pytest.raises(FileError, match=r"no topic of .*Imu; it has /field"):
        foreign_log.read(tmp_path / "other", ForeignMap(topics=("/field",)))
    (alone,) = path.glob("*.db3")
    found = foreign_log.read(alone)
    assert np.abs(found.acc - acc).max() < 1e-9
    assert np.abs(found.gyr - gyr).max() < 1e-9
    assert np.isfinite(found.mag[:, 0]).sum() == 250
    assert np.abs(found.mag[::2] - mag[::2]).max() < 1e-9


HEAD = "t,ax,ay,az,gx,gy,gz"
ROW = "0.01,0,0,9.8,0,0,0"
NAMED = "time_s,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
ROWS = [f"{n / 100},0,{n / 100},1,0.5,0,-0.25" for n in range(100)]


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("", "holds no numbers"),
        (lines("t,ax,ay,az", "1,2,3,4"), "no columns found for gyr"),
        (lines("ax,ay,az,gx,gy,gz", "1,2,3,4,5,6"), "no column of time found"),
        (
            lines(NAMED, *ROWS[:30], "0.3,0,0", "0.31,0,0,x,0,0,0"),
            "2 rows left out (line 32: 3 columns, not 7) of 32",
        ),
        (
            lines(NAMED, *ROWS[:30], "0.31,0,0,x,0,0,0", ROWS[32], ",,"),
            "(line 32: 'x' is not a number) of 33",
        ),
        (lines(HEAD, *[ROW] * 9), "unknown unit of t, with steps of 0"),
        (lines("t,l_ax,l_ay,l_az,r_ax,r_ay,r_az", ROW), "fit acc: l_ax, r_ax"),
        (
            lines(HEAD, *(f"{2 * n},0,0,77,0,0,1" for n in range(99))),
            "unknown unit of ax, ay",
        ),
        (
            lines(HEAD, *(f"{2 * n},0,0,9.8,0,0,1" for n in range(99))),
            "unknown unit of gx, gy",
        ),
        ("x" * 70000, "longer than 65536 characters"),
    ],
)
def test_what_cannot_be_read_says_what_to_tell(
    content: str, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(content)
    assert cli.main(["import", str(path)]) == 1
    line = capsys.readouterr().err
    assert why in line
    assert line.count("\n") == 1


def test_of_several_devices_one_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # What two devices wrote in turns, one of them upside down, and packed.
    both = [f"{name},{row}" for row in ROWS for name in ("7", "left")]
    both[1::2] = [row.replace(",1,", ",-1,") for row in both[1::2]]
    packed = tmp_path / "a.csv.gz"
    with gzip.open(packed, "wt") as file:
        file.write(lines(f"device,{NAMED}", *both))
    for value, force in (("left", -G), ("7.0", G)):
        words = ["import", str(packed), "--only", f"device={value}", "--to"]
        assert cli.main([*words, str(tmp_path / f"{value}.mcap")]) == 0
        found = foreign_log.read(packed, ForeignMap(only={"device": value}))
        assert len(found.t_us) == len(ROWS)
        assert found.acc[:, 2] == pytest.approx(force)
    capsys.readouterr()
    for words, why in (
        (["device=right"], "fits no row; there are 7, left"),
        (["name=left"], "has no column name: device, time_s"),
        (["left"], "write a column, then ="),
    ):
        assert cli.main(["import", str(packed), "--only", *words]) == 1
        assert why in capsys.readouterr().err
    arrays = tmp_path / "b.npz"
    rows = np.array([[float(cell) for cell in row.split(",")] for row in ROWS])
    names = NAMED.split(",")
    np.savez(arrays, **dict(zip(names, rows.T, strict=True)), part=np.arange(100) // 50)
    found = foreign_log.read(arrays, ForeignMap(only={"part": "1"}))
    assert found.acc[:, 1] == pytest.approx(rows[50:, 2] * G, abs=1e-6)
    with pytest.raises(FileError, match="--only fits no row"):
        foreign_log.read(arrays, ForeignMap(only={"part": "2"}))


def test_a_packed_file_is_whole_and_not_too_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed = gzip.compress(lines(NAMED, *ROWS).encode())
    path = tmp_path / "a.csv.gz"
    path.write_bytes(packed[:-20])
    with pytest.raises(FileError, match=r"not a whole .gz"):
        foreign_log.read(path)
    path.write_bytes(packed)
    assert len(foreign_log.read(path).t_us) == len(ROWS)
    monkeypatch.setattr(foreign_text, "UNPACKED_MAX", -13 * len(packed))
    with pytest.raises(FileError, match="unpacks to too much"):
        foreign_log.read(path)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--map", "acc=ax,ay"], "needs 3, not 2 columns"),
        (["--map", "foo=ax"], "write acc or gyr or mag or time"),
        (["--map", "acc=ax,ay,q"], "no column q"),
        (["--unit", "acc=parsec"], "no unit 'parsec'"),
        (["--axes", "gyr=x,x,z"], "axes are three like x,-z,y"),
    ],
)
def test_what_is_told_wrongly_is_refused(
    words: list[str], why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written("counts", tmp_path)
    assert cli.main(["import", str(path), *words]) == 1
    assert why in capsys.readouterr().err


@pytest.mark.parametrize("name", ["a.npz", "a.parquet", "a.bag"])
def test_a_file_that_is_none_of_its_kind(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(b"nothing of the kind" * 20)
    with pytest.raises(FileError, match=name):
        foreign_log.read(path)


def test_a_gyroscope_whose_axes_are_wrong_is_not_believed(tmp_path: Path) -> None:
    t, acc, gyr, _ = recording()
    names = ["t", *named("a{}", "w{}")]
    path = text(tmp_path / "a.csv", names, t, acc, gyr[:, [1, 2, 0]])
    with pytest.raises(FileError, match="gravity does not rotate with them"):
        foreign_log.read(path)


def with_commas(row: str) -> str:
    return row.replace(",", ";").replace(".", ",")


UNITS = "s,g,g,g,dps,dps,dps"
BARE = "time,ax,ay,az,gx,gy,gz"


@pytest.mark.parametrize(
    ("rows", "encoding"),
    [
        ([NAMED, *ROWS], "utf-8-sig"),
        ([NAMED, *ROWS], "utf-16"),
        ([NAMED.replace("acc", "für_acc"), *ROWS], "latin-1"),
        ([with_commas(row) for row in [NAMED, *ROWS]], "utf-8"),
        ([with_commas(row).replace(";", "\t") for row in [NAMED, *ROWS]], "utf-8"),
        ([f'"{with_commas(r)}"'.replace(";", '","') for r in [NAMED, *ROWS]], "utf-8"),
        ([row.replace(",", "|") for row in [NAMED, *ROWS]], "utf-8"),
        ([row.replace(",", " ") for row in [f"# {NAMED}", *ROWS]], "utf-8"),
        ([BARE, UNITS, *ROWS], "utf-8"),
        (["t,acc_g,acc_g,acc_g,gyr,gyr,gyr", "s,x,y,z,x dps,y,z", *ROWS], "utf-8"),
        ([NAMED, *[f"{row}," for row in ROWS]], "utf-8"),
        ([f"{NAMED},label", *[f"{row},walking" for row in ROWS]], "utf-8"),
        ([f"{NAMED},empty", *[f"{row},NA" for row in ROWS]], "utf-8"),
        ([f"{NAMED},mag_x,mag_y,mag_z", *[f"{row},null,," for row in ROWS]], "utf-8"),
        ([NAMED, *ROWS[:50], "# pressed", NAMED, "", *ROWS[50:]], "utf-8"),
        ([NAMED, *ROWS, "1.00,0,0.5", "\0" * 70000], "utf-8"),
        ([NAMED, *[f"2026-02-28T23:59:{59 + n / 100:05.2f}Z,{r.split(',', 1)[1]}"
                   for n, r in enumerate(ROWS)]], "utf-8"),
        ([NAMED.replace("time_s", "t"), *[f"10:59:{n / 100:05.2f},{r.split(',', 1)[1]}"
                   for n, r in enumerate(ROWS)]], "utf-8"),
    ],
)  # fmt: skip
def test_each_form_of_a_table_has_the_same_rows(
    rows: list[str], encoding: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    for shift in range(0, 64, 8):  # wherever a block of the file ends
        path.write_text(lines(f"# {'x' * shift}", *rows), encoding)
        found = foreign_log.read(path)
        assert len(found.t_us) == 100
        assert np.abs(np.diff(found.t_us) - 10000).max() <= 1
        assert found.acc[50] == pytest.approx([0.0, 0.5 * G, G])
        assert found.gyr[50] == pytest.approx(np.radians([0.5, 0.0, -0.25]))
    if len(rows) > 102 and "\0" in rows[-1]:
        assert "1 row left out (line 103: 3 columns, not 7)" in found.words()
    if "label" in rows[0]:
        assert "without columns label" in found.words()


def test_a_small_parquet_of_long_texts_and_lists_takes_no_memory(
    tmp_path: Path,
) -> None:
    t, acc, gyr, _ = recording()
    text = pyarrow.DictionaryArray.from_arrays(
        pyarrow.array(np.zeros(len(t), dtype=np.int32)),
        pyarrow.array(["x" * 1_000_000]),
    )
    table = {
        "time": pyarrow.array(np.rint(1e6 * t).astype("timedelta64[us]")),
        "acc_m_s2": pyarrow.array(acc.tolist()),
        "gyr_rad_s": pyarrow.array(gyr.tolist()),
        "note": text,
    }
    path = tmp_path / "a.parquet"
    parquet.write_table(pyarrow.table(table), path, store_schema=False)
    found = foreign_log.read(path)
    assert found.texts == ("note",)
    assert np.abs(found.gyr - gyr).max() < 1e-9
    del table["note"]
    table["acc_m_s2"] = pyarrow.array([[0.0] * 5000] * len(t))
    parquet.write_table(pyarrow.table(table), path, store_schema=False)
    with pytest.raises(FileError, match="takes too much memory"):
        foreign_log.read(path)


def test_what_gravity_contradicts_is_refused_unless_told(tmp_path: Path) -> None:
    path = motion_with(tmp_path / "a.csv", EVEN, scale=G)  # m/s2, called g
    with pytest.raises(FileError, match="where gravity is 9"):
        foreign_log.read(path)
    told = ForeignMap(units={"acc": unit_of("acc", "m/s2")})
    assert foreign_log.read(path, told).rate_hz == pytest.approx(100.0)
    path.write_text(path.read_text().replace("rad_s", "dps"))
    told = ForeignMap(units={"acc": 1.0})
    with pytest.raises(
        FileError, match=r"gravity rotates 6\d times .* or --unit gyr=UNIT"
    ):
        foreign_log.read(path, told)


def test_a_spike_is_clipped_and_a_pause_keeps_its_length(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = motion_with(tmp_path / "a.csv", np.where(EVEN < 15.0, EVEN, EVEN + 5000.0))
    words = path.read_text().splitlines()
    words[1000] = ",".join([words[1000].split(",")[0], "-98000", *["0"] * 5])
    path.write_text(lines(*words))
    assert cli.main(["import", str(path)]) == 0
    assert "100.0 Hz, 1 gaps, 1 of acc clipped" in capsys.readouterr().out
    assert cli.main(["decode", "--json", str(tmp_path / "a.mcap")]) == 0
    said = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    raw = [each for each in said if each["type"] == "raw"]
    assert len(raw) == 3000
    assert [at for at, each in enumerate(raw) if each["flags"]] == [999]
    assert raw[-1]["t_device_us"] == 1000 + 29_990_000 + 5_000_000_000


@pytest.mark.parametrize("limit", [1.7, -0.9, None])
def test_a_sensor_that_stands_at_its_limit_is_flagged(
    limit: float | None, tmp_path: Path
) -> None:
    path = motion_with(tmp_path / "a.csv", EVEN)
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    rows[:, 4] += np.random.default_rng(3).normal(0.0, 0.01, len(rows))
    rows[:, 4] -= 0.95 * (limit is not None and limit < 0.0)
    beyond = np.zeros(len(rows), bool)
    if limit is not None:
        beyond = rows[:, 4] * np.sign(limit) > abs(limit)
        rows[beyond, 4] = limit
    text(path, ["time", *named("acc_{}_g", "gyr_{}_rad_s")], rows)
    found = foreign_log.read(path, ForeignMap(units={"gyr": 1.0}))
    assert (f"{beyond.sum()} of gyr clipped" in found.words()) == bool(beyond.any())
    hello = foreign_log.hello_of(found, bytes(8))
    contents = foreign_log.contents(found, hello, 0)
    frames = b"".join(encode_frame(content) for _, content in contents)
    events = Session(partial(probe_of, {})).receive(frames + b"\0", None)
    flagged = [
        "gyr_clipped" in each.message.fields["sample_flags"]
        for each in events
        if isinstance(each, Received) and each.message.name == "raw"
    ]
    assert flagged == beyond.tolist()


@pytest.mark.parametrize(
    ("length", "why"), [(9000, "is not one"), (60 << 20, "is too long")]
)
def test_the_head_of_an_array_is_short_and_a_head(
    length: int, why: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.npz"
    head = b"\x93NUMPY\2\0" + struct.pack("<I", length)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("time.npy", head + (b"{'descr': " + b"(" * 4000).ljust(length))
    with pytest.raises(FileError, match=why):
        foreign_log.read(path)


def test_a_bag_whose_description_is_deep_is_refused(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("[" * 20000)
    with pytest.raises(FileError, match="is not a readable bag"):
        foreign_log.read(tmp_path)
