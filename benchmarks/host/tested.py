# SPDX-License-Identifier: MIT
"""Figures that tests record: how well samples of virtual probes are dated, and how soon
all poses arrive again after a fault between two sites.

Their daemons' clocks are the emulators', so a busy machine does not distort the first.
The second needs network namespaces, as root has.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from benchmarks.common.paths import PROJECT, RESULTS

OUTPUT = RESULTS / "tested.json"
TESTS = {
    "clock": ("tests/system/test_clock.py", "-k", "nano or f405"),
    "sites": ("tests/hosts/test_sites.py",),
}

Found = dict[str, dict[str, float]]


def recorded(report: Path) -> Found:
    """The numbers that each test recorded, by its parameters or its name."""
    found: Found = {}
    # The file is our own: no bombs of entities.
    for case in ElementTree.parse(report).getroot().iter("testcase"):  # noqa: S314
        name = case.attrib["name"]
        parameters = name.partition("[")[2].removesuffix("]")
        values = {
            each.attrib["name"]: float(each.attrib["value"])
            for each in case.iter("property")
        }
        if values:
            found[parameters or name] = values
    return found


def run(words: Sequence[str]) -> Found:
    """Run tests in full length; raises CalledProcessError where one fails."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        options = ("-o", "junit_family=xunit1", "--junitxml", str(report))
        command = [sys.executable, "-m", "pytest", "-q", *options, *words]
        environment = {**os.environ, "IMU_LONG": "1"}
        subprocess.run(command, cwd=PROJECT, env=environment, check=True)
        return recorded(report)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=TESTS, help="without the other")
    options = parser.parse_args(arguments)
    names = [options.only] if options.only else [*TESTS]
    found = {name: run(TESTS[name]) for name in names}
    OUTPUT.parent.mkdir(parents=True, exist_ok=True)
    OUTPUT.write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
