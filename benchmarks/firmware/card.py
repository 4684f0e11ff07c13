# SPDX-License-Identifier: MIT
"""Minutes of logging: the STM32F405's image writes raw and pose of each sample to a
modelled card and sends the same over the wire; both are compared, sample by sample.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

from benchmarks import harness
from benchmarks.common.images import simulated
from benchmarks.harness import Figure, Report, Table
from imud.card.disk import opened
from imud.card.probe_log import find_log
from imud.cli import main as imud
from imud.wire import schema
from imud.wire.frame import FrameDecoder

RATE_HZ = 380
IDS = {message.name: message.id for message in schema.MESSAGES}
SAMPLES = (IDS["raw"], IDS["pose"])
CHUNK = 1 << 20
MINUTES = 10.0
SLACK_S = 3.0  # for the sensor's set-up and a click of the button
# Size of a second on the card: raw and pose with their frames, and a margin.
BYTES_A_SECOND = 48_000


class ItDiffers(Exception):
    """The two logs differ; the message says where."""


@dataclass(slots=True)
class Counts:
    """Messages of one log by type, and the gaps in their sequence numbers."""

    kinds: Counter[int]
    first: int = -1
    last: int = -1
    holes: int = 0

    def take(self, contents: Iterable[bytes]) -> Iterator[bytes]:
        """Count a message; return raw and pose without id and sequence number."""
        for content in contents:
            number = int.from_bytes(content[1:5], "little")
            self.kinds[content[0]] += 1
            if self.first < 0:
                self.first = number
            elif number != self.last + 1:
                self.holes += number - self.last - 1
            self.last = number
            if content[0] in SAMPLES:
                yield bytes([content[0]]) + content[5:]


def of_wire(path: Path) -> Iterator[bytes]:
    decoder = FrameDecoder()
    with path.open("rb") as file:
        while data := file.read(CHUNK):
            yield from decoder.feed(data)


def of_card(path: Path) -> Iterator[bytes]:
    with opened(path) as disk:
        log = find_log(disk)
        (recording,) = log.recordings()
        if recording.bad:
            raise ItDiffers(f"{recording.bad} blocks of the card are torn or worn")
        decoder = FrameDecoder()
        for data in log.frames(recording):
            yield from decoder.feed(data)


def compare(wire: Iterator[bytes], kept: Iterator[bytes]) -> int:
    """Count the messages that both logs have, in order.

    The wire may have more at either end: messages sent before the log began, and the
    last ones, which power-off kept from the card. Raises ItDiffers.
    """
    first = next(kept, None)
    if first is None:
        raise ItDiffers("there is no sample on the card")
    before = 0
    for sent in wire:
        if sent == first:
            break
        before += 1
    else:
        raise ItDiffers("the card's first sample was never sent")
    if before > 2:
        raise ItDiffers(f"{before} raw and poses were sent before the log began")
    count = 1
    for sent, had in zip_longest(wire, kept):
        if had is None:
            return count
        if sent != had:
            raise ItDiffers(f"raw or pose {count} of the log differs from the sent one")
        count += 1
    return count


def run(seconds: float, folder: Path) -> dict[str, Any]:
    """Run the image, compare its two logs and return the figures."""
    image, record, summary = folder / "card.img", folder / "uart", folder / "summary"
    size = 48 + int(seconds * BYTES_A_SECOND) // 2**20
    if imud(["card", "prepare", str(image), "--size", f"{size}M"]):
        raise ItDiffers("no card could be prepared")
    words = [*simulated("f405"), "--stream", "--raw", "--rate", str(RATE_HZ)]
    words += ["--fast", "--card", str(image), "--record", str(record)]
    words += ["--summary", str(summary), "--seconds", str(seconds + SLACK_S)]
    subprocess.run([sys.executable, "-m", "imud", *words], check=True)
    seen = json.loads(summary.read_text())
    sent, kept = Counts(Counter()), Counts(Counter())
    equal = compare(sent.take(of_wire(record)), kept.take(of_card(image)))
    return {
        "seconds": seen["seconds"],
        "data_ready": seen["data_ready"],
        "worked_on": seen["samples"],
        "late": seen["late"],
        "raw_sent": sent.kinds[IDS["raw"]],
        "pose_sent": sent.kinds[IDS["pose"]],
        "raw_logged": kept.kinds[IDS["raw"]],
        "pose_logged": kept.kinds[IDS["pose"]],
        "equal": equal,
        "missing_on_wire": sent.holes,
        "missing_on_card": kept.holes + max(0, kept.first),
        "card_blocks": seen["card_blocks"],
        "card_busy_worst_us": seen["card_busy_worst_us"],
        "card_bad_crc": seen["card_bad_crc"],
        "cut_off": sent.kinds[IDS["raw"]] - kept.kinds[IDS["raw"]],
        "complaints": sum(
            bool(seen[f"{who}_complaint"]) for who in ("firmware", "sensor", "card")
        ),
        "asleep": seen["idle"],
    }


# What the figures may be at most, and how each is named where it is shown.
SHOWN = {
    "raw_sent": ("raw messages sent", None),
    "raw_logged": ("raw messages on the card", None),
    "pose_sent": ("poses sent", None),
    "pose_logged": ("poses on the card", None),
    "equal": ("messages that are equal in each byte", None),
    "cut_off": ("raw messages of the end that are not on the card", RATE_HZ / 2),
    "missing_on_wire": ("messages missing on the wire", 0),
    "missing_on_card": ("messages missing on the card", 0),
    "late": ("samples late", 0),
    "card_bad_crc": ("blocks with a bad CRC", 0),
    "complaints": ("complaints of the modelled chips", 0),
    "card_busy_worst_us": ("longest write of the card, us", None),
}


def report_of(found: dict[str, Any]) -> Report:
    """The figures, and those that the project must reach."""
    columns = {"": "", "10 minutes at 380 Hz": ",d"}
    rows = [(name, found[key]) for key, (name, _) in SHOWN.items()]
    figures = [
        Figure(name, found[key], (0, most), (0, most))
        for key, (name, most) in SHOWN.items()
        if most is not None
    ]
    return Report([Table("log", columns, rows)], figures, found)


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--minutes", type=float, default=MINUTES, help="of logging")


def measured(args: argparse.Namespace) -> Report:
    """Both logs of a run, compared."""
    with tempfile.TemporaryDirectory() as folder:
        return report_of(run(60.0 * args.minutes, Path(folder)))


main = partial(harness.run, "card", __doc__, measured, options)
