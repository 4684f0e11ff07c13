# SPDX-License-Identifier: MIT
"""`imud completion`: what a shell completes."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from imud.cli.arguments import add_command

if TYPE_CHECKING:
    from imud.cli.arguments import Commands

SHELLS = ("bash", "zsh", "tcsh")


def add(commands: Commands) -> None:
    """Adds `imud completion`."""
    parser = add_command(
        commands,
        "completion",
        "print a script for shell completion of imud's commands and options",
        "imud completion bash > ~/.local/share/bash-completion/completions/imud",
    )
    parser.add_argument(
        "shell", metavar="SHELL", choices=SHELLS, help=", ".join(SHELLS)
    )
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    import shtab

    from imud.cli.entry import build_parser

    parser = build_parser()
    if Path(sys.argv[0]).name == "imu-probe":
        parser.prog = "imu-probe"
    sys.stdout.write(shtab.complete(parser, shell=args.shell) + "\n")
    return 0
