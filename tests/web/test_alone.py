# SPDX-License-Identifier: MIT
"""The page without a daemon, opened as a file: what it reads from a serial port is what
the host decodes, its tasks end well, and it keeps nothing and asks nobody.
"""

from __future__ import annotations

import csv
import json
import math
import tomllib
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser

from demanded import leave_out
from fakes import FakeProbe
from imud import cli
from imud.params.value import Params
from imud.probes import record
from imud.probes.session import Probe, Received, Session
from imud.virtual.boards import PICO as VIRTUAL_PICO
from imud.wire.frame import encode_frame
from imud.wire.messages import HELLO_ID, Message, decode
from imud.wire.params import messages_of
from length import choose
from system.virtual import NANO, PICO, Stub, run, send, write_hand
from web.alone import Alone, alone
from web.served import Served

ROOT = Path(__file__).resolve().parents[2]
CHUNK = 1 << 14
TOPICS = ("pose", "raw", "stroke", "event")
# Of the host's clock, which the page has none of.
TIMES = {"t_ns", "t_bound_us", "age_us", "utc_host", "utc_bound_us"}
MEASURED = {"acc_m_s2": 2e-3, "gyr_rad_s": 2e-5, "mag_uT": 2e-3}
KEEP = """() => {
  globalThis.kept = [];
  globalThis.imud.link.addEventListener("line", ({ detail }) => {
    const isOne = ["pose", "raw", "stroke", "event"].includes(detail.type);
    if (isOne) globalThis.kept.push(detail);
  });
}"""
LEVEL = (1.0, 0.0, 0.0, 0.0)
KEPT = """async () => [localStorage.length, sessionStorage.length, document.cookie,
  (await indexedDB.databases()).length, (await caches?.keys?.())?.length ?? 0]"""


def emulated(stub: Stub) -> Path:
    """What a board sends while a hand moves it and its origin and filter change."""
    seconds = choose(everyday=7, long=600)
    words: list[object] = ["--motion", write_hand(stub.folder / "hand", seconds)]
    words += ["--press", "200000:300000", *stub.raw_too]
    changes = (("tare", 0, 3.5), ("tare", 1, 4.0), ("restart", 0, 5.0), ("tare", 2, 6))
    for token, (command, argument, at_s) in enumerate(changes, start=8):
        order = send(command, argument, token=token)
        words += ["--send", f"{round(at_s * 1e6)}:{order}"]
    return run(stub, seconds, *words).record


def test_an_emulated_nano_is_read_as_the_host_does(
    browser: Browser, boards: Mapping[str, tuple[Path, Path]], tmp_path: Path
) -> None:
    record = emulated(Stub(NANO, *boards["nano"], tmp_path))
    assert_the_same(browser, tmp_path, record)


def test_an_emulated_pico_is_read_as_the_host_does(
    browser: Browser, tmp_path: Path
) -> None:
    simulator, image = ROOT / VIRTUAL_PICO.simulator, ROOT / VIRTUAL_PICO.image
    if not (simulator.exists() and image.exists()):
        leave_out("the virtual Pico is not there")
    assert_the_same(browser, tmp_path, emulated(Stub(PICO, simulator, image, tmp_path)))


def assert_the_same(
    browser: Browser, folder: Path, record: Path
) -> list[dict[str, Any]]:
    """Every message that the host decodes reaches the page, in each bit. Its poses."""
    data = record.read_bytes()
    probe, wanted = decoded(data)
    with alone(browser, folder / "page", "probes") as page:
        page.page.evaluate(KEEP)
        page.connect()
        for at in range(0, len(data), CHUNK):
            page.say(data[at : at + CHUNK])
        page.until("(count) => globalThis.kept.length >= count", len(wanted))
        found = page.page.evaluate("globalThis.kept")
        lost = page.page.evaluate("globalThis.imud.link._all[0].reader.account.lost")
    assert len(found) == len(wanted) > 100
    for is_, should in zip(found, wanted, strict=True):
        assert plain(is_) == plain(should)
        for name, tolerance in MEASURED.items():
            if name in should:
                assert is_[name] == pytest.approx(should[name], abs=tolerance)
    assert lost == probe.account.lost
    return [each for each in found if each["type"] == "pose"]


def decoded(data: bytes) -> tuple[Probe, list[dict[str, Any]]]:
    """What the host makes of these bytes, read frame by frame."""
    probes: dict[str, Probe] = {}
    session = Session(lambda name: probes.setdefault(name, Probe(name)))
    found = []
    for frame in data.split(b"\0"):
        for event in session.receive(frame + b"\0", None):
            if isinstance(event, Received) and event.message.name in TOPICS:
                probe, message = event.probe, event.message
                about = probe.probe_id, event.stamp, event.scales, probe.references
                found.append(record.describe(message, event.content, *about))
    return next(iter(probes.values())), found


def plain(message: Mapping[str, Any]) -> dict[str, Any]:
    """Of its values those that are to be equal, as JSON has them."""
    found = {}
    for name, value in message.items():
        if name in TIMES or name in MEASURED or name == "params_digest":
            continue
        if name == "since_origin" and value is not None and not isinstance(value, dict):
            value = {key: getattr(value, key) for key in value.__struct_fields__}
        found[name] = list(value) if isinstance(value, tuple) else value
    return found


def calibrated(sigma: float) -> bytes:
    """Params of all sensors."""
    params = Params()
    for name, values in (
        ("acc", {"sigma_m_s2": sigma}),
        ("gyr", {"sigma": 0.002}),
        ("mag", {"sigma_uT": 1.2, "norm_uT": 48.0, "dip_deg": 65.0}),
    ):
        matrix = ((1.01, 0.02, 0.0), (0.0, 0.98, 0.0), (0.0, 0.01, 1.0))
        known = {"bias_counts": (12.5, -3.0, 40.0), "matrix": matrix}
        params = params.replaced(name, known | values)
    return params.encode()


def damaged(probe: FakeProbe) -> Iterator[bytes]:
    """A probe that is turned for a minute, with an origin and params of all sensors,
    and with all that can happen on the way.
    """
    yield probe.say("pose")[3:]  # the port is opened in the midst of a frame
    yield probe.say("pose")  # waits for the hello
    chance = np.random.default_rng(5)
    turn, heading = np.zeros(3), 2.0
    tared: tuple[str, ...] = ()
    for count in range(1200):
        probe.time_us = (probe.time_us + 45_000) & 0xFFFFFFFF
        if count in (0, 520):
            # Of others a probe tells later, and meanwhile they are not known.
            probe.params.records = calibrated(0.05 if count else 0.2)
        if count == 500:
            signed = zlib.crc32(calibrated(0.05)) - (1 << 32)
            yield probe.say("event", event="params_changed", detail=signed)
        if count % 20 == 0:
            yield probe.say("hello")
        if count in (0, 520):
            for part in messages_of(probe.params.records):
                yield probe.say("params", **part)
        if count % 200 == 30:
            yield probe.say("event", event="tared", cause="button", detail=count > 600)
            tared = ("tared",)
        if count in (90, 300):
            probe.sequence += count % 7  # messages are lost
            yield b"\x03\x07noise\0"
        if count == 450:
            probe.time_us += 2_000_000  # longer than errors last
        if count == 700:
            probe.restart()
            yield probe.say("hello")
            tared = ()
        turn = turn + chance.normal(0.0, 0.06, 3)
        heading = max(0.3, heading + chance.normal(0.0, 0.1))
        angle = float(np.linalg.norm(turn))
        axis = turn / angle * math.sin(angle / 2)
        odd = ("gap",) if count == 900 else ("starting",) if count == 1100 else ()
        yield probe.say(
            "pose",
            q=(math.cos(angle / 2), *map(float, axis)),
            tilt_sigma=None if count % 97 == 0 else 0.4,
            heading_sigma=None if count % 101 == 0 else heading,
            pose_flags=(*tared, *odd),
        )
        yield probe.say("raw") + probe.say("stroke")


def test_a_damaged_stream_is_read_as_the_host_does(
    browser: Browser, tmp_path: Path
) -> None:
    record, probe = tmp_path / "record.bin", FakeProbe()
    probe.sequence, probe.time_us = (1 << 32) - 2, (1 << 32) - 20_000_000  # wrap
    record.write_bytes(b"".join(damaged(probe)))
    poses = assert_the_same(browser, tmp_path, record)
    errors = [pose["since_origin"] for pose in poses if pose["since_origin"]]
    assert {each["void"] for each in errors} == {None, "pause", "gap", "starting"}
    assert sum(each["heading_sigma_deg"] is not None for each in errors) > 300


DECODE = """async (frames) => {
  const { decode, FrameDecoder } = await import("/usb/frames.js");
  return frames.map((frame) => {
    const [content] = new FrameDecoder().feed(Uint8Array.from(frame));
    return content && (decode(content)?.fields ?? null);
  });
}"""


def test_vectors_and_damaged_contents_are_judged_as_on_the_host(
    browser: Browser, served: Served
) -> None:
    vectors = tomllib.loads((ROOT / "protocol" / "vectors.toml").read_text())
    good = [bytes.fromhex(each["content"]) for each in vectors["good"]]
    contents = [*good]
    chance = np.random.default_rng(7)
    for content in good:
        for _ in range(40):
            other = bytearray(content)
            other[chance.integers(9, len(other))] ^= 1 << int(chance.integers(8))
            contents += [bytes(other), content[: chance.integers(1, len(content))]]
    # Of a hello of another schema the page only needs to know that.
    contents = [each for each in contents if each and each[0] != HELLO_ID]
    page = browser.new_page()
    page.goto(served.page.url)
    found = page.evaluate(DECODE, [[*encode_frame(each)] for each in contents])
    page.close()
    wanted = [decode(each) for each in contents]
    for is_, should in zip(found, wanted, strict=True):
        is_good = isinstance(should, Message) and should.name != "command"
        assert is_ == (in_json(should.fields) if is_good else None)
    assert sum(each is not None for each in found) > 200 < found.count(None)


def in_json(fields: Mapping[str, Any]) -> Any:
    return json.loads(json.dumps({n: record.plain(v) for n, v in fields.items()}))


# What the page asks of the probe ends well, without a daemon.


@pytest.fixture
def page(browser: Browser, tmp_path: Path) -> Iterator[Alone]:
    with alone(browser, tmp_path) as found:
        yield found


POSE = {"q": LEVEL, "tilt_sigma": 0.4, "heading_sigma": 1.8, "pose_flags": ()}


def test_move_origin_aim_stroke_mark_and_csv(page: Alone, tmp_path: Path) -> None:
    probe, seen = FakeProbe(), page.page
    seen.get_by_text("keeps nothing and sends nothing").wait_for()
    page.connect()
    page.play(probe, "Boolean(globalThis.imud.model.probe?.status)", **POSE)
    turned = {**POSE, "q": (math.cos(0.5), 0.0, 0.0, math.sin(0.5))}
    page.play(probe, text_of('[data-value="yaw"]', "57.30"), **turned)
    assert page.text('[data-sigma="yaw"]') == "±1.80°"

    seen.get_by_role("button", name="Set origin", exact=True).first.click()
    page.play(probe, text_of(".toasts", "Set origin: done"), **turned)
    assert probe.commands[-1]["command"] == "tare"
    origin = {**POSE, "pose_flags": ("tared",)}
    seen.get_by_role("link", name="Aim").click()
    seen.fill('[name="hold"]', "0.1")
    seen.get_by_role("button", name="Aim", exact=True).click()
    page.play(probe, "document.querySelector('.aim[data-state=reached]')", **origin)

    seen.get_by_role("link", name="Probe", exact=True).click()
    page.say(probe.say("stroke", path=(0.1, -0.002, 0.0), path_sigma=(0.002, 0.002)))
    page.play(probe, text_of('[data-value="stroke"]', "100.0"), **origin)
    seen.fill('[name="mark-value"]', "0,42")
    seen.get_by_role("button", name="Mark", exact=True).click()
    page.play(probe, text_of(".marks", "0.42"), **origin)

    seen.get_by_role("link", name="Signals").click()
    page.play(probe, "globalThis.imud.view.window?.to > 1e9", **origin)
    with seen.expect_download() as saved:
        seen.get_by_role("button", name="CSV").click()
    saved.value.save_as(tmp_path / "rows.csv")
    text = (tmp_path / "rows.csv").read_text()
    rows = list(csv.DictReader(text.splitlines()))
    assert rows[-1]["yaw_deg"] == "0"
    assert float(rows[-1]["heading_sigma_deg"]) == pytest.approx(1.8)

    seen.get_by_role("link", name="Calibrate").click()
    seen.get_by_text("The daemon guides a calibration").wait_for()
    seen.get_by_role("link", name="Probes", exact=True).click()
    page.play(probe, text_of('[data-part="check"]', "passed"), **origin)
    seen.evaluate("globalThis.port.vanish()")
    seen.get_by_text("unplugged", exact=True).wait_for()
    seen.get_by_role("link", name="Probe", exact=True).click()
    seen.get_by_role("button", name="Undo", exact=True).click()
    seen.get_by_text("the probe is unplugged; plug it in").wait_for()
    assert set(seen.evaluate(KEPT)) <= {0, ""}


def text_of(selector: str, text: str) -> str:
    """JavaScript: whether an element shows that."""
    return f"document.querySelector('{selector}')?.innerText.includes('{text}')"


ASK = """async (url) => {
  const told = [];
  document.addEventListener("securitypolicyviolation", (event) => {
    told.push(event.effectiveDirective);
  });
  await fetch(url).catch(() => {});
  try { new WebSocket(url.replace("http", "ws")); } catch { }
  const picture = new Image();
  const script = document.createElement("script");
  picture.src = script.src = url;
  document.body.append(script);
  while (told.length < 4) await new Promise((resolve) => setTimeout(resolve, 10));
  return told.sort();
}"""


def test_its_policy_lets_it_ask_nobody(page: Alone) -> None:
    told = page.page.evaluate(ASK, "http://127.0.0.1:1/")
    assert told == ["connect-src", "connect-src", "img-src", "script-src-elem"]
    page.complaints.clear()  # of each of them, as of each request that was stopped
    page.elsewhere.clear()


def test_a_port_of_another_baud_rate_is_found(page: Alone) -> None:
    page.connect()
    for _ in range(4):  # bytes of a wrong rate end one stream after the other
        page.page.evaluate("globalThis.port.stumble()")
        page.page.clock.fast_forward(60 * 1000)
    page.until("globalThis.port.baudRate === 921600")
    page.play(FakeProbe(board="f405"), "Boolean(globalThis.imud.model.probe)", **POSE)


def test_a_device_that_is_no_probe_is_left_alone(page: Alone) -> None:
    page.page.evaluate("globalThis.port.isTaken = true")
    page.page.get_by_role("button", name="Connect a probe").click()
    page.page.get_by_text("can't open USB 1a86:7523: end what else uses").wait_for()
    page.page.evaluate("globalThis.port.isTaken = false")
    page.connect()
    for baud in (921600, 500000, 921600):
        page.say(b"ok T:21.3\n\0")
        page.page.clock.fast_forward(60 * 4000)
        page.until(f"globalThis.port.baudRate === {baud}")
    page.page.clock.fast_forward(60 * 4000)
    page.page.get_by_text("No probe was heard on USB 1a86:7523: choose").wait_for()
    assert page.page.evaluate("globalThis.port.readable") is None
    page.connect()
    page.play(FakeProbe(), "Boolean(globalThis.imud.model.probe)", **POSE)


def test_a_probe_may_change_its_port(page: Alone) -> None:
    probe, seen = FakeProbe(), page.page
    streams = "globalThis.imud.model.probe?.status?.state === 'streaming'"
    page.connect()
    page.play(probe, streams, **POSE)
    seen.evaluate("globalThis.port.isFull = true")
    seen.get_by_role("button", name="Set origin", exact=True).first.click()
    seen.clock.fast_forward(60 * 1000)
    seen.evaluate("globalThis.port.vanish()")
    seen.clock.fast_forward(60 * 1000)
    seen.get_by_text("the probe is unplugged; plug it in").wait_for()
    seen.evaluate("globalThis.replug()")
    seen.get_by_role("button", name="Connect another").click()
    page.until("Boolean(globalThis.port.readable)")
    page.play(probe, streams, **POSE)
    seen.get_by_role("button", name="Set origin", exact=True).first.click()
    page.play(probe, text_of(".toasts", "Set origin: done"), **POSE)
    assert seen.evaluate(STATES) == ["streaming"]


STATES = """() => {
  const told = [];
  const { link } = globalThis.imud;
  link.addEventListener("line", ({ detail }) => told.push(detail.state));
  link._tick();
  return told;
}"""


def test_a_probe_of_another_schema_that_is_unplugged_is_told(page: Alone) -> None:
    seen, hello = page.page, FakeProbe(schema_fingerprint=1).content("hello")
    page.connect()
    page.say(encode_frame(hello[:46]))  # a schema that has fewer fields
    seen.get_by_role("link", name="Probes", exact=True).click()
    seen.get_by_text("other firmware").first.wait_for()
    seen.evaluate("globalThis.port.vanish()")
    seen.get_by_text("unplugged", exact=True).wait_for()
    for name in ("Probe", "Aim", "Signals"):
        seen.get_by_role("link", name=name, exact=True).click()
    seen.get_by_role("button", name="CSV").wait_for()


def test_a_page_by_http_says_how_to_read_usb(page: Alone) -> None:
    page.page.evaluate(
        "globalThis.imud.link._serial = undefined;"
        "Object.defineProperty(globalThis, 'isSecureContext', { value: false })"
    )
    page.page.get_by_role("button", name="Connect a probe").click()
    page.page.get_by_text("save this page, and open the file").wait_for()


def test_no_other_page_is_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "index.html").write_text("<html>another</html>")
    assert cli.main(["view", "--to", str(tmp_path)]) == 1
    assert "index.html is another page; choose another fo" in capsys.readouterr().err
    (tmp_path / "index.html").unlink()
    for _ in ("made", "replaced"):
        assert cli.main(["view", "--to", str(tmp_path)]) == 0
