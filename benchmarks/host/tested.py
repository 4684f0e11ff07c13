# SPDX-License-Identifier: MIT
"""Figures that tests record. `clock`: how well samples of virtual probes are dated; the
daemon's clock is the emulator's, so a busy machine does not distort it. `sites`: how
soon all poses arrive again after a fault between two sites; needs network namespaces.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from benchmarks.common.paths import PROJECT, RESULTS, write_results
from benchmarks.host.faults import Recorder

TESTS = {
    "clock": ("tests/system/test_clock.py", "-k", "nano or f405"),
    "sites": ("tests/hosts/test_sites.py",),
}


def by_parameters(found: Mapping[str, Any]) -> dict[str, Any]:
    """With the parameters of tests for their names, where they have any."""
    return {
        name.partition("[")[2].removesuffix("]") or name: values
        for name, values in found.items()
    }


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=TESTS)
    what = parser.parse_args(arguments).what
    os.chdir(PROJECT)
    os.environ["IMU_LONG"] = "1"
    recorder = Recorder()
    words = ["-q", "-p", "no:cacheprovider", *TESTS[what]]
    status = int(pytest.main(words, plugins=[recorder]))
    found = by_parameters(recorder.found)
    print(json.dumps(found, indent=1))
    if status == 0:
        write_results(RESULTS / f"tested-{what}.json", found)
    return status


if __name__ == "__main__":
    sys.exit(main())
