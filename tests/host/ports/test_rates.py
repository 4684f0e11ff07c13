# SPDX-License-Identifier: MIT
"""Which rate is listened at: what was heard decides, and what proved right before."""

from __future__ import annotations

from imud.ports.baud import DWELL_S, QUIET_S, SETTLE_S, Memory, Sound, Trial, TrialStep
from imud.probes.session import NOISE_BYTES

RATES = (500_000, 921_600, 115_200)
NOISE = Sound(bytes=NOISE_BYTES + 1)


def test_garbage_moves_on_at_once_and_a_round_of_it_is_counted() -> None:
    trial = Trial(RATES, 0.0)
    assert trial.judge(NOISE, SETTLE_S) is TrialStep.STAY
    assert trial.judge(NOISE, 0.06) is TrialStep.NEXT
    assert trial.rate == 921_600
    assert trial.judge(NOISE, 0.12) is TrialStep.NEXT
    assert trial.judge(NOISE, 0.18) is TrialStep.OVER
    assert (trial.rate, trial.noise) == (500_000, 3 * NOISE.bytes)
    assert trial.judge(NOISE, 0.24) is TrialStep.NEXT


def test_as_much_noise_as_the_rest_of_a_frame_is_given_its_time() -> None:
    trial = Trial(RATES, 0.0)
    little = Sound(bytes=NOISE_BYTES)
    assert trial.judge(little, 1.0) is TrialStep.STAY
    assert trial.judge(little, 1.0 + DWELL_S) is TrialStep.STAY
    assert trial.judge(little, 1.01 + DWELL_S) is TrialStep.NEXT


def test_a_silent_line_is_silent_at_each_rate_so_none_but_the_first_is_tried() -> None:
    trial = Trial(RATES, 0.0)
    assert trial.judge(Sound(), QUIET_S) is TrialStep.STAY
    assert trial.judge(Sound(), QUIET_S + 0.01) is TrialStep.OVER
    assert (trial.rate, trial.noise) == (500_000, 0)


def test_a_burst_of_noise_on_a_silent_line_ends_the_round_rate_by_rate() -> None:
    trial = Trial(RATES, 0.0)
    assert trial.judge(NOISE, 0.1) is TrialStep.NEXT
    assert trial.judge(Sound(), 0.1 + DWELL_S) is TrialStep.STAY
    assert trial.judge(Sound(), 1.5) is TrialStep.NEXT
    assert trial.judge(Sound(), 3.0) is TrialStep.OVER
    assert trial.noise == NOISE.bytes


def test_frames_without_a_hello_and_those_of_another_schema_are_waited_on() -> None:
    ours = Sound(bytes=8000, frames=200)
    trial = Trial(RATES, 0.0)
    assert trial.judge(ours, 0.1) is TrialStep.STAY
    assert trial.judge(ours, QUIET_S) is TrialStep.STAY
    assert trial.judge(ours, 0.11 + QUIET_S) is TrialStep.NEXT
    other = Sound(bytes=8000, well_formed=200)
    trial = Trial(RATES, 0.0)
    assert trial.judge(other, 0.1) is TrialStep.STAY
    assert trial.judge(other, DWELL_S) is TrialStep.STAY
    assert trial.judge(other, 0.11 + DWELL_S) is TrialStep.NEXT


def test_the_rate_of_the_port_comes_first_then_those_of_missing_probes() -> None:
    memory = Memory()
    assert memory.order(["ttyUSB0"], [], RATES) == RATES
    memory.learn(["serial 17", "ttyUSB0"], "a", 115_200)
    memory.learn(["ttyUSB1"], "b", 921_600)
    memory.learn(["ttyUSB2"], "c", 38_400)
    assert memory.order(["ttyUSB0"], [], RATES) == (115_200, 500_000, 921_600)
    assert memory.order(["serial 17", "ttyUSB9"], [], RATES)[0] == 115_200
    assert memory.order(["ttyUSB9"], ["b", "c", "d"], RATES) == (
        *(38_400, 921_600, 500_000, 115_200),
    )
    assert memory.order(["ttyUSB9"], ["b"], RATES)[0] == 921_600
    assert memory.order(["ttyUSB9"], [], RATES) == RATES
