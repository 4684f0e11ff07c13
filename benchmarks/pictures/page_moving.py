# SPDX-License-Identifier: MIT
"""docs/pictures/page-light.webp and page-dark.webp: the view Probe, moving, as the
browser drew it while a simulated hand held a virtual Nano.
"""

from __future__ import annotations

import base64
import io
import sys
from typing import Any

from PIL import Image
from playwright.sync_api import Page

from benchmarks.common.paths import PICTURES
from benchmarks.page.desk import FRAME_MS, chromium, opened, served

SIZE = (920, 520)
SECONDS = 8.0
BYTES_MAX = 1_200_000  # of a file
QUALITIES = (70, 60, 50, 40, 30)

Frame = tuple[float, bytes]  # seconds, PNG


def recorded(page: Page, seconds: float) -> list[Frame]:
    """What the browser draws in that time, frame by frame."""
    session = page.context.new_cdp_session(page)
    frames: list[Frame] = []
    fresh: list[int] = []

    def take(event: dict[str, Any]) -> None:
        data = base64.b64decode(event["data"])
        frames.append((float(event["metadata"]["timestamp"]), data))
        fresh.append(event["sessionId"])

    session.on("Page.screencastFrame", take)
    session.send("Page.startScreencast", {"format": "png"})
    while not frames or frames[-1][0] - frames[0][0] < seconds:
        page.wait_for_timeout(10)
        while fresh:  # the browser sends the next one after that
            session.send("Page.screencastFrameAck", {"sessionId": fresh.pop(0)})
    session.send("Page.stopScreencast")
    return frames


def even(frames: list[Frame], seconds: float) -> list[Image.Image]:
    """The frames at even times: of each, the last one until then."""
    begin_s = frames[0][0]
    found = []
    for number in range(int(1000 * seconds / FRAME_MS)):
        until_s = begin_s + number * FRAME_MS / 1000
        png = [data for time_s, data in frames if time_s <= until_s][-1]
        found.append(Image.open(io.BytesIO(png)).convert("RGB"))
    return found


def packed(pictures: list[Image.Image]) -> bytes:
    """An animated WebP that repeats, of the best quality that is small enough."""
    for quality in QUALITIES:
        file = io.BytesIO()
        pictures[0].save(
            file,
            "WEBP",
            save_all=True,
            append_images=pictures[1:],
            duration=FRAME_MS,
            loop=0,
            quality=quality,
            method=4,
        )
        if file.tell() <= BYTES_MAX:
            return file.getvalue()
    raise ValueError(f"even at quality {QUALITIES[-1]} it is over {BYTES_MAX} bytes")


def main() -> int:
    with served() as (url, _), chromium() as browser:
        for scheme in ("light", "dark"):
            with opened(browser, url, SIZE, is_dark=scheme == "dark") as page:
                page.wait_for_timeout(1000)
                frames = recorded(page, SECONDS)
            path = PICTURES / f"page-{scheme}.webp"
            path.write_bytes(packed(even(frames, SECONDS)))
            print(f"{path.name}: {len(frames)} frames, {path.stat().st_size} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
