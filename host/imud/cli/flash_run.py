# SPDX-License-Identifier: MIT
"""`imud flash` at work: what the board has, what it gets, writing, and what became of
its params.
"""

from __future__ import annotations

import argparse
import contextlib
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from imud.cli import flash_client, flash_params, reached
from imud.cli.check_ports import only_port
from imud.cli.flash_client import FlashBar, FlashClient
from imud.cli.reached import NoProbeHere, Reached
from imud.commands import LENT_MAX_S
from imud.errors import CommandRefused, FlashError, ImudError, LinkError, ProbeUnknown
from imud.flash import OnProgress, f405, firmware, mega, nano, pico
from imud.flash.errors import HalfWritten
from imud.flash.firmware import ALL_FILTERS, BOARDS, Image
from imud.ports.holders import holders_of
from imud.wire.schema import FINGERPRINT

COMMAND = "imud flash"
USB = "USB"
TRIES = 3  # at a board whose bootloader still answers
BACK_S = 120.0  # a person rewires an F405; a board starts, a round of baud rates
TICK_S = 0.2

# Writes an image to the board on a port, tells how far it is, and returns what it did.
Write = Callable[[str, Image, OnProgress], str]


def run(args: argparse.Namespace) -> int:
    """Flashes one board; returns the exit code."""
    if args.for_page:
        return _run_for_page(args)
    with contextlib.ExitStack() as stack:
        found = _found(args, stack)
        if found is None:
            return _flash_unknown(args)
        return _flash_probe(args, found.client, found.status, found.title)


def _run_for_page(args: argparse.Namespace) -> int:
    client = flash_client.page_client()
    try:
        statuses = client.statuses(args.port)
        if not statuses:
            raise ProbeUnknown(f"there is no probe {args.port}")
        return _flash_probe(args, client, statuses[0], args.port)
    except ImudError as error:
        client.tell(error=str(error))
        return 1


def _found(args: argparse.Namespace, stack: contextlib.ExitStack) -> Reached | None:
    """The probe that is meant; None if the board has no firmware of ours that runs."""
    is_on_usb = args.by == "dfu" or args.board == "pico"
    if args.port is None and args.board is not None and is_on_usb:
        return None  # a board in its boot loader, which is no port
    is_known = args.board is not None
    try:
        return reached.probe(args, args.port, COMMAND, stack, also_gone=is_known)
    except (NoProbeHere, LinkError) as error:
        stack.close()  # its daemon has the port open
        if args.board is None:
            raise ProbeUnknown(
                f"{error}; if the board has no firmware of ours, pass its type: "
                f"{COMMAND} {args.port or 'PORT'} --board nano"
            ) from error
        return None


def _flash_unknown(args: argparse.Namespace) -> int:
    """A board that says nothing: what it is was told."""
    write = _writer(args, args.board)
    is_usb = write is _by_dfu or (write is _by_drive and args.port is None)
    port = USB if is_usb else args.port or only_port(COMMAND)
    image = _chosen(args, args.board, {})
    say(f"{port}: {BOARDS[args.board]}, as given; no firmware of ours answers")
    _say_image(image)
    if args.dry_run:
        say("nothing was written")
        return 0
    _write(write, args.board, port, image, None)
    if write in BY_HAND or port == USB:
        say("see imud list once it is wired for use")
        return 0
    with contextlib.ExitStack() as stack:
        found = reached.probe(args, port, COMMAND, stack)
        hello = found.status["hello"]
        say(f"{found.status['probe']} runs {hello['firmware']}")
        flash_params.restore(found.client, found.status)
    return 0


def _flash_probe(
    args: argparse.Namespace, client: FlashClient, status: dict[str, Any], title: str
) -> int:
    name, hello = str(status["probe"]), dict(status["hello"])
    kind = args.board or str(hello["board"])
    if args.board not in (None, hello["board"]):
        raise FlashError(
            f"{name} is {BOARDS.get(hello['board'], hello['board'])}, not "
            f"{args.board}; leave --board out"
        )
    write = _writer(args, kind)
    image = _chosen(args, kind, hello)
    say(f"{title}: {BOARDS[kind]}, firmware {hello['firmware']}")
    _say_image(image)
    _check_step(hello, image, is_forced=args.force)
    if args.dry_run:
        say("nothing was written")
        return 0
    flash_params.keep(client, status, is_forced=args.force)
    with lent(client, name) as port:
        _write(write, kind, port, image, client)
    if write in BY_HAND:
        say("wire it for use (docs/f405.md), disconnect BOOT0, and press RST")
    now = _back(client, name, image)
    say(f"firmware {hello['firmware']} -> {now['hello']['firmware']}")
    had, has = hello.get("filter"), now["hello"]["filter"]
    if had not in (None, has):
        say(f"filter {had} -> {has}")
    flash_params.restore(client, now)
    return 0


def _chosen(args: argparse.Namespace, kind: str, hello: dict[str, Any]) -> Image:
    """The image for a board; FlashError if there is none, or if it is another's."""
    if args.image is not None:
        path = args.image
        if args.filter is not None:
            raise FlashError("--filter chooses an image: leave out --filter or --image")
    else:
        if kind != "nano" and args.filter is not None:
            raise FlashError(
                "this board has all filters; choose one with imud restart --filter "
                f"{args.filter}"
            )
        path = firmware.ready_made(kind, args.filter or hello.get("filter") or "fuse")
    image = firmware.read(path)
    if image.board != kind:
        raise FlashError(
            f"{path} is for {BOARDS[str(image.board)]}, but the board is "
            f"{BOARDS.get(kind, kind)}"
        )
    if image.about is None and args.board is None:
        raise FlashError(
            f"{path} has no {firmware.MANIFEST} beside it, so its origin is unknown; "
            f"if you built it for this board: --board {kind}"
        )
    return image


def _say_image(image: Image) -> None:
    about = image.about
    what = f"image of {len(image.code):,} bytes, SHA-256 {image.sha256[:16]}..."
    if about is not None:
        with_filter = "" if about.filter == ALL_FILTERS else f", filter {about.filter}"
        what = f"{about.version}{with_filter}, {what}"
    say(f"to write: {what}: {image.path}")
    is_signed = firmware.is_signed(image.path.parent)
    if is_signed is not None:
        by = "the release's key" if is_signed else "nobody"
        say(f"its manifest is signed by {by}")


def _check_step(hello: dict[str, Any], image: Image, *, is_forced: bool) -> None:
    """FlashError if this image is no step ahead for the board."""
    about = image.about
    if about is None or is_forced:
        return
    if about.schema != f"{FINGERPRINT:08x}":
        raise FlashError(
            f"the image has schema {about.schema}, but this imud {FINGERPRINT:08x}: "
            "install the matching version of imud, or use --force"
        )
    has = str(hello.get("firmware", ""))
    is_same_filter = about.filter in (ALL_FILTERS, hello.get("filter"))
    if about.version == has and is_same_filter and not has.endswith("-d"):
        raise FlashError(f"the board already has {has}; write it again with --force")
    if _release(about.version) < _release(has):
        raise FlashError(
            f"the image is {about.version}, older than the board's {has}; write it "
            "anyway with --force"
        )


def _release(version: str) -> tuple[int, ...]:
    """0.2.0+1234567 as (0, 2, 0); what is no version is older than all."""
    with contextlib.suppress(ValueError):
        return tuple(int(each) for each in version.partition("+")[0].split("."))
    return ()


@contextlib.contextmanager
def lent(client: FlashClient, name: str) -> Iterator[str]:
    """The port of a probe, which its daemon has closed meanwhile."""
    port = str(client.command(name, "lend", seconds=str(LENT_MAX_S))["value"])
    try:
        if not Path(port).exists():
            raise FlashError(
                f"{name} is on {port} of another machine; run imud flash there"
            )
        yield port
    finally:
        with contextlib.suppress(CommandRefused):
            client.command(name, "lend", seconds="0")


def _write(
    write: Write, kind: str, port: str, image: Image, client: FlashClient | None
) -> None:
    """Writes and reads back, again if it was not kept. FlashError with what to do."""
    began_s = time.monotonic()
    again = f"{COMMAND} {port} --board {kind}"
    if write is _by_dfu:
        again = f"{COMMAND} --board {kind} --by dfu"
    if write is _by_drive:
        again = f"{COMMAND} --board {kind}"
    half: HalfWritten | None = None  # of any try: a later one may not begin at all
    for tries_left in reversed(range(TRIES)):
        bar = flash_client.bar_for(client)

        def on_progress(done: int, of: int, bar: FlashBar = bar) -> None:
            bar.update(done / of)

        try:
            what = write(port, image, on_progress)
        except FlashError as error:
            bar.end()
            half = error if isinstance(error, HalfWritten) else half
            if half is None:
                holders = ", ".join(map(str, holders_of(port)))
                hint = f" ({holders} has it open)" if holders else ""
                raise FlashError(f"{error}{hint}; nothing was written") from error
            if tries_left > 0 and Path(port).exists():
                say(f"{error}; retrying")
                continue
            raise FlashError(
                f"{half}: the board has no working firmware, but its bootloader is "
                f"ready; plug it in and run: {again}"
            ) from error
        except KeyboardInterrupt:
            bar.end()  # what is said comes below it
            say(f"stopped: the board may have no working firmware; run: {again}")
            raise
        finally:
            bar.end()
        say(f"{what} in {time.monotonic() - began_s:.0f} s")
        return


def _back(client: FlashClient, name: str, image: Image) -> dict[str, Any]:
    """The status of the probe, once it runs what was written."""
    until_s = time.monotonic() + BACK_S
    wanted = None if image.about is None else image.about.version
    while time.monotonic() < until_s:
        for status in client.statuses(name):
            hello = status["hello"]
            is_there = status["state"] not in ("gone", "silent")
            if is_there and wanted in (None, hello.get("firmware")):
                return status
        time.sleep(TICK_S)
    raise FlashError(
        f"{name} was written, but does not answer after {BACK_S:g} s; "
        "unplug it, plug it in again, and check with imud list"
    )


def _writer(args: argparse.Namespace, kind: str) -> Write:
    """How a board of that kind is written."""
    if kind == "nano" and args.by is None:
        return _by_nano
    if kind == "mega" and args.by is None:
        return _by_mega
    if kind == "f405":
        is_dfu = args.by == "dfu" or (args.by is None and shutil.which("dfu-util"))
        return _by_dfu if is_dfu else _by_rom
    if kind == "pico" and args.by is None:
        return _by_drive
    if kind in ("nano", "mega", "pico"):
        raise FlashError("--by is for an F405; this board has one way: leave it out")
    raise FlashError(f"this is {BOARDS.get(kind, kind)}: pass --board micropython")


def _by_nano(port: str, image: Image, on_progress: OnProgress) -> str:
    return f"{nano.flash(port, image.code, on_progress)} pages written and read back"


def _by_mega(port: str, image: Image, on_progress: OnProgress) -> str:
    return f"{mega.flash(port, image.code, on_progress)} pages written and read back"


def _by_rom(port: str, image: Image, on_progress: OnProgress) -> str:
    say(
        f"{port}: put the cable on Y9 and Y10, connect DFU to 3V3, press RST; waiting "
        f"{f405.SYNC_S:g} s for the bootloader"
    )
    written = f405.flash(port, image.binary(), on_progress, sync_s=f405.SYNC_S)
    return f"{written:,} bytes written and read back"


def _by_dfu(_: str, image: Image, on_progress: OnProgress) -> str:
    say(
        "connect the USB cable, and DFU to 3V3, and press RST; waiting "
        f"{f405.SYNC_S:g} s for the bootloader"
    )
    written = f405.write_by_dfu_util(image.binary())
    on_progress(1, 1)
    return f"{written:,} bytes written and read back"


def _by_drive(port: str, image: Image, on_progress: OnProgress) -> str:
    if port == USB:
        say(
            f"hold BOOTSEL and plug the board in; waiting {pico.DRIVE_S:g} s for its "
            f"drive {pico.LABEL}"
        )
    raw = image.path.read_bytes()
    written = pico.flash(None if port == USB else port, raw, on_progress)
    return f"{written:,} bytes copied"


BY_HAND = (_by_rom, _by_dfu)  # the board was wired for it


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
