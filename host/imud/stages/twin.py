# SPDX-License-Identifier: MIT
"""The twin of a probe: computes each pose again from the raw messages, with the same C
as the probe, and reports the first pose that differs. No I/O.

It follows the filter from a restart or a boot on, as long as no sample is missing. A
loss is never taken for a difference:

- Between raw messages at most one and a half sample periods apart there is no sample.
  If they are further apart, the second must have the flag `gap`, and no message may be
  missing since the filter began.
- One message missing between two such raw messages was no sample. It was no change of
  origin and no restart either: each of those is two messages, an event and the reply to
  its command or the hello after a change of the params. It may have been a pose, with
  its latched flags.
- Any other gap in the sequence ends it until the filter begins again.
- After any gap params and own field may be others than those last heard of, until a
  hello names them. A twin that began with them meanwhile is dropped where its first
  pose differs.

It computes with the params with which the filter began, or went on. Where it does not
know them it asks for them, and then for a restart. `TwinState` draws what it knows.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from imud import _core
from imud.stages.floats import is_in_floats
from imud.stages.twin_outcomes import (
    AskParams,
    AskRaw,
    AskRestart,
    TwinDiffers,
    TwinLost,
    TwinOutcome,
    TwinStarted,
    TwinState,
    TwinStopped,
    differ_in_latches,
    differing,
)
from imud.wire import schema
from imud.wire.messages import Message, Value, place_of


class BootPhase(Enum):
    """How much was heard of a boot before its filter began. Only who heard all of it
    knows, without being told, which raw message is the filter's first sample.

         hello 0                  stream_started
        --------> FRESH ---------------------------> STREAMING
                    | <---------------------------------+ |
                    |          stream_stopped             |
                    | hello with                          | hello with a sensor, and a
                    | a sensor                            | raw message for each sample
                    v      a change of the streams,       v
                 UNKNOWN <------------------------------ READY
                           or the filter begins

    A missing message, or a hello of another boot, leads to UNKNOWN from everywhere, and
    so does in STREAMING a hello with a sensor without a raw message for each sample.
    """

    UNKNOWN = auto()  # something is missing, or the filter has begun
    FRESH = auto()  # all was heard since number 0, and no sensor is known yet
    STREAMING = auto()  # the same, while messages stream
    READY = auto()  # the next raw message is the filter's first sample


class ParamsKnown(Enum):
    """What is known of the params that the probe has in force.

             all parts heard            a message is missing
    UNKNOWN -----------------> SURE <------------------------> GUESSED
       ^                        |     a hello or an event
       +------------------------+         names them
          others are named
    """

    UNKNOWN = auto()
    GUESSED = auto()  # those last heard of, or others since
    SURE = auto()


class Losses(Enum):
    """What is missing in the sequence since the filter began.

                 one number              a raw message that comes next
        WHOLE ---------------> ONE_MISSING ---------------> NO_SAMPLE
                                    ^  ^     one number       |  |
                                    |  +----------------------+  | a pose
                                    |        one number          v
                                    +------------------------- HARMLESS

    Any other gap ends the twin, and so does in ONE_MISSING whatever needs its sample.
    """

    WHOLE = auto()
    ONE_MISSING = auto()  # it may have been a sample
    NO_SAMPLE = auto()  # it may have been a pose, with its latched flags
    HARMLESS = auto()  # a pose has come since


@dataclass(slots=True)
class TwinBoot:
    """The state of one boot."""

    phase: BootPhase
    count: Value  # as its hello counts boots; before that, of the boot before
    hello: bytes = b""  # the last one that knows a sensor
    sample_rate: int = 0
    raw_rate: Value = None
    raw_us: int | None = None  # time of the last raw message
    is_heard: bool = False  # raw messages have come since the streams changed

    def knows(self, hello: Message, content: bytes, sample_rate: int) -> None:
        """Takes up a hello that knows a sensor, which comes when the filter begins."""
        self.hello = content
        self.sample_rate = sample_rate
        self.raw_rate = hello.fields["raw_rate"]
        if self.phase is BootPhase.STREAMING and self.is_full:
            self.phase = BootPhase.READY
        elif self.phase is not BootPhase.READY:
            self.phase = BootPhase.UNKNOWN

    def streams(self, *, is_on: bool) -> None:
        """A stream began or ended. Without one there are samples that are not sent."""
        self.is_heard = False
        if self.phase in (BootPhase.FRESH, BootPhase.STREAMING):
            self.phase = BootPhase.STREAMING if is_on else BootPhase.FRESH

    def change_streams(self) -> None:
        """Other messages are sent from now on, or the same."""
        self.is_heard = False
        self.unready()  # samples may be fused before the first raw message

    def unready(self) -> None:
        """The next raw message need not be the filter's first sample."""
        if self.phase is BootPhase.READY:
            self.phase = BootPhase.UNKNOWN

    @property
    def is_full(self) -> bool:
        """Whether there is a raw message for each sample."""
        return self.raw_rate == self.sample_rate


@dataclass(slots=True)
class TwinParams:
    """The state of the active params."""

    records: bytes | None = None  # None: not all of their parts were heard
    is_named: bool = False  # nothing is missing since they were named
    changed_at: int | None = None  # the last message that changed them

    @property
    def known(self) -> ParamsKnown:
        if self.records is None:
            return ParamsKnown.UNKNOWN
        return ParamsKnown.SURE if self.is_named else ParamsKnown.GUESSED


@dataclass(slots=True)
class TwinRun:
    """The state since the filter started."""

    replay: _core.Replay
    number: int | None  # of the filter, where an event named it
    hello: bytes  # that it began with
    is_guess: bool  # its params, or its own field, may be others
    is_heard: bool  # each sample since then was told, as the one before it
    steps: int = 0
    losses: Losses = Losses.WHOLE
    missing: int = 0  # the number that is, in ONE_MISSING
    has_differed: bool = False

    def step(self, content: bytes) -> None:
        self.replay.step(content)
        self.steps += 1


RAW_STREAM = 1  # of the command `rate`

CHANGES = frozenset({"restart", "tare"})  # of poses; the event precedes the reply

_UNABLE = "this imud can't compute it"
_FLOATS = "its filter uses floats, whose bits differ between processors"
_OWN = place_of("hello", "own_field")
_MASK = (1 << 32) - 1


class Twin:
    """Takes the good messages of one probe, in order."""

    def __init__(self) -> None:
        self.compared = 0
        self.differed = 0
        self._sequence: int | None = None
        self._boot = TwinBoot(BootPhase.UNKNOWN, None)
        self._params = TwinParams()
        self._asked: set[type[TwinOutcome]] = set()  # since the stream began
        self._run: TwinRun | None = None
        self._is_lost = False  # and has no run for that

    @property
    def state(self) -> TwinState:
        if self._run is None:
            return TwinState.LOST if self._is_lost else TwinState.WAITING
        return TwinState.DIFFERS if self._run.has_differed else TwinState.FOLLOWING

    def on_probe_found(self) -> None:
        """The probe appeared or restarted: forgets everything earlier."""
        self._sequence = None
        self._begin_boot(BootPhase.UNKNOWN)

    def on_message(
        self, message: Message, content: bytes, params: bytes | None
    ) -> TwinOutcome | None:
        """`params`: the records in force with this message; None: not known."""
        had_run = self._run is not None
        self._params.records = params
        outcome = self._check_sequence(message) or self._follow(message, content)
        if outcome is None and had_run and self._run is None:
            return TwinStopped(message.sequence)
        return outcome

    def _check_sequence(self, message: Message) -> TwinLost | None:
        """Looks for a gap in the sequence before this message."""
        last, self._sequence = self._sequence, message.sequence
        first = None if last is None else (last + 1) & _MASK
        if message.name == "hello" and message.sequence == 0 and first != 0:
            self._begin_boot(BootPhase.FRESH)
            return None
        if first is None or message.sequence == first:
            return None
        self._boot.phase = BootPhase.UNKNOWN
        self._boot.raw_rate = None
        self._boot.is_heard = False
        self._params.is_named = False
        run, is_begin = self._run, message.fields.get("event") == "restarted"
        if run is None or is_begin:
            return None
        is_one = message.sequence == (first + 1) & _MASK
        may_be_change = message.fields.get("replied_command") in CHANGES
        # What follows a change of the params is the restart that it brings.
        # Nor may it be what the button did, where that makes strokes.
        may_be_change = may_be_change or last == self._params.changed_at
        may_be_change = may_be_change or run.replay.is_by_button()
        if not is_one or may_be_change or run.losses is Losses.ONE_MISSING:
            return self._lose(first, "a message is missing")
        run.losses, run.missing = Losses.ONE_MISSING, first
        return None

    def _follow(self, message: Message, content: bytes) -> TwinOutcome | None:
        match message.name:
            case "hello":
                return self._on_hello(message, content)
            case "raw":
                return self._on_raw(message, content)
            case "pose":
                return self._on_pose(message, content)
            case "stroke":
                return self._on_stroke(message, content)
            case "event":
                return self._on_event(message)
            case "reply":
                return self._on_reply(message)
        return None

    def _on_hello(self, hello: Message, content: bytes) -> TwinOutcome | None:
        count = hello.fields["boot_count"]
        is_fresh = self._boot.phase in (BootPhase.FRESH, BootPhase.STREAMING)
        if count != self._boot.count and not is_fresh:
            self._begin_boot(BootPhase.UNKNOWN)
        self._boot.count = count
        sample_rate = hello.fields["sample_rate"]
        if not isinstance(sample_rate, int) or sample_rate == 0:
            return None
        if is_in_floats(hello):
            self._boot.hello = b""
            is_reported = self.state is TwinState.LOST
            return None if is_reported else self._lose(hello.sequence, _FLOATS)
        self._params.is_named = True
        self._boot.knows(hello, content, sample_rate)
        return self._compare_params(hello.sequence)

    def _on_event(self, message: Message) -> TwinOutcome | None:
        name, detail = message.fields["event"], message.fields["detail"]
        if name in ("stream_started", "stream_stopped"):
            self._boot.streams(is_on=name == "stream_started")
            self._wait()
        elif name in ("button_pressed", "button_released"):
            if self._run is not None:
                self._run.replay.hold(name == "button_pressed")
        elif name == "params_changed":
            self._params.is_named, self._params.changed_at = True, message.sequence
        elif name == "restarted" and self._boot.hello and isinstance(detail, int):
            return self._begin_run(message.sequence, detail)
        elif name == "tared" and self._run is not None and isinstance(detail, int):
            try:
                self._run.replay.origin(detail)
            except ValueError as error:
                return self._lose(message.sequence, f"{_UNABLE}: {error}")
        return None

    def _on_reply(self, message: Message) -> TwinOutcome | None:
        """Follows changes of the raw stream."""
        command, value = message.fields["replied_command"], message.fields["value"]
        is_off = False
        if message.fields["result"] != "ok" or not isinstance(value, tuple):
            return None
        if command in ("rate", "fields"):
            self._boot.change_streams()
        if command == "rate" and value[0] == RAW_STREAM:
            self._boot.raw_rate = value[1]
            is_off = not self._boot.is_full
        elif command == "fields":
            is_off = not int(value[0]) & schema.StreamFlags.RAW
        if is_off and self._run is not None:
            return self._lose(message.sequence, "it no longer sends every sample")
        return None

    def _on_raw(self, message: Message, content: bytes) -> TwinOutcome | None:
        boot = self._boot
        last, boot.raw_us = boot.raw_us, message.time_us
        boot.is_heard = True
        if not boot.hello:
            return None
        if boot.phase is BootPhase.READY:
            began = self._begin_run(message.sequence, None)
            if self._run is not None:
                self._run.step(content)
            return began
        longest_us = 1.5e6 / boot.sample_rate
        is_next = last is not None and (message.time_us - last) & _MASK <= longest_us
        if self._run is None:
            return self._ask_to_begin(is_next=is_next)
        return self._step(self._run, message, content, is_next=is_next)

    def _ask_to_begin(self, *, is_next: bool) -> TwinOutcome | None:
        """The missing data, at a raw message that the twin can't use."""
        boot = self._boot
        if boot.raw_rate is not None and not boot.is_full:
            return self._ask(AskRaw(boot.sample_rate))
        if self._params.known is ParamsKnown.UNKNOWN:
            return self._ask(AskParams())
        return self._ask(AskRestart()) if is_next and boot.is_full else None

    def _step(
        self, run: TwinRun, message: Message, content: bytes, *, is_next: bool
    ) -> TwinOutcome | None:
        """Steps the filter, if it is known that no sample is missing."""
        if run.losses is Losses.ONE_MISSING:
            if not is_next:
                return self._lose(run.missing, "a message is missing")
            run.losses = Losses.NO_SAMPLE
        flags = message.fields["sample_flags"]
        has_gap = isinstance(flags, tuple) and "gap" in flags
        is_whole = run.losses is Losses.WHOLE
        is_sure = (run.steps > 0 or run.is_heard) and self._boot.is_full and is_whole
        if not (is_next or (has_gap and is_sure)):
            return self._lose(message.sequence, "an earlier sample is missing")
        run.step(content)
        return None

    def _on_pose(self, message: Message, content: bytes) -> TwinOutcome | None:
        boot, run = self._boot, self._run
        has_raw = message.time_us == boot.raw_us
        if run is None:
            boot.unready()
            rate_hz = None if boot.is_full else boot.sample_rate
            return None if has_raw or not boot.hello else self._ask(AskRaw(rate_hz))
        if not has_raw or run.losses is Losses.ONE_MISSING:
            return self._lose(message.sequence, "its sample is missing")
        twin = run.replay.pose(message.sequence, message.time_us)
        self.compared += 1
        is_unlatched = run.losses is Losses.NO_SAMPLE
        if is_unlatched:
            run.losses = Losses.HARMLESS
        if twin == content or (is_unlatched and differ_in_latches(content, twin)):
            return None
        self.compared -= run.is_guess
        return self._differ(run, message, content, twin)

    def _on_stroke(self, message: Message, content: bytes) -> TwinOutcome | None:
        run = self._run
        if run is None:
            return None
        has_raw = message.time_us == self._boot.raw_us
        if not has_raw or run.losses is Losses.ONE_MISSING:
            return self._lose(message.sequence, "its sample is missing")
        twin = run.replay.stroke(message.sequence, message.time_us)
        if twin == content:
            return None
        return self._differ(run, message, content, twin or b"")

    def _differ(
        self, run: TwinRun, message: Message, content: bytes, twin: bytes
    ) -> TwinOutcome:
        if run.is_guess:
            return self._lose(message.sequence, "its params may have changed")
        self.differed += 1
        is_first, run.has_differed = not run.has_differed, True
        fields = differing(message, twin)
        return TwinDiffers(message.sequence, fields, content, twin, is_first)

    def _compare_params(self, sequence: int) -> TwinOutcome | None:
        """A hello named the params. Those of the twin calibrate as they do, or the
        event of a change is missing.
        """
        run, records = self._run, self._params.records
        is_changed = self._params.changed_at == (sequence - 1) & _MASK
        if run is None:
            return None
        was_guess, run.is_guess = run.is_guess, False
        if was_guess and self._boot.hello[_OWN] != run.hello[_OWN]:
            return self._lose(sequence, "its own field may have changed")
        if records is None:
            return self._wait_for_params() if was_guess or is_changed else None
        try:
            is_other = run.replay.params(records)
        except ValueError as error:
            return self._lose(sequence, f"{_UNABLE}: {error}")
        if not is_other:
            return None
        if is_changed and not was_guess:
            run.replay.go_on()
            run.hello = self._boot.hello
            return None
        if run.steps == 0 and run.number is not None:
            return self._begin_run(sequence, run.number)
        return self._lose(sequence, "its params have changed")

    def _wait_for_params(self) -> TwinOutcome | None:
        """The filter began with params that are not known: it must begin once more."""
        self._end_run(is_lost=False)
        self._asked.discard(AskRestart)
        return self._ask(AskParams())

    def _begin_run(self, sequence: int, number: int | None) -> TwinOutcome | None:
        """The filter begins: the one of that number, or (None) the one of the hello."""
        hello, params = self._boot.hello, self._params
        if params.records is None:
            return self._wait_for_params()
        try:
            replay = _core.Replay(hello, params.records)
            if number is not None:
                replay.restart(number)
        except ValueError as error:
            return self._lose(sequence, f"{_UNABLE}: {error}")
        self._boot.unready()
        is_guess = params.known is ParamsKnown.GUESSED
        is_heard = self._boot.is_heard and self._boot.is_full
        self._run = TwinRun(replay, number, hello, is_guess, is_heard)
        return TwinStarted(sequence)

    def _lose(self, sequence: int, reason: str) -> TwinLost:
        self._end_run(is_lost=True)
        return TwinLost(sequence, reason)

    def _begin_boot(self, phase: BootPhase) -> None:
        self._boot = TwinBoot(phase, self._boot.count)
        self._wait()

    def _wait(self) -> None:
        self._end_run(is_lost=False)
        self._asked.clear()

    def _end_run(self, *, is_lost: bool) -> None:
        self._run = None
        self._is_lost = is_lost
        self._boot.unready()

    def _ask(self, outcome: TwinOutcome) -> TwinOutcome | None:
        """Asks once for each stream: a probe that refused is not asked again."""
        is_due = self.state is TwinState.WAITING and self._boot.hello
        if not is_due or type(outcome) in self._asked:
            return None
        self._asked.add(type(outcome))
        return outcome
