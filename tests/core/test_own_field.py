# SPDX-License-Identifier: MIT
"""The probe's own magnetic field, kept without power: when it is kept, when forgotten,
and how a filter begins with it.
"""

from __future__ import annotations

import numpy as np
import pytest

from core import desk
from core.desk import EXACT, FIELD, UNKNOWN, ffi, lib
from core.params_desk import MAG, SMALL
from core.probe_bench import OK, SECOND_US, Bench, Memory
from core.scenes import Filter, scene, tumble
from core.test_probe_params import change
from imud import rotation

OWN_UT = np.array([20.0, -12.5, 6.25])
LOOK_S = 300


def begun(own: object = None, *, is_known: bool = False) -> Filter:
    """A filter of sensors that are uncalibrated, or calibrated."""
    probe = Filter(200)
    lib.fuse_set_accuracy(probe.c, EXACT if is_known else UNKNOWN)
    if own is not None:
        lib.fuse_use_own(probe.c, own)
    return probe


def turned(seconds: float, seed: int = 3) -> desk.Array:
    felt = scene(tumble(seconds, 200, seed), 200, seed=5)
    felt.mag += OWN_UT
    return felt


def read(probe: Filter) -> tuple[bool, list[float], float]:
    """What the filter says of its own field, uT."""
    own = ffi.new("struct own_field *")
    result = lib.fuse_read_own(probe.c, own)
    return result, [value / 4 for value in own.axis], own.sigma / 4


def known(own_ut: object = OWN_UT, sigma_ut: float = 3.5) -> object:
    axis = [round(4 * value) for value in own_ut]
    return ffi.new("struct own_field *", {"axis": axis, "sigma": round(4 * sigma_ut)})


def test_a_filter_knows_its_own_field_once_it_was_turned():
    probe, felt = begun(), turned(40)
    probe.feel(felt[:1000])
    assert not read(probe)[0]
    probe.feel(felt[1000:])
    result, own_ut, sigma_ut = read(probe)
    assert (result, sigma_ut) == (True, 3.0)
    assert own_ut == pytest.approx(OWN_UT, abs=1.0)


def test_what_a_calibration_tells_better_is_not_kept():
    probe = begun(is_known=True)
    probe.feel(turned(40))
    assert not read(probe)[0]


def test_lying_still_a_probe_does_not_know_its_own_field():
    probe = begun()
    probe.feel(turned(40)[:800])
    still = scene(np.tile(rotation.IDENTITY, (6000, 1)), 200, seed=1)
    probe.feel(still)
    assert not read(probe)[0]


def test_a_magnet_that_is_put_on_is_not_known_before_the_probe_was_turned_with_it():
    probe, felt = begun(), turned(90)
    magnet = np.array([0.0, 0.0, 40.0])
    felt.mag[8000:] += magnet
    probe.feel(felt[:8000])
    wrong = 0
    for at in range(8000, len(felt), 200):
        probe.feel(felt[at : at + 200])
        is_known, own_ut, _ = read(probe)
        is_right = np.abs(own_ut - OWN_UT - magnet).max() < 3
        wrong += is_known and not is_right
    assert wrong < 10  # seconds, so many it takes for a change to count
    assert is_known
    assert is_right


def test_with_it_the_heading_is_right_from_the_start():
    felt = turned(6)
    blind, quality = begun().feel(felt)[::2]
    told, told_quality = begun(known()).feel(felt)[::2]
    at = slice(700, 900)  # from the end of the start on, before and in the first turn
    error_deg = desk.heading_deg(told, felt.quat)
    assert np.abs(error_deg[at]).max() < 6
    assert np.abs(desk.heading_deg(blind, felt.quat)[at]).max() > 20
    stated_deg = told_quality["heading_sigma_cdeg"] / 100
    assert (np.abs(error_deg[at]) < 1.96 * stated_deg[at]).all()
    assert stated_deg[at].max() < 19
    assert quality["is_heading_free"][at].all()


@pytest.mark.parametrize("sigma_ut", [0.0, 10.25])
def test_one_that_is_not_known_is_not_begun_with(sigma_ut):
    probe = begun(known(sigma_ut=sigma_ut))
    assert list(probe.c.state.field_ut)[3:] == [0, 0, 0]


def test_a_calibration_that_is_better_is_begun_with():
    probe = begun(known(), is_known=True)
    assert list(probe.c.state.field_ut)[3:] == [0, 0, 0]


@pytest.mark.parametrize("kind", [lib.FILTER_MAHONY, lib.FILTER_MADGWICK])
def test_other_filters_neither_use_nor_find_it(kind):
    bench = Kept()
    assert bench.command(lib.COMMAND_RESTART, kind)[0] == OK
    bench.seconds(3 * LOOK_S)
    assert bench.own is None


class Kept(Bench):
    """A probe whose filter is made to know its own field."""

    def __init__(self, memory: Memory | None = None) -> None:
        super().__init__(memory)
        self.find_sensor()
        self.write()

    def feel(self, own_ut: object = OWN_UT) -> None:
        """What the filter has found."""
        fuse = self.c.tracker.attitude.fuse
        fuse.state.field_learnt = lib.FUSE_FIELD_LEARN
        fuse.settings.own_variance = 7056
        fuse.state.field_astray = 0
        for axis in range(3):
            fuse.state.field_covariance[lib.kalman_variance(3 + axis)] = 2**18
            fuse.state.field_ut[3 + axis] = round(own_ut[axis] * FIELD)

    def seconds(self, count: int) -> None:
        for _ in range(count):
            self.step(SECOND_US)

    def write(self) -> None:
        """Time for what is to be written."""
        for _ in range(600):
            self.step(1000)

    def learn(self, own_ut: object = OWN_UT) -> None:
        self.feel(own_ut)
        self.seconds(2 * LOOK_S)
        self.write()

    @property
    def own(self) -> tuple[list[float], float] | None:
        """What the last hello tells, uT."""
        self.command(lib.COMMAND_HELLO)
        fields = self.of("hello")[-1].fields
        sigma = fields["own_sigma"] / 4
        return ([value / 4 for value in fields["own_field"]], sigma) if sigma else None


def again(bench: Bench) -> Kept:
    return Kept(bench.memory)


def test_two_looks_that_agree_keep_it_over_power_off():
    bench = Kept()
    bench.feel()
    bench.seconds(2 * LOOK_S - 1)
    assert bench.own is None
    bench.seconds(1)
    assert bench.own == (list(OWN_UT), 3.0)
    bench.write()
    later = again(bench)
    assert later.own == (list(OWN_UT), 3.5)
    assert list(later.c.tracker.attitude.fuse.state.field_ut)[3:] == list(
        OWN_UT * FIELD
    )


def test_each_start_makes_it_less_sure_up_to_10_ut():
    bench = Kept()
    bench.learn()
    sigmas = []
    for _ in range(20):
        bench = again(bench)
        sigmas.append(bench.own[1])
    assert sigmas == [min(3.0 + 0.5 * start, 10.0) for start in range(1, 21)]
    bench.learn()
    assert bench.own == (list(OWN_UT), 3.0)


def test_what_has_moved_between_looks_is_not_kept():
    bench = Kept()
    for step in range(6):
        bench.feel(OWN_UT + np.array([4.5 * step, 0.0, 0.0]))
        bench.seconds(LOOK_S)
    assert bench.own is None


@pytest.mark.parametrize(
    "state", ["unsure", "disturbed", "astray", "learning", "known better"]
)
def test_what_the_filter_is_not_sure_of_is_not_kept(state):
    bench = Kept()
    bench.feel()
    fuse = bench.c.tracker.attitude.fuse
    if state == "unsure":
        fuse.state.field_covariance[lib.kalman_variance(4)] = 2**21 + 1
    elif state == "disturbed":
        fuse.state.field_surprise = 4 * lib.FUSE_FIELD_UNIT + 1
    elif state == "astray":
        fuse.state.field_astray = lib.FUSE_FIELD_ASTRAY + 1
    elif state == "learning":
        fuse.state.field_learnt = lib.FUSE_FIELD_LEARN - 1
    else:
        fuse.settings.own_variance = 143
    bench.seconds(3 * LOOK_S)
    assert bench.own is None


def test_a_magnet_in_passing_leaves_what_was_kept_and_one_that_stays_does_not():
    bench = Kept()
    bench.learn()
    bench.feel(OWN_UT + 9)
    bench.seconds(9)
    bench.feel()
    bench.seconds(5)
    assert bench.own is not None
    bench.feel(OWN_UT + 9)
    hellos = len(bench.of("hello"))
    bench.seconds(10)
    told = bench.of("hello")[hellos:]
    assert told[-1].fields["own_sigma"] == 0
    bench.write()
    assert again(bench).own is None


def test_a_magnet_that_is_taken_off_again_is_not_kept():
    bench = Kept()
    bench.feel(OWN_UT + 20)
    bench.seconds(LOOK_S + 100)
    bench.feel()
    bench.seconds(LOOK_S)
    assert bench.own is None
    bench.seconds(LOOK_S)
    assert bench.own == (list(OWN_UT), 3.0)


def test_it_is_written_only_where_it_has_changed():
    bench = Kept()
    bench.learn()
    cells = bytes(bench.memory.cells)
    bench.feel(OWN_UT + 3.5)
    bench.seconds(4 * LOOK_S)
    bench.write()
    assert bytes(bench.memory.cells) == cells


def test_another_calibration_voids_it_and_another_tip_does_not():
    bench = Kept()
    bench.learn()
    change(bench, SMALL)
    assert bench.own is not None
    change(bench, SMALL + MAG)
    assert bench.own is None
    assert list(bench.c.tracker.attitude.fuse.state.field_ut)[3:] == [0, 0, 0]
    bench.write()
    assert again(bench).own is None


def test_a_calibration_that_the_filter_goes_on_with_has_it_within():
    bench = Kept()
    bench.learn()
    before = [event for event, _, _ in bench.events()].count(lib.EVENT_RESTARTED)
    change(bench, MAG, lib.PARAMS_GOES_ON)
    events = [event for event, _, _ in bench.events()]
    assert events.count(lib.EVENT_RESTARTED) == before
    assert bench.own is None
    assert list(bench.c.tracker.attitude.fuse.state.field_ut)[3:] == [0, 0, 0]


def test_the_hello_of_no_own_field_comes_before_the_filter_begins_without_it():
    bench = Kept()
    bench.learn()
    start = len(bench.messages)
    assert bench.command(lib.COMMAND_RESTART, lib.FILTER_NONE, 1)[0] == OK
    names = [message.name for message in bench.messages[start:]]
    assert names == ["hello", "event", "reply"]
    assert bench.messages[start].fields["own_sigma"] == 0
    bench.write()
    assert again(bench).own is None


def test_a_plain_restart_begins_with_it():
    bench = Kept()
    bench.learn()
    assert bench.command(lib.COMMAND_RESTART)[0] == OK
    assert list(bench.c.tracker.attitude.fuse.state.field_ut)[3:] == list(
        OWN_UT * FIELD
    )
    assert bench.own == (list(OWN_UT), 3.0)


class Cut(Memory):
    """A memory whose supply goes with one of its writes."""

    def __init__(self, cells: bytes, left: int) -> None:
        super().__init__()
        self.cells[:] = cells
        self.left = left

    def _write(self, port: object, offset: int, value: int) -> None:
        self.left -= 1
        if self.left == 0:
            self.cells[offset] ^= 0x5A
            self.is_broken = True
        super()._write(port, offset, value)


@pytest.mark.parametrize("second", [None, OWN_UT + 5])
def test_a_cut_at_any_write_leaves_it_as_before_or_as_after(second):
    first = Kept()
    if second is not None:
        first.learn()
    whole = bytes(again(first).memory.cells)  # the boot is counted
    wanted = OWN_UT if second is None else second
    for left in range(1, 60):
        memory = Cut(whole, 10**9)
        bench = Kept(memory)
        before = bench.own
        memory.left = left
        bench.learn(wanted)
        if not memory.is_broken:
            break
        memory.is_broken = False
        memory.left = 10**9
        found = Kept(memory).own
        after = (list(wanted), 3.5)
        assert found == after or (found and found[0]) == (before and before[0])
    assert 10 < left < 59
