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
know them it asks for them, and then for a restart.
"""

from __future__ import annotations

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

RAW_STREAM = 1  # of the command `rate`

CHANGES = frozenset({"restart", "tare"})  # of poses; the event precedes the reply

_UNABLE = "this imud can't compute it"
_FLOATS = "its filter computes in floats, each processor with bits of its own"
_OWN = place_of("hello", "own_field")
_MASK = (1 << 32) - 1


class Twin:
    """Takes the good messages of one probe, in order."""

    def __init__(self) -> None:
        self.state = TwinState.WAITING
        self.compared = 0
        self.differed = 0
        self._sequence: int | None = None
        # Known about this boot:
        self._boots: Value = None
        self._hello = b""  # the last one that knows a sensor
        self._sample_rate = 0
        self._raw_rate: Value = None
        self._is_new = False  # no message missing since number 0, no sensor known yet
        self._is_ripe = False  # the same, and the first sample comes next
        self._is_streaming = False
        self._raw_us: int | None = None  # time of the last raw message
        self._params: bytes | None = None  # in force now, as far as is known
        self._is_sure = False  # of these: nothing is missing since they were named
        self._changed_at: int | None = None  # the last message that changed them
        self._asked: set[type[TwinOutcome]] = set()  # since the stream began
        # Known since the filter began:
        self._replay: _core.Replay | None = None
        self._number: int | None = None  # of the filter, where an event named it
        self._is_guess = False  # its params, or its own field, may be others
        self._begun = b""  # the hello that it began with
        self._steps = 0
        self._hole: int | None = None  # a missing number that may be harmless
        self._had_hole = False
        self._is_unlatched = False  # a pose may be missing before the next one

    def on_probe_found(self) -> None:
        """The probe appeared or restarted: forgets what came before."""
        self._sequence = None
        self._boot(is_new=False)

    def on_message(
        self, message: Message, content: bytes, params: bytes | None
    ) -> TwinOutcome | None:
        """`params`: the records in force with this message; None: not known."""
        had_replay = self._replay is not None
        self._params = params
        outcome = self._miss(message) or self._follow(message, content)
        if outcome is None and had_replay and self._replay is None:
            return TwinStopped(message.sequence)
        return outcome

    def _miss(self, message: Message) -> TwinLost | None:
        """Looks for a gap in the sequence before this message."""
        last, self._sequence = self._sequence, message.sequence
        first = None if last is None else (last + 1) & _MASK
        if message.name == "hello" and message.sequence == 0 and first != 0:
            self._boot(is_new=True)
            return None
        if first is None or message.sequence == first:
            return None
        self._is_new = self._is_ripe = self._is_sure = False
        self._raw_rate = None
        is_begin = message.fields.get("event") == "restarted"
        if self._replay is None or is_begin:
            return None
        is_one = message.sequence == (first + 1) & _MASK
        may_be_change = message.fields.get("replied_command") in CHANGES
        # What follows a change of the params is the restart that it brings.
        # Nor may it be what the button did, where that makes strokes.
        may_be_change = may_be_change or last == self._changed_at
        may_be_change = may_be_change or self._replay.is_by_button()
        if not is_one or may_be_change or self._hole is not None:
            return self._lose(first, "a message is missing")
        self._hole = first
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
        boots, self._boots = self._boots, hello.fields["boot_count"]
        if boots != self._boots and not self._is_new:
            self._boot(is_new=False)
        sample_rate = hello.fields["sample_rate"]
        if not isinstance(sample_rate, int) or sample_rate == 0:
            return None
        if is_in_floats(hello):
            self._hello = b""
            is_reported = self.state is TwinState.LOST
            return None if is_reported else self._lose(hello.sequence, _FLOATS)
        self._is_sure = True
        self._hello = content
        self._sample_rate = sample_rate
        self._raw_rate = hello.fields["raw_rate"]
        if self._is_new:
            # The first hello with a sensor comes when the filter begins.
            self._is_new = False
            self._is_ripe = self._is_streaming and self._raw_rate == sample_rate
        return self._compare_params(hello.sequence)

    def _on_event(self, message: Message) -> TwinOutcome | None:
        name, detail = message.fields["event"], message.fields["detail"]
        if name in ("stream_started", "stream_stopped"):
            # Without a stream there are samples that are not sent.
            self._is_streaming = name == "stream_started"
            self._wait()
        elif name in ("button_pressed", "button_released"):
            if self._replay is not None:
                self._replay.hold(name == "button_pressed")
        elif name == "params_changed":
            self._is_sure, self._changed_at = True, message.sequence
        elif name == "restarted" and self._hello and isinstance(detail, int):
            return self._begin(message.sequence, detail)
        elif name == "tared" and self._replay is not None and isinstance(detail, int):
            try:
                self._replay.origin(detail)
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
            self._is_ripe = False  # samples may be fused before the first raw message
        if command == "rate" and value[0] == RAW_STREAM:
            self._raw_rate = value[1]
            is_off = self._raw_rate != self._sample_rate
        elif command == "fields":
            is_off = not int(value[0]) & schema.StreamFlags.RAW
        if is_off and self._replay is not None:
            return self._lose(message.sequence, "not every sample is told any more")
        return None

    def _on_raw(self, message: Message, content: bytes) -> TwinOutcome | None:
        last, self._raw_us = self._raw_us, message.time_us
        if not self._hello:
            return None
        if self._is_ripe:
            began = self._begin(message.sequence, None)
            self._step(content)
            return began
        is_full = self._raw_rate == self._sample_rate
        longest_us = 1.5e6 / self._sample_rate
        is_next = last is not None and (message.time_us - last) & _MASK <= longest_us
        if self._replay is None:
            if self._raw_rate is not None and not is_full:
                return self._ask(AskRaw(self._sample_rate))
            if self._params is None:
                return self._ask(AskParams())
            return self._ask(AskRestart()) if is_next and is_full else None
        if self._hole is not None:
            if not is_next:
                return self._lose(self._hole, "a message is missing")
            self._hole = None
            self._had_hole = self._is_unlatched = True
        flags = message.fields["sample_flags"]
        has_gap = isinstance(flags, tuple) and "gap" in flags
        is_sure = self._steps > 0 and is_full and not self._had_hole
        if not (is_next or (has_gap and is_sure)):
            return self._lose(message.sequence, "a sample before it was not told")
        self._step(content)
        return None

    def _step(self, content: bytes) -> None:
        if self._replay is not None:
            self._replay.step(content)
            self._steps += 1

    def _on_pose(self, message: Message, content: bytes) -> TwinOutcome | None:
        has_raw = message.time_us == self._raw_us
        if self._replay is None:
            self._is_ripe = False
            is_full = self._raw_rate == self._sample_rate
            rate_hz = None if is_full else self._sample_rate
            return None if has_raw or not self._hello else self._ask(AskRaw(rate_hz))
        if not has_raw or self._hole is not None:
            return self._lose(message.sequence, "its sample was not told")
        twin = self._replay.pose(message.sequence, message.time_us)
        self.compared += 1
        is_unlatched, self._is_unlatched = self._is_unlatched, False
        if twin == content or (is_unlatched and differ_in_latches(content, twin)):
            return None
        self.compared -= self._is_guess
        return self._differ(message, content, twin)

    def _on_stroke(self, message: Message, content: bytes) -> TwinOutcome | None:
        if self._replay is None:
            return None
        if message.time_us != self._raw_us or self._hole is not None:
            return self._lose(message.sequence, "its sample was not told")
        twin = self._replay.stroke(message.sequence, message.time_us)
        if twin == content:
            return None
        return self._differ(message, content, twin or b"")

    def _differ(self, message: Message, content: bytes, twin: bytes) -> TwinOutcome:
        if self._is_guess:
            return self._lose(message.sequence, "its params may be others")
        self.differed += 1
        is_first, self.state = self.state is TwinState.FOLLOWING, TwinState.DIFFERS
        fields = differing(message, twin)
        return TwinDiffers(message.sequence, fields, content, twin, is_first)

    def _compare_params(self, sequence: int) -> TwinOutcome | None:
        """A hello named the params. Those of the twin calibrate as they do, or the
        event of a change is missing.
        """
        was_guess, self._is_guess = self._is_guess, False
        is_changed = self._changed_at == (sequence - 1) & _MASK
        if self._replay is None:
            return None
        if was_guess and self._hello[_OWN] != self._begun[_OWN]:
            return self._lose(sequence, "its own field may have been another")
        if self._params is None:
            return self._wait_for_params() if was_guess or is_changed else None
        try:
            is_other = self._replay.params(self._params)
        except ValueError as error:
            return self._lose(sequence, f"{_UNABLE}: {error}")
        if not is_other:
            return None
        if is_changed and not was_guess:
            self._replay.go_on()
            self._begun = self._hello
            return None
        if self._steps == 0 and self._number is not None:
            return self._begin(sequence, self._number)
        return self._lose(sequence, "its params have changed")

    def _wait_for_params(self) -> TwinOutcome | None:
        """The filter began with params that are not known: it must begin once more."""
        self._replay = None
        self._is_ripe = False
        self.state = TwinState.WAITING
        self._asked.discard(AskRestart)
        return self._ask(AskParams())

    def _begin(self, sequence: int, number: int | None) -> TwinOutcome | None:
        """The filter begins: the one of that number, or (None) the one of the hello."""
        if self._params is None:
            return self._wait_for_params()
        try:
            self._replay = _core.Replay(self._hello, self._params)
            if number is not None:
                self._replay.restart(number)
        except ValueError as error:
            return self._lose(sequence, f"{_UNABLE}: {error}")
        self.state = TwinState.FOLLOWING
        self._is_ripe = False
        self._number = number
        self._is_guess = not self._is_sure
        self._begun = self._hello
        self._steps = 0
        self._hole = None
        self._had_hole = self._is_unlatched = False
        return TwinStarted(sequence)

    def _lose(self, sequence: int, reason: str) -> TwinLost:
        self._replay = None
        self._is_ripe = False
        self.state = TwinState.LOST
        return TwinLost(sequence, reason)

    def _boot(self, *, is_new: bool) -> None:
        """Another boot; `is_new`: heard from its first message on."""
        self._is_new = is_new
        self._is_streaming = False
        self._hello = b""
        self._raw_us = None
        self._wait()

    def _wait(self) -> None:
        self._replay = None
        self._is_ripe = False
        self.state = TwinState.WAITING
        self._asked.clear()

    def _ask(self, outcome: TwinOutcome) -> TwinOutcome | None:
        """Asks once for each stream: a probe that refused is not asked again."""
        is_due = self.state is TwinState.WAITING and self._hello
        if not is_due or type(outcome) in self._asked:
            return None
        self._asked.add(type(outcome))
        return outcome
