# SPDX-License-Identifier: MIT
"""`imud calibrate` at work: samples to a procedure, its outcome to the probe."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from imud.calibration import mount as mounts
from imud.calibration.affine import affine_of
from imud.calibration.faults import CalibrationFault
from imud.calibration.guided import faults, housing, verify, whole
from imud.calibration.guided.events import Finished, FitRefused, MountFound
from imud.calibration.guided.procedure import POSES, Procedure
from imud.calibration.guided.result import result_of_fit, result_of_wave
from imud.calibration.guided.verify import Report, Verify
from imud.calibration.guided.wave import Wave, Waving
from imud.calibration.mounting import ASKED, of_calibration, result_of_mount, through
from imud.calibration.papers.methods import of_method
from imud.calibration.recording import Gatherer, Sample, SensorRecording
from imud.calibration.result import CalibrationResult
from imud.calibration.score import stated_tilt_deg
from imud.calibration.stops import find_stops
from imud.cli import calibrate_motion, calibrate_text, calibrate_tip, params_text
from imud.cli.calibrate_refusal import CalibrationRefused, refusal, today
from imud.cli.calibrate_screen import CalibrationScreen
from imud.cli.calibrate_source import CalibratedProbe, LiveSamples, of_file
from imud.cli.keyboard import Quit
from imud.errors import CommandRefused
from imud.params.value import Params

if TYPE_CHECKING:
    from imud.client import Client

SENSORS = {"all": ("acc", "gyr", "mag"), "acc": ("acc",), "gyro": ("gyr",)}


def live(client: Client, probe: str, args: argparse.Namespace) -> int:
    """With a probe, through its daemon; returns the exit code."""
    needs_mag = args.what == "mag"
    with LiveSamples(
        client, probe, args.prefix, args.keys, needs_mag=needs_mag
    ) as source:
        screen = CalibrationScreen(probe)
        try:
            with screen.opened():
                found = _followed(source.samples(), source.subject, screen, args)
        except Quit:
            sys.stdout.write("stopped; the calibration is unchanged\n")
            return 1
        if isinstance(found, Report):
            return calibrate_text.verified(probe, found)
        calibrate_text.outcome(probe, found, source.subject.params)
        if args.dry_run:
            return calibrate_text.not_changed(probe, found.params)
        source.put_in_force(found.params)
    return calibrate_text.changed(probe, found.params)


def from_file(args: argparse.Namespace) -> int:
    """With a log or a capture; returns the exit code."""
    name, subject, samples = of_file(args.source, args.probe)
    if args.what == "verify":
        recording = Gatherer.of(subject.scale, samples).recording()
        report = verify.report(
            recording, subject.scale, subject.params, has_mag=subject.has_mag
        )
        return calibrate_text.verified(name, report)
    if args.dry_run:
        found = _of_samples(subject, samples, args)
        calibrate_text.outcome(name, found, subject.params)
        return calibrate_text.not_changed(name, found.params)
    from imud.cli.arguments import client_of

    with client_of(args) as client:
        probe = client.only_probe(args.probe)
        reply = client.params(probe)
        if reply["probe_id"] != subject.probe_id and not args.force:
            raise CommandRefused(
                f"{args.source} is from probe {subject.probe_id}, but {probe} is "
                f"{reply['probe_id']}; use it anyway with --force"
            )
        before = Params.decode(bytes.fromhex(reply["bytes"]))
        subject = replace(subject, probe_id=reply["probe_id"], params=before)
        found = _of_samples(subject, samples, args)
        calibrate_text.outcome(probe, found, before)
        client.change_params(probe, found.params.encode(), reply["probe_id"])
    sys.stdout.write(f"{probe}: params {found.params.digest:08x} are active\n")
    return 0


def learned(client: Client, probe: str, args: argparse.Namespace) -> int:
    """Puts in force what the daemon proposes; returns the exit code."""
    reply = client.params(probe)
    learn = next(iter(client.statuses(probe)), {}).get("learn", {})
    if not learn.get("records"):
        raise CommandRefused(
            f"no learned calibration yet for probe {probe} (state: "
            f"{learn.get('state', 'off')}); it must send raw samples while you rotate "
            "it"
        )
    params = Params.decode(bytes.fromhex(learn["records"]))
    before = Params.decode(bytes.fromhex(reply["bytes"]))
    for line in params_text.differences(before, params):
        sys.stdout.write(f"{line}\n")
    sys.stdout.write(f"  tilt           +-{learn['tilt_deg']:.2f} degrees\n")
    sys.stdout.write(f"  heading        +-{learn['heading_deg']:.2f} degrees\n")
    if args.dry_run:
        return calibrate_text.not_changed(probe, params)
    client.change_params(probe, params.encode(), reply["probe_id"])
    sys.stdout.write(f"{probe}: params {params.digest:08x} are active\n")
    return 0


def mount_as_told(client: Client, probe: str, args: argparse.Namespace) -> int:
    """Puts a mounting in force that was given; returns the exit code."""
    reply = client.params(probe)
    before = Params.decode(bytes.fromhex(reply["bytes"]))
    found = result_of_mount(mounts.named(args.mount), before)
    calibrate_text.outcome(probe, found, before)
    if args.dry_run:
        return calibrate_text.not_changed(probe, found.params)
    client.change_params(probe, found.params.encode(), reply["probe_id"])
    return calibrate_text.changed(probe, found.params)


def _followed(
    samples: Iterable[Sample | None],
    subject: CalibratedProbe,
    screen: CalibrationScreen,
    args: argparse.Namespace,
) -> CalibrationResult | Report:
    """Evaluates samples as they arrive."""
    if args.what == "verify":
        return _verified(samples, subject, screen)
    if args.what == "tip":
        return calibrate_tip.followed(samples, subject, screen, args.axis)
    if args.what == "mag":
        return _waved(samples, subject, screen)
    is_mount = args.what == "mount"
    procedure = Procedure(
        subject.scale,
        count=len(ASKED) if is_mount else POSES,
        mount=None if args.mount is None else mounts.named(args.mount),
        is_mount_alone=is_mount,
        wants_housing=args.what == "all" and not args.no_housing,
        has_mag=subject.has_mag and args.what == "all",
        earth=subject.earth,
    )
    for sample in samples:
        events = procedure.feed(sample) if sample is not None else []
        if screen.is_ended():
            events += procedure.end()
        screen.show(procedure.status())
        for event in events:
            if isinstance(event, FitRefused):
                raise refusal(event.fault)
            if isinstance(event, Finished):
                return _finished(procedure, event, subject, args)
            if isinstance(event, MountFound):
                return result_of_mount(event.mount, subject.params)
    raise CalibrationRefused("the samples ended too early; start again")


def _finished(
    procedure: Procedure,
    event: Finished,
    subject: CalibratedProbe,
    args: argparse.Namespace,
) -> CalibrationResult:
    def make(before: Params) -> CalibrationResult:
        if args.method != "guided":
            whole_recording = procedure.recording()
            return of_method(
                whole_recording, args.method, subject.scale, before, today()
            )
        return result_of_fit(
            event.fit,
            subject.scale,
            before,
            event.turn,
            today(),
            sensors=SENSORS[args.what],
            earth=subject.earth,
        )

    return through(event.mount, subject.params, make)


def _verified(
    samples: Iterable[Sample | None],
    subject: CalibratedProbe,
    screen: CalibrationScreen,
) -> Report:
    check = Verify(subject.scale, subject.params, subject.has_mag)
    screen.show_text(check.instruction)
    for sample in samples:
        report = check.feed(sample) if sample is not None else None
        screen.is_ended()
        if report is not None:
            return report
        if sample is None:
            screen.show_text(check.instruction)
    raise CalibrationRefused("the samples ended too early; start again")


def _waved(
    samples: Iterable[Sample | None],
    subject: CalibratedProbe,
    screen: CalibrationScreen,
) -> CalibrationResult:
    waving = _waving(subject)
    screen.show_text(waving.instruction)
    for sample in samples:
        found = waving.feed(sample) if sample is not None else None
        if screen.is_ended():
            found = waving.end()
        if sample is None or found is not None:
            screen.show_text(waving.instruction)
        if found is not None:
            return _of_wave(found, waving, subject)
    raise CalibrationRefused("the samples ended too early; start again")


def _waving(subject: CalibratedProbe) -> Waving:
    if not subject.has_mag:
        raise CalibrationRefused(subject.missing_mag)
    params, scale = subject.params, subject.scale
    return Waving(
        scale,
        affine_of(params.acc, scale.acc_m_s2),
        affine_of(params.gyr, scale.gyr_rad_s),
        stated_tilt_deg(params.acc),
        of_calibration(params.acc),
    )


def _of_wave(
    found: Wave | CalibrationFault, waving: Waving, subject: CalibratedProbe
) -> CalibrationResult:
    if isinstance(found, CalibrationFault):
        raise refusal(found)

    def make(before: Params) -> CalibrationResult:
        return result_of_wave(
            found, subject.scale, before, waving.temperature_c, today()
        )

    return through(waving.mount, subject.params, make)


def _of_samples(
    subject: CalibratedProbe, samples: list[Sample], args: argparse.Namespace
) -> CalibrationResult:
    """Evaluates all samples of a file."""
    if args.what == "tip":
        return calibrate_tip.of_samples(samples, subject, args.axis)
    if args.what == "learned":
        return calibrate_motion.of_samples(subject, samples)
    if args.what == "mag":
        waving = _waving(subject)
        for sample in samples:
            if isinstance(found := waving.feed(sample), Wave):
                return _of_wave(found, waving, subject)
        return _of_wave(waving.end(), waving, subject)
    mount = of_calibration(subject.params.acc)
    if args.mount is not None:
        mount = mounts.named(args.mount)
    turned = map(mount.sample, samples)
    recording = Gatherer.of(subject.scale, turned).recording()
    return through(
        mount,
        subject.params,
        lambda before: _of_stops(subject, recording, before, args),
    )


def _of_stops(
    subject: CalibratedProbe,
    recording: SensorRecording,
    before: Params,
    args: argparse.Namespace,
) -> CalibrationResult:
    """Evaluates the stops of a recording."""
    if args.method != "guided":
        return of_method(recording, args.method, subject.scale, before, today())
    stops = find_stops(recording)
    fit = whole.fit(recording, stops)
    has_mag = subject.has_mag and args.what == "all"
    wrong = faults.of_module(recording, stops, fit) or faults.of_score(
        fit, len(stops), has_mag=has_mag
    )
    if wrong is not None or fit is None:
        refused = refusal(wrong) if wrong else CalibrationRefused("it is empty")
        raise CalibrationRefused(
            f"{refused}. From motion without stops: imud calibrate learned --from "
            f"{args.source}"
        )
    turn = None if args.no_housing else housing.found(recording, fit)
    return result_of_fit(
        fit, subject.scale, before, turn, today(), sensors=SENSORS[args.what]
    )
