# SPDX-License-Identifier: MIT
"""The page for a user who looks away: a sound, words, and a file."""

from __future__ import annotations

import re
from pathlib import Path

from web.desk import Desk, Seen

# Counts the notes that are played.
COUNT_NOTES = """() => {
  globalThis.notes = [];
  const { createOscillator } = AudioContext.prototype;
  AudioContext.prototype.createOscillator = function () {
    const tone = createOscillator.call(this);
    const { start } = tone;
    tone.start = (at) => { notes.push(tone.frequency.value); start.call(tone, at); };
    return tone;
  };
}"""


def test_a_sound_tells_that_poses_stop_and_come_again(shown: Seen, desk: Desk) -> None:
    page = shown.page
    page.evaluate(COUNT_NOTES)
    desk.hand.is_talking = False
    shown.until("performance.now() - imud.model.probe.poseMs > 700")
    assert page.evaluate("notes") == []  # nobody has asked for it
    desk.hand.is_talking = True
    shown.until("performance.now() - imud.model.probe.poseMs < 200")
    page.get_by_text("Name, log, sound, rates, reset").click()
    page.get_by_label("sound when its poses stop").check()
    desk.hand.is_talking = False
    # A busy machine may have paused the poses before.
    shown.until("notes.slice(-2).join() === '440,330'")
    desk.hand.is_talking = True
    shown.until("notes.slice(-2).join() === '330,440'")
    assert page.evaluate("notes.slice(-4)") == [440, 330, 330, 440]
    page.get_by_label("sound when its poses stop").uncheck()


def test_the_picture_is_there_in_words_and_as_a_file(
    shown: Seen, desk: Desk, tmp_path: Path
) -> None:
    desk.hand.turn((0.0, 0.0, 0.0, 1.0))
    picture = shown.page.get_by_role("img", name=re.compile("yaw .?180"))
    picture.wait_for()
    assert desk.probe.name in str(picture.get_attribute("aria-label"))
    with shown.page.expect_download() as saving:
        shown.page.get_by_role("button", name="Save picture").click()
    path = tmp_path / "picture.png"
    saving.value.save_as(path)
    data = path.read_bytes()
    assert data.startswith(b"\x89PNG")
    assert len(data) > 5000  # not an empty canvas
