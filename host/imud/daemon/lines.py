# SPDX-License-Identifier: MIT
"""The lines of the journal about probes, which limits how often they come."""

from __future__ import annotations

import logging

from imud.daemon.registry import ProbeEntry, ProbePort
from imud.defaults import PROBES_MAX
from imud.journal.output import Journal
from imud.journal.phrases import FAULTS, event_words, port_problem, who
from imud.probes.clock import Refit
from imud.probes.ledger import FrameVerdict
from imud.probes.record import plain
from imud.probes.sensors import SensorFinding
from imud.probes.session import OtherSchema, ProbeFound, Rejected
from imud.probes.withheld import withheld_of
from imud.stages import LogLine, Stage
from imud.wire import schema
from imud.wire.messages import Message

LOSSES = ("lost", "corrupt", "duplicated", "dropped by a slow or failed sink")

logger = logging.getLogger("imud")


class ProbeLines:
    """One function a line."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._reported_others: set[tuple[object, ...]] = set()

    def found(self, entry: ProbeEntry, event: ProbeFound, port: ProbePort) -> None:
        entry.described = who(event.hello)
        what = "restarted" if event.is_restart else "found"
        self._journal.write(
            ("found", event.probe_id, what),
            f"probe {entry.name} {what} on {port.name}: {entry.described}",
            is_warning=event.is_restart,
        )
        if event.hello.fields["schema_fingerprint"] != schema.FINGERPRINT:
            self._journal.write(
                ("outdated", event.probe_id),
                f"probe {entry.name} has older firmware (its own schema is read): "
                f"update it with imud flash {port.name}",
                is_warning=True,
            )

    def described(self, entry: ProbeEntry, hello: Message) -> None:
        """Reports the description of the probe in a hello, if it differs from the last
        one."""
        if who(hello) != entry.described:
            entry.described = who(hello)
            text = f"probe {entry.name} is {entry.described}"
            self._journal.write(("who", entry.name), text)

    def calibration(self, entry: ProbeEntry, advice: str | None) -> None:
        """Reports what its calibration needs, when that changes. None: its params are
        not known.
        """
        if advice is None or advice == entry.advised:
            return
        if advice or entry.advised:
            self._journal.write(
                ("calibration", entry.name),
                f"probe {entry.name}: {advice or 'its calibration is good'}",
            )
        entry.advised = advice

    def withheld(self, entry: ProbeEntry) -> None:
        """Says why its errors are not known, once a second."""
        for words in entry.withheld.follow(withheld_of(entry.pose)):
            self._journal.write(
                ("withheld", entry.name), f"probe {entry.name}: {words}"
            )

    def sensors(self, entry: ProbeEntry, findings: list[SensorFinding]) -> None:
        """Reports problems of its sensors, once a boot."""
        boot = entry.probe.account.boots
        reported = entry.reported_findings if entry.reported_boot == boot else []
        for finding in findings:
            if finding not in reported:
                self._journal.write(
                    ("sensors", entry.name, finding.words),
                    f"probe {entry.name}: {finding.words}",
                    is_warning=finding.is_fault,
                )
        entry.reported_boot, entry.reported_findings = boot, [*reported, *findings]

    def other_schema(self, event: OtherSchema, port: ProbePort) -> None:
        """Once for each build of its firmware, however often its port is opened."""
        kind = (event.probe_id, event.firmware, event.fingerprint)
        if kind not in self._reported_others:
            self._reported_others.add(kind)
            logger.warning("%s", port_problem(port.name, event, (port.baud,)))

    def rejected(self, entry: ProbeEntry, event: Rejected) -> None:
        """Duplicates have no line here: `losses` counts them."""
        if event.skew is not None:
            self._journal.write(
                ("skew", event.probe_id, event.skew.kind),
                f"probe {entry.name}: skewed message ({event.skew.kind}): "
                f"{event.skew.detail}",
                is_warning=True,
            )
        elif event.verdict is not FrameVerdict.DUPLICATE:
            self._journal.write(
                ("stray", event.probe_id),
                f"probe {entry.name}: message out of order ignored",
                is_warning=True,
            )

    def event(self, entry: ProbeEntry, message: Message) -> None:
        """The line of an event; a warning if it is a fault."""
        fields = {name: plain(value) for name, value in message.fields.items()}
        name, cause = str(fields["event"]), str(fields["cause"])
        board = str(entry.probe.hello.get("board", ""))
        words = event_words(name, cause, int(fields["detail"]), board)
        self._journal.write(
            ("event", entry.name, name, cause),
            f"probe {entry.name}: {words}",
            is_warning=name in FAULTS,
        )

    def losses(self, entry: ProbeEntry, counts: tuple[int, int, int, int]) -> None:
        """Reports losses since the last such line. `counts` are totals, one for each of
        LOSSES.
        """
        fresh = [
            now - then for now, then in zip(counts, entry.reported_losses, strict=True)
        ]
        text = ", ".join(
            f"{n} {word}" for n, word in zip(fresh, LOSSES, strict=True) if n > 0
        )
        kind, line = ("losses", entry.name), f"probe {entry.name}: {text}"
        if text and self._journal.write(kind, line, is_warning=True, is_total=True):
            entry.reported_losses = counts

    def twice(self, entry: ProbeEntry, holder: ProbePort, port: ProbePort) -> None:
        self._journal.write(
            ("twice", entry.probe.probe_id),
            f"probe {entry.name} is on {holder.name} and also on {port.name}, which "
            "is ignored; two probes may have the same id",
            is_warning=True,
        )

    def no_room(self, probe_id: str) -> None:
        self._journal.write(
            "full",
            f"{PROBES_MAX} probes are the limit, so probe {probe_id} is ignored; if "
            "a device sends invented ids, unplug it and restart imud run",
            is_warning=True,
        )

    def clock_set(self, step_ns: int, *, is_anew: bool) -> None:
        """`is_anew`: by so far back that a new timeline begins."""
        follow = "; time stamps follow gradually" if step_ns < 0 else ""
        if is_anew:
            follow = "; time stamps jump back with it, and a new log starts"
        self._journal.write(
            "host clock",
            f"this machine's clock was set by {step_ns / 1e9:+.3f} s{follow}",
            is_warning=True,
        )

    def paused(self, pause_ns: int, reason: str) -> None:
        """The machine slept, or imud did not run on it."""
        who = "this machine slept" if reason == "slept" else "imud itself stood still"
        pause_s = pause_ns / 1e9
        text = f"{who} for {pause_s:.{0 if pause_s > 10 else 1}f} s"
        self._journal.write(("pause", reason), text, is_warning=reason != "slept")

    def refit(self, entry: ProbeEntry, refit: Refit) -> None:
        """Its time was wrong, and is no longer."""
        by = f"{abs(refit.step_ns) / 1e9:.1f} s"
        words = f"its first messages came {by} late"
        if refit.reason != "late":
            changed = "gained" if refit.step_ns < 0 else "lost"
            words = (
                f"its clock {changed} {by} against this machine's: one of them jumped"
            )
            words += " or stood still, as in a virtual machine that was paused"
        text = f"probe {entry.name}: {words}; its time stamps are right again"
        self._journal.write(("refit", entry.name), text, is_warning=True)

    def synchronised(self, *, is_so: bool) -> None:
        words = (
            "follows UTC again" if is_so else "no longer follows UTC; see timedatectl"
        )
        self._journal.write("host sync", f"this machine {words}", is_warning=not is_so)

    def of_stage(self, entry: ProbeEntry, stage: Stage, line: LogLine) -> None:
        self._journal.write(
            (stage.name, entry.name, line.kind),
            f"probe {entry.name}: {line.text}",
            is_warning=line.is_warning,
        )
