# SPDX-License-Identifier: MIT
"""`imud bridge`: poses for programs of other fields."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imud.cli.arguments import add_command, add_network, add_seconds
from imud.cli.daemon import MISCONFIGURED
from imud.cli.parser import plain
from imud.defaults import ENDPOINT, PREFIX

if TYPE_CHECKING:
    from imud.cli.arguments import Commands

# Settings that are options, too: the others are in a file alone.
OPTIONS: dict[str, dict[str, Any]] = {
    "to": {"metavar": "HOST:PORT", "help": "address of the receiver, or the broker"},
    "rate_hz": {
        "metavar": "HZ",
        "type": float,
        "help": "most poses, or messages, of a probe per second; 0: all",
    },
    "relative_heading": {
        "action": "store_true",
        "default": None,
        "help": "also send orientations whose heading has no stated error: it is "
        "relative, and may drift",
    },
}
# By name: what it is, and its options.
OUTPUTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "osc": ("OSC: TouchDesigner, Max, Pure Data", (*OPTIONS,)),
    "vmc": ("VMC: bodies as bones, probes as trackers", (*OPTIONS,)),
    "lsl": ("the Lab Streaming Layer", ("relative_heading",)),
    "mqtt": ("an MQTT broker, with Home Assistant's discovery", ("to", "rate_hz")),
    "mavlink": ("MAVLink: ground stations, autopilots", (*OPTIONS,)),
}


def add(commands: Commands) -> None:
    """Adds `imud bridge` and its outputs."""
    bridge = add_command(
        commands,
        "bridge",
        "pass poses on to programs that speak OSC, VMC, LSL, MQTT or MAVLink",
        "imud bridge osc --to 127.0.0.1:9000, with imud run in another terminal",
        "It runs until Ctrl-C, beside the daemon or on another machine. "
        "docs/bridge.md says what is sent.",
    ).add_subparsers(metavar="OUTPUT", required=True)
    for name, (what, own) in OUTPUTS.items():
        example = f"imud bridge {name}{' --to 127.0.0.1:9000' * ('to' in own)}"
        output = add_command(bridge, name, f"send poses to {what}", example)
        for option in own:
            output.add_argument(f"--{option.replace('_', '-')}", **OPTIONS[option])
        _add_source(output)
        output.set_defaults(run=_run, output=name)
    every = add_command(
        bridge,
        "all",
        "send poses to all outputs that a configuration enables",
        "imud bridge all --config imud.toml",
    )
    _add_source(every)
    every.set_defaults(run=_run, output=None)


def _add_source(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        help="TOML file of settings, as printed by imud config; arguments override it",
    )
    add_network(parser)
    add_seconds(parser)


def _run(args: argparse.Namespace) -> int:
    from imud.errors import ConfigError

    try:
        return _bridged(args)
    except ConfigError as error:
        sys.stderr.write(f"imud: {plain(str(error))}\n")
        return MISCONFIGURED


def _bridged(args: argparse.Namespace) -> int:
    from imud.bridge import run
    from imud.config import reader
    from imud.errors import ConfigError

    # What is not given is as the file has it.
    connect = args.connect if args.connect != ENDPOINT else None
    source = {"connect": connect, "keys": args.keys and str(args.keys)}
    changes: dict[str, dict[str, Any]] = {"bridge": source}
    changes["zenoh"] = {"prefix": args.prefix if args.prefix != PREFIX else None}
    if args.output is not None:
        given = {name: getattr(args, name) for name in OUTPUTS[args.output][1]}
        changes[args.output] = {"enabled": True, **given}
    config = reader.load(args.config, changes=changes)
    names = (
        [args.output]
        if args.output is not None
        else [name for name in OUTPUTS if getattr(config, name).enabled]
    )
    if not names:
        raise ConfigError(
            "no output is enabled: add [osc] and enabled = true to the configuration, "
            "or name one: imud bridge osc"
        )
    return run.run(names, config, args.seconds)
