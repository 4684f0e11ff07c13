# SPDX-License-Identifier: MIT
"""The guided calibration as a state machine: samples in; events and a status out, for a
terminal as for a page. It does no I/O and has no clock.

Lay it still, turn it, lay it still: each stop in another attitude is a pose. After the
twelfth good pose, once the score allows it, come two more for the housing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np

from imud.calibration import accelerometer, poses
from imud.calibration.accelerometer import AccFit
from imud.calibration.algebra import triple, units
from imud.calibration.earth import Earth
from imud.calibration.faults import CalibrationFault
from imud.calibration.guided import faults, housing, whole
from imud.calibration.guided.events import (
    OVER,
    Event,
    Finished,
    FitRefused,
    MountFound,
    Phase,
    PoseTaken,
    ProcedureStatus,
    Troubled,
)
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.mount import ASSUMED, PLAIN, ModuleMount, MountError
from imud.calibration.mounting import MountFinder
from imud.calibration.poses import StaticPose
from imud.calibration.recording import Gatherer, Sample, Scale, SensorRecording
from imud.calibration.stops import BLOCK_S, Blocks, StaticInterval, lasting
from imud.rotation import FloatArray

GOOD_S = 1.5  # of stillness: then the pose counts; more makes it better
POSES = 12
POSES_MAX = 24  # with so many poses it is done or refused
ALIKE = math.cos(math.radians(20.0))  # stops closer than this are one pose
ATTEMPTS = 2  # at poses that show how a module is mounted
TILT_DONE_DEG = 0.1  # good enough to stop asking
MOVED_S = 0.75  # a stillness that ended too early is reported


class Stillness(Enum):
    """The state of the probe between two poses.

    MOVES --- still ---> LIES --- for GOOD_S ---> COUNTS
      ^                   |                         |
      +------ moved ------+--------- moved ---------+
    """

    MOVES = auto()
    LIES = auto()
    COUNTS = auto()  # the stop counts; more of it makes it better


@dataclass(slots=True)
class Procedure:
    """One calibration of a module, from its raw samples.

    poses --- enough good ones ---> base_down --- laid so ---> half_turn ---> done
      |                                 ^                          |            ^
      |                                 +--- not half a turn ------+            |
      +--- without the two for the housing -------------------------------------+

    A fault of the module leads from each phase to `refused`, and an early end by the
    user to `done` or `refused`.

    `count`: how many poses to ask for. `wants_housing`: whether the two for the housing
    follow. `mount`: how the module is mounted; None: the first poses, which have to be
    those that are asked for, find it. `is_mount_alone`: nothing else is wanted.
    """

    scale: Scale
    count: int = POSES
    wants_housing: bool = True
    has_mag: bool = True
    earth: Earth | None = None  # the field of the place, if it is known
    mount: ModuleMount | None = PLAIN
    is_mount_alone: bool = False
    phase: Phase = "poses"
    fit: ModuleFit | None = None
    trouble: CalibrationFault | None = None
    ups: list[FloatArray] = field(default_factory=list)
    wanted: StaticPose = poses.BASE_DOWN
    _gatherer: Gatherer = field(init=False)
    _stillness: Stillness = Stillness.MOVES
    _still_since: int = 0  # step, unless it moves
    _stops: list[StaticInterval] = field(default_factory=list)
    _checked: int = 0
    _first_down: StaticInterval | None = None
    _has_asked: bool = False  # for missing poses, when the user ends early
    _finder: MountFinder = field(default_factory=MountFinder)

    def __post_init__(self) -> None:
        self._gatherer = Gatherer(self.scale)

    @property
    def is_over(self) -> bool:
        """Whether it has finished or was refused."""
        return self.phase in OVER

    def feed(self, sample: Sample) -> list[Event]:
        """Takes the next sample."""
        if self.is_over:
            return []
        self._gatherer.add(sample if self.mount is None else self.mount.sample(sample))
        block = max(2, round(BLOCK_S / self._gatherer.step_s))
        if len(self._gatherer) < self._checked + block:
            return []
        self._checked += block
        return self._look(self._gatherer.recording())

    def end(self) -> list[Event]:
        """The user ends it early: evaluates the samples so far. Missing poses are
        reported once, and the user may continue.
        """
        if self.is_over:
            return []
        before = self.phase
        judged = self._judge(self._gatherer.recording())
        is_lack = isinstance(judged, FitRefused) and judged.fault.kind in faults.LACKS
        if self.trouble is None or self._has_asked or not is_lack:
            return [judged]
        self._has_asked, self.phase = True, before
        return self._trouble(self.trouble)

    def recording(self) -> SensorRecording:
        """All samples so far, as a recording."""
        return self._gatherer.recording()

    def _look(self, recording: SensorRecording) -> list[Event]:
        """Follows the stillness by one block."""
        blocks = Blocks.of(recording)
        runs = np.flatnonzero(blocks.is_still == 0.0)
        start = int(runs[-1] + 1 if len(runs) else 0) * blocks.size
        end = len(blocks.is_still) * blocks.size
        if start == end:
            return self._move(recording)
        if self._stillness is Stillness.MOVES or self._still_since != start:
            self._stillness, self._still_since = Stillness.LIES, start
        seconds = (end - start) * recording.step_s
        if self._stillness is Stillness.COUNTS or seconds < GOOD_S:
            return []
        self._stillness = Stillness.COUNTS
        self._stops = lasting(blocks.stops(), recording, GOOD_S)
        return self._add_stop(recording)

    def _move(self, recording: SensorRecording) -> list[Event]:
        """The probe moves, perhaps too early."""
        before, self._stillness = self._stillness, Stillness.MOVES
        if before is not Stillness.LIES:
            return []
        lasted = (len(recording) - self._still_since) * recording.step_s
        if lasted < MOVED_S:
            return []
        return self._trouble(
            CalibrationFault(
                "moved",
                f"it moved after {lasted:.1f} s",
                "lay it down and let go for two seconds",
            )
        )

    def _trouble(self, fault: CalibrationFault) -> list[Event]:
        self.trouble = fault
        return [Troubled(fault)]

    def _add_stop(self, recording: SensorRecording) -> list[Event]:
        """A stop is long enough."""
        self.trouble = None
        self.fit = whole.fit(recording, self._stops)
        wrong = faults.of_module(recording, self._stops, self.fit)
        if wrong is not None:
            return [self._refuse(wrong)]
        if self.mount is None:
            return self._find_mount(recording)
        up = self._up(recording, self._stops[-1])
        if self.phase != "poses":
            return self._add_housing_stop(recording, up)
        is_new = all(other @ up < ALIKE for other in self.ups)
        if is_new:
            self.ups.append(up)
        events: list[Event] = [PoseTaken(len(self.ups), triple(up), is_new)]
        self.wanted = poses.wanted(self.fit.acc if self.fit else self._early(recording))
        if self.fit is not None:
            spoilt = faults.of_room(self.fit, self.earth)
            if spoilt is not None and len(self._stops) >= 6:
                events += self._trouble(spoilt)
        if not is_new:
            events += self._trouble(
                CalibrationFault(
                    "again", "this pose is done", f"lay it {self.wanted.words}"
                )
            )
        return events + self._after_pose(recording)

    def _find_mount(self, recording: SensorRecording) -> list[Event]:
        """One of the first poses; after the last one all readings are turned."""
        stop, asked = self._stops[-1], StaticPose(self._finder.asked)
        force = recording.acc[stop.start : stop.end].mean(axis=0)
        try:
            found = self._finder.add(force)
        except MountError as error:
            self.ups.clear()
            if self._finder.failures >= ATTEMPTS and not self.is_mount_alone:
                return self._go_on(recording, ASSUMED)
            self.wanted = poses.BASE_DOWN
            return self._trouble(faults.not_as_asked(error))
        self.ups.append(asked.up)
        self.wanted = StaticPose(self._finder.asked)
        events: list[Event] = [PoseTaken(len(self.ups), triple(asked.up), True)]
        if found is None:
            return events
        if self.is_mount_alone:
            self.mount, self.phase = found, "done"
            return [*events, MountFound(found)]
        self.ups.clear()
        return [*events, *self._go_on(recording, found)]

    def _go_on(self, recording: SensorRecording, mount: ModuleMount) -> list[Event]:
        """The mounting is known, or assumed: the stops so far count as poses."""
        self.mount = mount
        self._gatherer.turn(mount.turn)
        recording = self._gatherer.recording()
        self.fit = whole.fit(recording, self._stops)
        for stop in self._stops:
            up = self._up(recording, stop)
            if all(other @ up < ALIKE for other in self.ups):
                self.ups.append(up)
        self.wanted = poses.wanted(self.fit.acc if self.fit else self._early(recording))
        return self._after_pose(recording)

    def _early(self, recording: SensorRecording) -> AccFit:
        """A rough fit of a few stops, for the choice of the next one."""
        readings, sigma = accelerometer.means(recording, self._stops)
        return accelerometer.fit(readings, sigma)

    def _up(self, recording: SensorRecording, stop: StaticInterval) -> FloatArray:
        """The direction of up in the body, by the fit so far."""
        mean = recording.acc[stop.start : stop.end].mean(axis=0)
        return units(self.fit.acc.force(mean) if self.fit is not None else mean)

    def _after_pose(self, recording: SensorRecording) -> list[Event]:
        if len(self.ups) < self.count or self.fit is None:
            return []
        weak = self._weakness()
        is_sharp = self.fit.score.tilt_deg <= TILT_DONE_DEG
        if weak is None and (is_sharp or len(self.ups) >= POSES_MAX):
            if not self.wants_housing:
                return [self._judge(recording)]
            self.phase, self.wanted = "base_down", poses.BASE_DOWN
            self._first_down = None
        elif len(self._stops) >= POSES_MAX:
            return [self._judge(recording)]
        return []

    def _add_housing_stop(
        self, recording: SensorRecording, up: FloatArray
    ) -> list[Event]:
        last, first = self._stops[-1], self._first_down
        if first is None or self.fit is None:
            if up @ poses.BASE_DOWN.up < ALIKE:
                leans = CalibrationFault(
                    "not_base_down", "it is not base down", "lay it base down"
                )
                return self._trouble(leans)
            self.phase, self._first_down = "half_turn", last
            return []
        between = slice(first.middle, last.middle)
        angle = housing.turn_about_up(self.fit.gyr.rate[between], recording.step_s, up)
        turn = housing.turned(self._up(recording, first), up, angle)
        if isinstance(turn, CalibrationFault):
            # The current stop may be the first of another try.
            self._first_down = last if up @ poses.BASE_DOWN.up > ALIKE else None
            self.phase = "half_turn" if self._first_down is not None else "base_down"
            return self._trouble(turn)
        return [self._judge(recording, turn)]

    def _weakness(self) -> CalibrationFault | None:
        return faults.of_score(self.fit, len(self._stops), has_mag=self.has_mag)

    def _judge(
        self, recording: SensorRecording, turn: FloatArray | None = None
    ) -> Event:
        """The final verdict, by a last fit of all stops."""
        if self.is_mount_alone:  # or it would be over
            return self._refuse(faults.TOO_FEW_FOR_MOUNT)
        stops = self._stops = lasting(Blocks.of(recording).stops(), recording, GOOD_S)
        self.fit = whole.fit(recording, stops)
        wrong = faults.of_module(recording, stops, self.fit) or self._weakness()
        if wrong is not None or self.fit is None:
            return self._refuse(wrong or faults.of_score(None, 0, has_mag=False))
        self.phase = "done"
        return Finished(self.fit, turn, self.mount or ASSUMED)

    def _refuse(self, fault: CalibrationFault | None) -> FitRefused:
        self.phase = "refused"
        self.trouble = fault
        return FitRefused(
            fault or CalibrationFault("unknown", "it can't be calibrated", "try again")
        )

    def status(self) -> ProcedureStatus:
        """The status for a screen."""
        step_s = self._gatherer.step_s
        is_still = self._stillness is not Stillness.MOVES
        still_s = (self._checked - self._still_since) * step_s if is_still else 0.0
        score = self.fit.score if self.fit is not None else None
        return ProcedureStatus(
            self.phase,
            self._instruction(),
            len(self.ups),
            self.count,
            tuple(map(triple, self.ups)),
            self.wanted.name if not self.is_over else None,
            None if self.mount is None else self.mount.told(),
            is_still,
            1.0 if self._stillness is Stillness.COUNTS else min(1.0, still_s / GOOD_S),
            score.tilt_deg if score else None,
            score is not None and score.is_level,
            score.heading_deg if score else None,
            score is not None and score.is_headed,
            str(self.trouble) if self.trouble is not None else None,
            len(self._gatherer) * step_s,
        )

    def _instruction(self) -> str:
        if self.phase == "done":
            return "Done."
        if self.phase == "refused":
            return "Refused."
        if self._stillness is Stillness.LIES:
            return "Let it lie still..."
        done, of = len(self.ups), max(self.count, len(self.ups) + 1)
        if self.phase == "base_down":
            return "All poses are good. To align its housing, lay it base down."
        if self.phase == "half_turn":
            return "Good. Keep it base down and turn it by 180 degrees."
        if done == 0:
            return "Lay it base down and let go."
        return f"Good ({done} of {of}). Now lay it {self.wanted.words}."
