# SPDX-License-Identifier: MIT
"""`imud check --turn DEG` at work: it waits for two rests with a turn between them, and
judges the probe's measurement of it.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

from imud.check.evidence import Evidence
from imud.check.rows import RowVerdict, overall
from imud.check.turn import TIMEOUT_S, TurnGuide
from imud.check.turn_rows import rows, timed_out
from imud.cli import check_run, check_source
from imud.cli.calibrate_source import scale_of
from imud.cli.check_screen import CheckScreen
from imud.cli.check_source import LiveMessages
from imud.cli.keyboard import Quit
from imud.errors import DeviceError
from imud.params.value import Params

LATE_S = 5.0  # its own time is that of the samples, which may have stopped


def live(args: argparse.Namespace) -> int:
    """With a probe; returns the exit code: 0 only if each measurement is good."""
    evidence = Evidence(is_live=True)
    with check_source.opened(args, topics=("pose",)) as source:
        screen = CheckScreen(sys.stderr if args.json else sys.stdout, source.title)
        source.begin(evidence)
        guide = _guide(source, evidence, args.turn)
        try:
            with screen.opened():
                _watch(source, guide, screen)
        except Quit:
            sys.stderr.write("imud: stopped; nothing was changed\n")
            return 1
    if guide.found is None:
        table = [timed_out(guide)]
    else:
        table = rows(guide.found, guide.scale, guide.params, args.turn, args.laid)
    check_run.publish(evidence, table, args, source.title)
    return 0 if overall(table) is RowVerdict.GOOD else 1


def _guide(source: LiveMessages, evidence: Evidence, turn_deg: float) -> TurnGuide:
    hello = evidence.hello
    if evidence.other_schema or hello["sensor"] == "none":
        raise DeviceError(f"{source.title} can't measure a turn: imud check shows why")
    scale = scale_of(hello, hello["raw_rate"])
    return TurnGuide(scale, Params.decode(source.params()), turn_deg)


def _watch(source: LiveMessages, guide: TurnGuide, screen: CheckScreen) -> None:
    """Until there are two rests, or one did not come in time."""
    had_first, begin_s = False, time.monotonic()
    for item in source.items():
        if item is not None and item["type"] == "pose":
            guide.on_pose(item)
        elif item is not None and item["type"] == "raw":
            guide.on_sample(check_run.sample_of(item))
        elif item is not None and item["type"] == "event":
            _interrupted(source, item)
        if guide.has_first != had_first:
            had_first, begin_s = guide.has_first, time.monotonic()
        waited_s = time.monotonic() - begin_s
        if guide.found is not None or guide.is_late or waited_s > TIMEOUT_S + LATE_S:
            return
        words = "Lay it against the stop, and let go"
        if had_first:
            words = (
                f"Good. Turn it by {guide.wanted_deg:g} degrees, lay it against the "
                "stop, and let go"
            )
        screen.line(f"{words}.")
        screen.show(f"{words}. q stops", waited_s / TIMEOUT_S)
        screen.key()


def _interrupted(source: LiveMessages, event: dict[str, Any]) -> None:
    if event["event"] in ("restarted", "params_changed"):
        raise DeviceError(
            f"{source.title} restarted or its params changed ({event['event']}); "
            "start again"
        )
