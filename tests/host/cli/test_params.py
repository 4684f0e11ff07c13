# SPDX-License-Identifier: MIT
"""`imud params` with a daemon and a fake probe: shown, saved, loaded, cleared."""

from __future__ import annotations

import contextlib
import json
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from chain import Chain
from configured import running
from fakes import PATIENCE_S
from fakes.params import parts_of
from imud.cli import main
from imud.client import Client
from imud.errors import CommandRefused, ProbeUnknown
from imud.params import file
from imud.params.value import Params, ParamsRecord
from params_bench import GOOD
from streaming import Streaming


@contextlib.contextmanager
def answering(chain: Chain) -> Iterator[None]:
    """The probe answers whatever comes."""
    with Streaming(
        chain.port, chain.probe, 0.002, lambda: chain.port.answers(chain.probe)
    ):
        yield


class Desk:
    """The command line of a user of a daemon."""

    def __init__(self, chain: Chain, capsys: pytest.CaptureFixture[str]) -> None:
        self.chain = chain
        self.probe = chain.probe.name
        self.params = chain.probe.params
        self._capsys = capsys

    def run(self, *words: object, probe: str = "") -> str:
        """Its output; AssertionError with its line on stderr if it fails."""
        where = ["--connect", self.chain.daemon.endpoint]
        command, *rest = map(str, words)
        code = main(["params", command, probe or self.probe, *rest, *where])
        captured = self._capsys.readouterr()
        assert code == (1 if captured.err else 0)
        assert not captured.err, captured.err
        return captured.out

    def fails(self, *words: object, probe: str = "") -> str:
        """Its one line on stderr."""
        with pytest.raises(AssertionError) as caught:
            self.run(*words, probe=probe)
        line = str(caught.value).splitlines()[0]
        assert line.startswith("imud: ")
        return line


@pytest.fixture
def desk(chain: Chain, capsys: pytest.CaptureFixture[str]) -> Iterator[Desk]:
    with answering(chain):
        yield Desk(chain, capsys)


def test_a_probe_without_params_is_shown_as_such(desk: Desk) -> None:
    text = desk.run("show")
    assert text.splitlines()[0] == f"{desk.probe}: params 00000000, 0 bytes"
    assert text.count("not calibrated") == 3
    assert desk.run("history") == f"{desk.probe}: no params were active so far\n"


def test_params_go_to_the_probe_and_back(desk: Desk, tmp_path: Path) -> None:
    mine, theirs = tmp_path / "mine.toml", tmp_path / "theirs.toml"
    mine.write_text(file.written(GOOD, desk.probe))
    text = desk.run("load", mine, "--dry-run")
    assert "acc sigma_m_s2       -       0.012" in text
    assert text.endswith(f"params {GOOD.digest:08x} would replace 00000000\n")
    assert desk.params.records == b""
    text = desk.run("load", mine)
    assert text.splitlines()[0].split() == ["before", "after"]
    assert text.endswith(f"params {GOOD.digest:08x} are active; before: 00000000\n")
    assert desk.params.records == GOOD.encode()
    assert desk.run("load", mine).endswith("are already active\n")
    desk.run("save", theirs)
    assert theirs.read_text() == mine.read_text()
    assert "exists; --force replaces it" in desk.fails("save", theirs)
    desk.run("save", theirs, "--force")
    shown = desk.run("show")
    assert "accelerometer  calibrated on an unknown day, method positions" in shown
    assert "1-sigma error 0.012 m/s2" in shown
    assert "the button: tell" in shown
    printed = json.loads(desk.run("show", "--json"))
    assert printed["bytes"] == GOOD.encode().hex()
    assert printed["records"]["acc"]["method"] == "positions"


def test_what_was_in_force_comes_back_from_the_history(
    desk: Desk, tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(file.written(GOOD))
    desk.run("load", path)
    text = desk.run("clear")
    assert text.endswith(f"params 00000000 are active; before: {GOOD.digest:08x}\n")
    assert desk.params.records == b""
    digest = f"{GOOD.digest:08x}"
    *_, (_, _, _, listed), hint = map(str.split, desk.run("history").splitlines())
    assert listed == digest
    restore = f"imud params load {desk.probe} DIGEST restores one"
    assert hint == restore.split()
    desk.run("load", digest[:5])
    assert desk.params.records == GOOD.encode()
    assert "there are no params" in desk.fails("load", "0bad")
    assert f"{digest}  active" in desk.run("history")


def test_what_the_probe_kept_of_its_own_field_is_shown(desk: Desk) -> None:
    assert "own field" not in desk.run("show")
    probe = desk.chain.probe
    fields = {"own_field": (20.0, -12.5, 6.25), "own_sigma": 2.5}
    probe.hello_fields = probe.hello_fields | fields
    desk.chain.port.write(probe.say("hello"))
    status = desk.chain.status_when(lambda status: status["params"].get("own_field"))
    own = {"field_uT": [20.0, -12.5, 6.25], "sigma_uT": 2.5}
    assert status["params"]["own_field"] == own
    shown = desk.run("show")
    assert "  own field      20.00 -12.50 6.25 uT, kept by the probe, 1-sigma" in shown
    assert "1-sigma error 2.5 uT; imud restart --forget drops it" in shown


def test_errors_are_one_line(desk: Desk, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(file.written(GOOD, "1" * 16))
    assert "load them anyway with --force" in desk.fails("load", path)
    desk.run("load", path, "--force")
    path.write_text(file.written(Params((ParamsRecord(1, bytes(5)),))))
    assert "acc: the record is too short" in desk.fails("load", path)
    assert "No such file" in desk.fails("load", tmp_path / "none.toml")
    assert "can't write" in desk.fails("save", tmp_path / "none" / "x")
    for words in (("show",), ("history",), ("clear",)):
        assert "probe nobody" in desk.fails(*words, probe="nobody")
    desk.params.refusal = (1, 2)
    assert "acc is out of range" in desk.fails("clear")


def test_records_of_other_firmware_are_shown_and_kept(
    desk: Desk, tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(file.written(GOOD.having(ParamsRecord(200, b"later"))))
    assert "record 200 other bytes  -       6c61746572" in desk.run("load", path)
    assert "records of other firmware, kept: 200 (5 bytes)" in desk.run("show")


def test_a_late_client_and_the_status_know_them(chain: Chain) -> None:
    with answering(chain):
        chain.client.change_params(chain.probe.name, GOOD.encode())
        status = chain.status_when(
            lambda status: status["params"]["digest"] == f"{GOOD.digest:08x}"
        )
        assert status["params"] == {
            "digest": f"{GOOD.digest:08x}",
            "is_known": True,
            "acc": {
                "is_calibrated": True,
                "condition": "unknown temperature",
                "sigma_m_s2": 0.012,
                "day": None,
                "method": "positions",
            },
            "gyr": {"is_calibrated": False, "condition": "uncalibrated"},
            "mag": {"is_calibrated": False, "condition": "uncalibrated"},
            "tip": {},
            "options": {"button_does": "tell", "reference": "none"},
            "own_field": None,
            "advice": "gyroscope and magnetometer not calibrated: imud calibrate",
            "done": "calibrated: accelerometer on an unknown day to 0.012 m/s2",
            "flags": [],
        }
        with Client(chain.daemon.endpoint) as late:
            reply = late.params(chain.probe.name)
            assert reply["digest"] == f"{GOOD.digest:08x}"
            assert reply["records"]["options"]["button_does"] == "tell"
            with pytest.raises(ProbeUnknown, match="no probe nobody;"):
                late.params("nobody")
            with pytest.raises(CommandRefused, match="there is no command 'params_wr"):
                late.command(chain.probe.name, "params_write")
            assert late.command(chain.probe.name, "params_tell")["ok"]
    chain.daemon.expect(f"params changed .command., digest {GOOD.digest:08x}")


def test_a_daemon_asks_for_params_that_it_did_not_hear(
    chain: Chain, tmp_path: Path
) -> None:
    chain.probe.params.records = GOOD.encode()
    chain.port.write(chain.probe.say("hello"))
    status = chain.status_when(lambda status: not status["params"]["is_known"])
    assert status["params"]["digest"] == f"{GOOD.digest:08x}"
    with answering(chain):
        chain.status_when(lambda status: status["params"]["is_known"])
    asked = [each["command"] for each in chain.probe.commands]
    assert asked == ["params_tell"]
    (kept,) = (tmp_path / "state/imud/params" / chain.probe.name).iterdir()
    assert file.read(kept).params == GOOD
    assert kept.name.endswith(f"-{GOOD.digest:08x}.toml")


def test_a_probe_with_another_name_has_them_under_it(tmp_path: Path) -> None:
    """The network's sink is another one after such a reload."""
    with running(tmp_path, "# more") as (daemon, probe, port):
        probe.params.records = GOOD.encode()
        port.write(probe.say("hello"))
        for part in parts_of(GOOD.encode()):
            port.write(probe.say("params", **part))
        settings = tmp_path / "imud.toml"
        own = f"[probes.{probe.name}]\nname = 'stylus'"
        settings.write_text(settings.read_text().replace("# more", own))
        daemon.process.send_signal(signal.SIGHUP)
        daemon.expect("reloaded: probes")
        with Client(daemon.endpoint) as client:
            client.wait_for("stylus", seconds=PATIENCE_S)
            reply = client.params("stylus")
            assert (reply["probe"], reply["probe_id"]) == ("stylus", probe.name)
            assert reply["bytes"] == GOOD.encode().hex()
            (entry,) = client.params_history("stylus")["entries"]
            assert entry["digest"] == f"{GOOD.digest:08x}"
            # Its id stays an address.
            assert client.params(probe.name)["bytes"] == reply["bytes"]


def test_a_printed_handle_brings_its_tip_and_leaves_the_rest(
    desk: Desk, tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(file.written(GOOD))
    desk.run("load", path)
    before = Params.decode(desk.params.records)
    text = desk.run("load", "handle-pico")
    after = Params.decode(desk.params.records)
    assert "tip offset_m" in text
    assert (after.acc, after.gyr, after.mag) == (before.acc, before.gyr, before.mag)
    assert after.tip.offset_m == pytest.approx((0.075, 0.0018, 0.0036))
    assert "already active" in desk.run("load", "handle-pico")


def test_a_misspelt_handle_is_answered_with_those_there_are(desk: Desk) -> None:
    assert "only handle-nano, handle-pico" in desk.fails("load", "handle-pcio")
