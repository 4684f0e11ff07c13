# SPDX-License-Identifier: MIT
"""The terminal's display while a probe is wobbled about its tip."""

from __future__ import annotations

from rich.text import Text

from imud.calibration.tip.guide import TipStatus

BAR = 20  # characters
FAR_DEG = 15.0  # a direction in which it leaned so far is covered
# The eight directions as they lie in the picture, row by row; 8 is the middle.
PLACES = (3, 2, 1, 4, 8, 0, 5, 6, 7)


def tip_lines(probe: str, status: TipStatus) -> list[Text]:
    """The screen of the search for the tip."""
    head = Text(f"{probe}  ", style="bold")
    head.append("tip", style="cyan")
    head.append(f"  {status.seconds:.0f} s", style="dim")
    filled = round(BAR * min(1.0, status.seconds / status.of_seconds))
    bar = "█" * filled + "░" * (BAR - filled)
    far = "covered: each direction in which it tilted far enough"
    words = [
        Text(
            status.instruction, style="bold green" if status.phase == "done" else "bold"
        ),
        Text(f"{bar} {'still' if status.is_still else 'moves'}"),
        Text(far, style="dim"),
    ]
    shown = [head]
    for drawn, beside in zip(_compass(status), words, strict=True):
        line = Text("  ")
        line.append_text(drawn)
        line.append("   ")
        line.append_text(beside)
        shown.append(line)
    shown += [Text(""), _error(status), _swing(status)]
    shown.append(Text(status.trouble or "", style="yellow"))
    shown.append(Text("Enter evaluates now; q stops without changes", style="dim"))
    return shown


def _compass(status: TipStatus) -> list[Text]:
    """Three rows of three: the directions around the upright probe."""
    rows = []
    for row in range(3):
        line = Text()
        for place in PLACES[3 * row : 3 * row + 3]:
            is_far = place < len(status.leans_deg) and (
                status.leans_deg[place] >= FAR_DEG
            )
            mark = "+" if place == len(status.leans_deg) else "●" if is_far else "○"
            line.append(f"{mark} ", style="green" if is_far else "dim")
        rows.append(line)
    return rows


def _error(status: TipStatus) -> Text:
    if status.score_m is None:
        return Text("tip     not yet", style="dim")
    style = "green" if status.is_good else "red"
    return Text(f"tip     +-{1000.0 * status.score_m:.1f} mm (95 %)", style=style)


def _swing(status: TipStatus) -> Text:
    if status.swing_deg is None or status.hz is None:
        return Text("")
    how = f"{status.swing_deg:.0f} degrees to each side, at {status.hz:.1f} per second"
    return Text(f"wobble  {how}", style="dim")
