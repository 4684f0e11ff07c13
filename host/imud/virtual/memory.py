# SPDX-License-Identifier: MIT
"""The memory of a virtual board: its id, and params, sent as a host would."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

from imud._core import encode_frame
from imud.errors import FileError
from imud.wire import messages, schema
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message
from imud.wire.params import digest_of, words_of

# Device times: the first order, the next, which waits for four bytes of memory, and the
# second request to apply, which waits for the first.
BEGIN_US, WORD_US, APPLY_US = 2_000_000, 60_000, 1_000_000
SECONDS_AFTER = 3.0


def orders_us(records: bytes) -> list[tuple[int, bytes]]:
    """Frames that activate these records, each with its device time in us."""
    digest = digest_of(records)
    orders = [("params_write", words) for words in words_of(records)]
    apply = ("params_apply", (len(records), digest - (digest >> 31 << 32)))
    found = []
    at_us = BEGIN_US
    for number, (command, arguments) in enumerate([*orders, apply, apply]):
        fields = {"command": command, "token": 100 + number, "arguments": arguments}
        content = messages.encode("command", fields, number, 0)
        found.append((at_us, encode_frame(schema.SEED, content)))
        at_us += WORD_US if command == "params_write" else APPLY_US
    return found


def memory_with(
    image: Path,
    simulator: Path,
    records: bytes,
    path: Path,
    seed: int = 1,
    sensor: str = "",
) -> str:
    """Writes to `path` the memory of a virtual board with these records active; returns
    its id. `sensor` is the emulator's name of a sensor other than its usual one.
    FileError if the emulator fails.
    """
    orders = orders_us(records)
    seconds = orders[-1][0] * 1e-6 + SECONDS_AFTER
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "uart.bin"
        words: list[str | Path] = [simulator, "--image", image, "--eeprom", path]
        words += ["--record", record, "--fast", "--seed", str(seed)]
        words += ["--seconds", str(seconds)]
        words += ["--sensor", sensor] if sensor else []
        for at_us, frame in orders:
            words += ["--send", f"{at_us}:{frame.hex()}"]
        done = subprocess.run(
            words, stdin=subprocess.DEVNULL, check=False, capture_output=True
        )
        if done.returncode != 0:
            reason = done.stderr.decode(errors="replace").strip()
            raise FileError(f"can't run {simulator}: {reason}")
        return _id_of(record.read_bytes())


def _id_of(captured: bytes) -> str:
    for content in FrameDecoder().feed(captured):
        message = messages.decode(content)
        if isinstance(message, Message) and message.name == "hello":
            probe_id = message.fields["probe_id"]
            if isinstance(probe_id, bytes):
                return probe_id.hex()
    raise FileError("the virtual board has sent no id; run `make firmware sim`")
